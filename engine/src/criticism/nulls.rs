//! The same search on data in which nothing is missing: what a claim must beat.

use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::DVector;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

use super::bench::Bench;
use super::engine::Engine;
use super::error::CriticismError;
use super::fit::LaplaceFit;
use super::outer::{Free, optimise};
use super::progress::{Remembered, SearchProgress, Watch};
use super::search::search;
use crate::random::Stream;

/// The searches of a round.
pub(super) struct Nulls<'a> {
    pub(super) bench: &'a Bench<'a>,
    /// Number of the round, from 0.
    pub(super) round: usize,
    /// How many.
    pub(super) n: usize,
    /// What data are simulated from.
    pub(super) base: &'a LaplaceFit,
    /// Candidates in it.
    pub(super) found: &'a [usize],
    /// What an interrupted search came to.
    pub(super) remembered: &'a dyn Remembered,
}

impl Nulls<'_> {
    /// Best log Bayes factor of each search, ascending.
    ///
    /// # Errors
    /// `watch` says to stop.
    pub(super) fn run(&self, watch: &Watch<'_>) -> Result<Vec<f64>, CriticismError> {
        let done = AtomicUsize::new(0);
        let one = |k: usize| -> Result<f64, CriticismError> {
            let known = self.remembered.recall(self.round, k);
            let best = known.unwrap_or_else(|| self.best(k));
            if known.is_none() {
                self.remembered.keep(self.round, k, best);
            }
            let done = 1 + done.fetch_add(1, Ordering::Relaxed);
            let progress = SearchProgress { round: self.round, done, of: self.n };
            if watch(progress).is_break() { Err(CriticismError::Cancelled) } else { Ok(best) }
        };
        let nulls: Result<Vec<f64>, _> = (0..self.n).into_par_iter().map(one).collect();
        let mut nulls = nulls?;
        nulls.sort_by(f64::total_cmp);
        Ok(nulls)
    }

    /// Best log Bayes factor of a search on simulated data, to which the base is fitted again as it was to
    /// the measured data: what is done to one but not to the other would favour one of them.
    fn best(&self, k: usize) -> f64 {
        let Self { bench, base, found, .. } = *self;
        let mut rng = Stream::Null { round: self.round, search: k }.rng(bench.seed);
        let simulated = bench.engine.measuring(simulate(&bench.engine, base, &mut rng));
        let fit = optimise(&simulated, &bench.active(found), base, Free::All, bench.step);
        let Some((fit, _)) = fit else {
            return f64::INFINITY; // counts against a claim
        };
        let searched = search(bench, &simulated, fit, found);
        searched.best()
    }
}

/// Another data set from a fit: fields anew from their prior, random effects and errors too, and what else is
/// unknown from its posterior. The fitted fields would not do: they have bent after the cause that they lack, and
/// what is simulated from them has it still.
fn simulate(engine: &Engine, fit: &LaplaceFit, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let mut normals = |n: usize| DVector::from_fn(n, |_, _| rng.sample::<f64, _>(StandardNormal));
    let sites = normals(engine.sites.len()) * fit.outer.ln_site.exp();
    // precision = L Lᵀ
    let z = normals(fit.x.len());
    let moved = fit.system.factor.l_dirty().tr_solve_lower_triangular(&z);
    let mut x = moved.map_or_else(|| fit.x.clone(), |moved| &fit.x + moved);
    let units = fit.unit_term(engine).map_or(0, |term| term.n);
    let first = engine.split.linear.len();
    x.rows_mut(first, units).copy_from(&normals(units));
    for k in (0..first).filter(|k| engine.split.is_eta[*k]) {
        x[k] = normals(1)[0];
    }
    let one = |(r, row): (usize, &super::engine::RowAt)| {
        let local = |l: usize| {
            let j = fit.design_row(row.first + l).iter().zip(x.iter());
            fit.linear.constant[row.first + l] + j.map(|(j, x)| j * x).sum::<f64>()
        };
        let mut own: Vec<f64> = (0..row.n).map(local).collect();
        own[row.observable] += sites[row.site] + fit.error(r, rng);
        engine.model.row_replicate(row.id, &engine.measured[r], &own, rng)
    };
    engine.rows.iter().enumerate().map(one).collect()
}
