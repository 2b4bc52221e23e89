//! What remains unexplained: the evidence of the random effects.

use super::bench::Bench;
use super::engine::Outer;
use super::fit::LaplaceFit;
use super::outer::{Free, score, without_sites};

impl Bench<'_> {
    /// Log Bayes factor of the sites' random effect. With it and without it the model's fields have the resolution at
    /// which they say most: where sites differ and fields are finer than the model's, both are needed.
    pub(super) fn site_evidence(&self, fit: &LaplaceFit) -> f64 {
        let finer = self.finer.iter().map(|terms| [&fit.active[..], terms].concat());
        let resolutions: Vec<Vec<usize>> = [fit.active.clone()].into_iter().chain(finer).collect();
        let best = |of: &dyn Fn(&[usize]) -> Option<(LaplaceFit, f64)>| {
            let fits = resolutions.iter().filter_map(|active| of(active));
            let (best, score) = fits.max_by(|a, b| a.1.total_cmp(&b.1))?;
            let refined = self.optimised(&best, Free::All).map_or(score, |(_, refined)| refined);
            Some(refined.max(score))
        };
        let with = best(&|active| {
            let start = self.engine.fit(&fit.outer, active, Some(fit))?;
            self.optimised(&start, Free::Spread)
        });
        let without = best(&|active| without_sites(&self.engine, active, fit, self.step));
        with.unwrap_or(score(fit, self.step)).max(score(fit, self.step))
            - without.unwrap_or(f64::NEG_INFINITY)
    }

    /// Log Bayes factor of the units' random effect.
    pub(super) fn unit_evidence(&self, fit: &LaplaceFit, found: &[usize]) -> f64 {
        let outer = Outer { ln_unit: None, ..fit.outer.clone() };
        let start = self.engine.fit(&outer, found, None);
        let without = start.and_then(|start| self.optimised(&start, Free::Spread));
        score(fit, self.step) - without.map_or(f64::NEG_INFINITY, |(_, score)| score)
    }
}
