//! What remains unexplained: the evidence of the random effects.

use super::bench::Bench;
use super::candidate::Level;
use super::engine::Outer;
use super::fit::LaplaceFit;
use super::outer::{Free, score, without_sites};

/// A fit with these terms, and its score.
type Fitted<'a> = &'a dyn Fn(&[usize]) -> Option<(LaplaceFit, f64)>;

impl Bench<'_> {
    /// Log Bayes factor of the sites' random effect. The model's own fields may be too coarse, and the curves of what
    /// was found may not follow the true ones; neither is a further cause. So with the random effect and without it, the
    /// model may have smooth fields beside its own, another curve of what was found, or both: what says most counts.
    pub(super) fn site_evidence(&self, fit: &LaplaceFit) -> f64 {
        let curves: Vec<Vec<usize>> =
            [vec![]].into_iter().chain(self.curves(&fit.active).map(|c| vec![c])).collect();
        let beside = [&[], &self.smooth[..]]
            .into_iter()
            .flat_map(|fields| curves.iter().map(move |curve| [fields, curve].concat()));
        let all: Vec<Vec<usize>> = beside.map(|terms| [&fit.active[..], &terms].concat()).collect();
        let best = |of: Fitted<'_>| {
            let refined = |(fit, score): (LaplaceFit, f64)| {
                self.optimised(&fit, Free::All).map_or(score, |(_, refined)| refined.max(score))
            };
            all.iter().filter_map(|active| of(active)).map(refined).reduce(f64::max)
        };
        let with = best(&|active| {
            let start = self.engine.fit(&fit.outer, active, Some(fit))?;
            self.optimised(&start, Free::Spread)
        });
        let without = best(&|active| without_sites(&self.engine, active, fit, self.step));
        with.unwrap_or(score(fit, self.step)).max(score(fit, self.step))
            - without.unwrap_or(f64::NEG_INFINITY)
    }

    /// Log Bayes factor of fields with more modes beside the random effects, the best of the sizes
    /// that are tried; `None` if the surface has no more.
    pub(super) fn finer_evidence(&self, fit: &LaplaceFit) -> Option<f64> {
        let scores = self.finer.iter().filter_map(|terms| {
            let active = [&fit.active[..], terms].concat();
            let start = self.engine.fit(&fit.outer, &active, Some(fit))?;
            Some(self.optimised(&start, Free::Spread)?.1)
        });
        Some(scores.reduce(f64::max)? - score(fit, self.step))
    }

    /// The other forms of what was found on what is observed: a curve beside a line.
    fn curves(&self, active: &[usize]) -> impl Iterator<Item = usize> {
        let is_curve = |c: &usize| {
            let candidate = &self.candidates[*c];
            candidate.level == Level::Observable && candidate.edge().is_none()
        };
        let is_found = |c: &usize| {
            let mut found = active.iter().filter_map(|a| self.candidates.get(*a));
            found.any(|found| found.cause == self.candidates[*c].cause)
        };
        let is_new = |c: &usize| !active.contains(c);
        let all = (0..self.candidates.len()).filter(is_new).filter(is_curve);
        all.filter(is_found).collect::<Vec<_>>().into_iter()
    }

    /// Log Bayes factor of the units' random effect.
    pub(super) fn unit_evidence(&self, fit: &LaplaceFit, found: &[usize]) -> f64 {
        let outer = Outer { ln_unit: None, ..fit.outer.clone() };
        let start = self.engine.fit(&outer, found, None);
        let without = start.and_then(|start| self.optimised(&start, Free::Spread));
        score(fit, self.step) - without.map_or(f64::NEG_INFINITY, |(_, score)| score)
    }
}
