//! What remains unexplained: the evidence of the random effects.

use super::bench::Bench;
use super::engine::Outer;
use super::fit::LaplaceFit;
use super::outer::{Free, score, without_sites};

impl Bench<'_> {
    /// Log Bayes factor of the sites' random effect, against nothing or the model's fields at a finer
    /// resolution, whichever says more when fitted as well.
    pub(super) fn site_evidence(&self, fit: &LaplaceFit) -> f64 {
        let finer = self.finer.iter().map(|terms| [&fit.active[..], terms].concat());
        let without = [fit.active.clone()].into_iter().chain(finer);
        let fits =
            without.filter_map(|active| without_sites(&self.engine, &active, fit, self.step));
        let Some((best, _)) = fits.max_by(|a, b| a.1.total_cmp(&b.1)) else {
            return f64::INFINITY;
        };
        let best = self.optimised(&best, Free::All);
        score(fit, self.step) - best.map_or(f64::NEG_INFINITY, |(_, score)| score)
    }

    /// Log Bayes factor of the units' random effect.
    pub(super) fn unit_evidence(&self, fit: &LaplaceFit, found: &[usize]) -> f64 {
        let outer = Outer { ln_unit: None, ..fit.outer.clone() };
        let start = self.engine.fit(&outer, found, None);
        let without = start.and_then(|start| self.optimised(&start, Free::Spread));
        score(fit, self.step) - without.map_or(f64::NEG_INFINITY, |(_, score)| score)
    }
}
