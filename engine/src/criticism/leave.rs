//! Predictions of what a Laplace fit has not seen: of each site from the other sites, or of units
//! that are left out as a whole.

use std::cmp::Ordering;

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::engine::Engine;
use super::fit::{Cavity, LaplaceFit};
use super::units::Unit;
use crate::diagnostics::normal_quantile;
use crate::num::ln_mean_exp;
use crate::random::Stream;

/// Number of draws from each cavity. The log of an average over them is off by a tenth of a nat or
/// two, and there is one such average for every site. With too few draws these errors would drown
/// what an effect gains.
const DRAWS: usize = 2048;
/// Number of draws for residuals, which need fewer.
const FEW: usize = 128;

/// What a fit says of rows, given everything but their own site.
#[derive(Clone, Debug)]
pub struct Left {
    /// Each row's quantile among its leave-one-site-out predictions, as a normal score. Ties are
    /// broken at random.
    pub residual: Vec<f64>,
    /// Predicted value of each row.
    pub predicted: Vec<f64>,
    /// Leave-one-site-out log predictive density of each site.
    pub elpd: Vec<f64>,
}

/// Leave-one-site-out predictions from one fit. The same `seed` gives every fit the same random
/// numbers, so that differences between fits are not noise.
pub fn leave_sites_out(engine: &Engine, fit: &LaplaceFit, seed: u64) -> Left {
    leave(engine, fit, &all_rows(engine), seed, DRAWS)
}

/// Residual of each row as in [`leave_sites_out`], from few draws.
pub(super) fn residuals(engine: &Engine, fit: &LaplaceFit, seed: u64) -> Vec<f64> {
    leave(engine, fit, &all_rows(engine), seed, FEW).residual
}

fn all_rows(engine: &Engine) -> Vec<usize> {
    (0..engine.rows.len()).collect()
}

/// As [`leave_sites_out`], but of these rows alone (ascending). If `fit` has not seen them, these
/// are its predictions of them.
pub fn leave_out(engine: &Engine, fit: &LaplaceFit, of: &[usize], seed: u64) -> Left {
    leave(engine, fit, of, seed, DRAWS)
}

fn leave(engine: &Engine, fit: &LaplaceFit, of: &[usize], seed: u64, draws: usize) -> Left {
    let n = engine.rows.len();
    let mut left = Left {
        residual: vec![0.0; n],
        predicted: vec![f64::NAN; n],
        elpd: vec![0.0; engine.sites.len()],
    };
    for (site, rows) in engine.sites.iter().enumerate() {
        let own: Vec<usize> =
            rows.iter().copied().filter(|r| of.binary_search(r).is_ok()).collect();
        if own.is_empty() {
            continue;
        }
        let mut rng = Stream::LeftOut { site }.rng(seed);
        left.elpd[site] = fit.cavity(engine, &own).map_or(f64::NEG_INFINITY, |cavity| {
            let predicted = predict(engine, fit, &cavity, draws, &mut rng);
            for (r, (residual, value)) in cavity.rows.iter().zip(predicted.rows) {
                (left.residual[*r], left.predicted[*r]) = (residual, value);
            }
            predicted.elpd
        });
    }
    left
}

/// Most folds of [`leave_units_out`].
const FOLDS: usize = 20;

/// As [`leave_sites_out`], but each unit is predicted from the others, by a fit that has not seen
/// it (at most 20 folds). `elpd` is then that of folds; given the fit, sites count as independent.
/// `None` if one of the fits fails.
pub fn leave_units_out(engine: &Engine, fit: &LaplaceFit, unit: &Unit, seed: u64) -> Option<Left> {
    let (n, folds) = (engine.rows.len(), unit.n.min(FOLDS));
    let mut all = Left { residual: vec![0.0; n], predicted: vec![f64::NAN; n], elpd: vec![] };
    for fold in 0..folds {
        let is_hidden = |r: &usize| unit.group[engine.table_row(*r)] % folds == fold;
        let hidden: Vec<usize> = (0..n).filter(is_hidden).collect();
        let part = engine.fit_without(&hidden, &fit.outer, &fit.active, Some(fit))?;
        let left = leave_out(engine, &part, &hidden, seed);
        for r in hidden {
            (all.residual[r], all.predicted[r]) = (left.residual[r], left.predicted[r]);
        }
        all.elpd.push(left.elpd.iter().sum());
    }
    Some(all)
}

/// Sum of squared errors in each fold of [`leave_units_out`]. A row whose measurement has no middle
/// does not count.
pub(super) fn squared_errors(engine: &Engine, left: &Left, unit: &Unit) -> Vec<f64> {
    let mut squares = vec![0.0; left.elpd.len()];
    for (row, predicted) in left.predicted.iter().enumerate() {
        let square = (engine.middle(row) - predicted).powi(2);
        if square.is_finite() {
            squares[unit.group[engine.table_row(row)] % left.elpd.len()] += square;
        }
    }
    squares
}

/// The predictions of a site's rows by their cavity.
struct FromCavity {
    /// Residual and predicted value of each row.
    rows: Vec<(f64, f64)>,
    /// Their joint log predictive density.
    elpd: f64,
}

/// A row's measurement in comparison with draws of its prediction.
#[derive(Clone, Copy, Default)]
struct Tally {
    below: f64,
    equal: f64,
    /// Sum of predicted values, and how many there are.
    sum: f64,
    n: f64,
}

fn predict(
    engine: &Engine,
    fit: &LaplaceFit,
    cavity: &Cavity,
    draws: usize,
    rng: &mut ChaCha8Rng,
) -> FromCavity {
    let root = square_root(&cavity.covariance);
    let mut tallies = vec![Tally::default(); cavity.rows.len()];
    let mut ln = vec![];
    for _ in 0..draws {
        let z = DVector::from_fn(cavity.mean.len(), |_, _| rng.sample::<f64, _>(StandardNormal));
        let locals = &cavity.mean + &root * z;
        let (mut at, mut total) = (0, 0.0);
        for (tally, r) in tallies.iter_mut().zip(&cavity.rows) {
            let (row, measured) = (&engine.rows[*r], &engine.measured[*r]);
            let own = &mut locals.as_slice()[at..at + row.n].to_vec();
            at += row.n;
            total += engine.model.row_ln(row.id, measured, own, &fit.noise[*r]);
            if let Some(location) = engine.model.row_location(row.id, own) {
                tally.sum += location;
                tally.n += 1.0;
            }
            own[row.observable] += fit.error(*r, rng);
            let cells = engine.model.row_replicate(row.id, measured, own, rng);
            match order(&cells, measured) {
                Ordering::Less => tally.below += 1.0,
                Ordering::Equal => tally.equal += 1.0,
                Ordering::Greater => {}
            }
        }
        ln.push(total);
    }
    let one = |tally: &Tally| {
        let u: f64 = rng.random();
        let rank = (tally.below + u * (tally.equal + 1.0)) / (draws as f64 + 1.0);
        (normal_quantile(rank), tally.sum / tally.n)
    };
    let rows = tallies.iter().map(one).collect();
    FromCavity { rows, elpd: ln_mean_exp(&ln) }
}

/// Compares measurements by their first finite cell.
pub(super) fn order(a: &[f64], b: &[f64]) -> Ordering {
    let key = |x: &[f64]| {
        x.iter().copied().fold(0.0, |sum, x| sum + if x.is_finite() { x } else { x.signum() * 1e9 })
    };
    key(a).total_cmp(&key(b))
}

/// R with `R Rᵀ = covariance`. The covariance may be singular.
fn square_root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let mut eigen = nalgebra::SymmetricEigen::new(covariance.clone());
    eigen.eigenvalues.apply(|e| *e = e.max(0.0).sqrt());
    &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues)
}
