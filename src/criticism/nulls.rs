//! The same search on data in which nothing is missing: what a claim must beat.

use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::DVector;
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

use super::engine::{Engine, RowAt};
use super::error::CriticismError;
use super::fit::Fit;
use super::judge::least_log_bf;
use super::outer::{Free, optimise};
use super::procedure::{Run, engine};
use super::search::Tried;
use crate::random::Stream;

impl Run<'_> {
    /// Best log Bayes factor of each search on data simulated from `base`, ascending.
    pub(super) fn nulls(
        &self,
        number: usize,
        tried: &[Tried],
        base: &Fit,
        found: &[usize],
        watch: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Vec<f64>, CriticismError> {
        let best = tried.first().map_or(f64::NEG_INFINITY, |t| t.log_bf);
        if number > 0 && best <= least_log_bf(number) {
            return Ok(vec![]);
        }
        let done = AtomicUsize::new(0);
        let null = |k: usize| -> Result<f64, CriticismError> {
            let best = self.null(number, k, base, found)?;
            watch(number, 1 + done.fetch_add(1, Ordering::Relaxed));
            Ok(best)
        };
        let nulls: Result<Vec<f64>, _> =
            (0..self.settings.nulls).into_par_iter().map(null).collect();
        let mut nulls = nulls?;
        nulls.sort_by(f64::total_cmp);
        Ok(nulls)
    }

    /// Best log Bayes factor of a search on data simulated from `base`, which is fitted again as it was to
    /// the measured data: what is done to one but not to the other would favour one of them.
    fn null(
        &self,
        round: usize,
        k: usize,
        base: &Fit,
        found: &[usize],
    ) -> Result<f64, CriticismError> {
        let mut rng = Stream::Null { round, search: k }.rng(self.settings.seed);
        let cells = simulate(&self.engine, base, &mut rng);
        let mut simulated = engine(self.case, &self.on, &self.candidates, self.unit.as_ref())?;
        let ids: Vec<_> = simulated.rows.iter().map(|row| row.id).collect();
        for (id, cells) in ids.into_iter().zip(&cells) {
            simulated.model.set_observed(id, cells);
        }
        let active = self.active(found);
        let Some((fit, _)) = optimise(&simulated, &active, base, Free::All, self.step) else {
            return Ok(f64::INFINITY); // counts against a claim
        };
        let (_, tried) = self.searched(&simulated, fit, found);
        Ok(tried.iter().map(|t| t.log_bf).fold(f64::NEG_INFINITY, f64::max))
    }
}

/// Another data set from a fit: fields anew from their prior, random effects and errors too, and what else is
/// unknown from its posterior. The fitted fields would not do: they have bent after the cause that they lack, and
/// what is simulated from them has it still.
fn simulate(engine: &Engine, fit: &Fit, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let mut normals = |n: usize| DVector::from_fn(n, |_, _| rng.sample::<f64, _>(StandardNormal));
    let sites = normals(engine.sites.len()) * fit.outer.ln_site.exp();
    // precision = L Lᵀ
    let z = normals(fit.x.len());
    let moved = fit.factor.l_dirty().tr_solve_lower_triangular(&z);
    let mut x = moved.map_or_else(|| fit.x.clone(), |moved| &fit.x + moved);
    let units = fit.unit_term(engine).map_or(0, |term| term.n);
    let first = engine.split.linear.len();
    x.rows_mut(first, units).copy_from(&normals(units));
    for k in (0..first).filter(|k| engine.split.is_eta[*k]) {
        x[k] = normals(1)[0];
    }
    let one = |row: &RowAt| {
        let local = |l: usize| {
            let j = fit.design_row(row.first + l).iter().zip(x.iter());
            fit.linear.constant[row.first + l] + j.map(|(j, x)| j * x).sum::<f64>()
        };
        let mut own: Vec<f64> = (0..row.n).map(local).collect();
        own[row.observable] += sites[row.site] + fit.error(rng);
        engine.model.row_replicate(row.id, &own, rng)
    };
    engine.rows.iter().map(one).collect()
}

impl Fit {
    /// A further error of one row.
    pub(super) fn error(&self, rng: &mut dyn Rng) -> f64 {
        let noise = self.noise();
        let mut variance = noise.variance;
        if let Some((share, wide)) = noise.outliers
            && rng.random::<f64>() < share
        {
            variance += wide;
        }
        variance.sqrt() * rng.sample::<f64, _>(StandardNormal)
    }
}
