//! What remains unexplained: the evidence of the random effects.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::bench::Bench;
use super::candidate::Level;
use super::engine::{Engine, Outer};
use super::error::CriticismError;
use super::fit::LaplaceFit;
use super::judgement::CLAIM;
use super::nulls::{LEVEL, share_above, simulate};
use super::outer::{Free, optimise, score, without_sites};
use super::progress::{SearchProgress, Watch};
use crate::random::Stream;

/// A fit with these terms, and its score.
type Fitted<'a> = &'a dyn Fn(&[usize]) -> Option<(LaplaceFit, f64)>;

/// Whether sites differ by more than everything that was found says.
#[derive(Clone, Debug)]
pub struct SiteEvidence {
    /// Log Bayes factor of the sites' random effect.
    pub log_bf: f64,
    /// The same on each of as many data sets as there are null searches, simulated from the best fit in which sites do
    /// not differ; ascending. None where [`CLAIM`] is not passed.
    pub nulls: Vec<f64>,
}

impl SiteEvidence {
    /// Whether sites differ: by more than [`CLAIM`], and by more than they seem to on 95 % of the simulated data. What
    /// fields leave out in truth is in no simulated data, so that these alone would not do.
    pub fn is_unexplained(&self) -> bool {
        let is_chance = || !self.nulls.is_empty() && share_above(&self.nulls, self.log_bf) > LEVEL;
        self.log_bf > CLAIM && !is_chance()
    }
}

impl Bench<'_> {
    /// The evidence of the sites' random effect beside everything that was found, and what it comes to on `n` simulated
    /// data sets in which sites do not differ.
    ///
    /// # Errors
    /// `watch` says to stop.
    pub(super) fn site_evidence(
        &self,
        fit: &LaplaceFit,
        n: usize,
        watch: &Watch<'_>,
    ) -> Result<SiteEvidence, CriticismError> {
        let (log_bf, without) = self.sites_against_none(&self.engine, fit);
        // without enough evidence it is not asked whether that is chance
        let Some(without) = without.filter(|_| log_bf > CLAIM) else {
            return Ok(SiteEvidence { log_bf, nulls: vec![] });
        };
        let done = AtomicUsize::new(0);
        let one = |k: usize| -> Result<f64, CriticismError> {
            let mut rng = Stream::SiteNull { search: k }.rng(self.seed);
            let engine = self.engine.measuring(simulate(&self.engine, &without, &mut rng));
            // both from the measured fit, as the measured data were
            let fit = optimise(&engine, &fit.active, fit, Free::All, self.step);
            // where there is no fit it counts against a claim
            let log_bf =
                fit.map_or(f64::INFINITY, |(fit, _)| self.sites_against_none(&engine, &fit).0);
            let done = 1 + done.fetch_add(1, Ordering::Relaxed);
            let progress = SearchProgress { round: None, done, of: n };
            if watch(progress).is_break() { Err(CriticismError::Cancelled) } else { Ok(log_bf) }
        };
        let nulls: Result<Vec<f64>, _> = (0..n).into_par_iter().map(one).collect();
        let mut nulls = nulls?;
        nulls.sort_by(f64::total_cmp);
        Ok(SiteEvidence { log_bf, nulls })
    }

    /// Log Bayes factor of the sites' random effect, and the best fit without it. With it and without it the model's
    /// fields have the resolution at which they say most: where sites differ and fields are finer than the model's, both
    /// are needed. So have the curves of what was found: where these do not follow the true ones, that is no further
    /// cause.
    fn sites_against_none(&self, engine: &Engine, fit: &LaplaceFit) -> (f64, Option<LaplaceFit>) {
        let curves = self.curves(&fit.active).map(|curve| vec![curve]);
        let further = [vec![]].into_iter().chain(self.finer.iter().cloned()).chain(curves);
        let resolutions: Vec<Vec<usize>> =
            further.map(|terms| [&fit.active[..], &terms].concat()).collect();
        let best = |of: Fitted<'_>| {
            let fits = resolutions.iter().filter_map(|active| of(active));
            let (best, score) = fits.max_by(|a, b| a.1.total_cmp(&b.1))?;
            let refined = optimise(engine, &best.active, &best, Free::All, self.step);
            Some(refined.filter(|(_, refined)| *refined > score).unwrap_or((best, score)))
        };
        let with = best(&|active| {
            let start = engine.fit(&fit.outer, active, Some(fit))?;
            optimise(engine, active, &start, Free::Spread, self.step)
        });
        let without = best(&|active| without_sites(engine, active, fit, self.step));
        let own = score(fit, self.step);
        let with = with.map_or(own, |(_, with)| with.max(own));
        let ln_without = without.as_ref().map_or(f64::NEG_INFINITY, |(_, without)| *without);
        (with - ln_without, without.map(|(fit, _)| fit))
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
