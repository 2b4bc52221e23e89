//! Predictions of what a Laplace fit has not seen: each site from the others, or units left out as a whole.

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::engine::Engine;
use super::fit::{Cavity, Fit};
use super::units::Unit;
use crate::random::Stream;

/// Draws from each cavity. The log of an average over them is off by a tenth of a nat or two, and there is one
/// for every site: too few would drown what an effect gains.
const DRAWS: usize = 2048;
/// Draws that residuals need.
const FEW: usize = 128;

/// What rows would have been, had their site not been seen.
#[derive(Clone, Debug)]
pub struct Left {
    /// Normal score of each row's randomised leave-one-site-out quantile.
    pub residual: Vec<f64>,
    /// Predicted value of each row.
    pub predicted: Vec<f64>,
    /// Leave-one-site-out log predictive density of each site.
    pub elpd: Vec<f64>,
}

/// Leave-one-site-out predictions from one fit; the same `seed` gives the same random numbers for
/// every fit, so that differences between fits are not noise.
pub fn leave_sites_out(engine: &Engine, fit: &Fit, seed: u64) -> Left {
    leave(engine, fit, &all_rows(engine), seed, DRAWS)
}

/// Residual of each row as in [`leave_sites_out`], from few draws.
pub(super) fn residuals(engine: &Engine, fit: &Fit, seed: u64) -> Vec<f64> {
    leave(engine, fit, &all_rows(engine), seed, FEW).residual
}

fn all_rows(engine: &Engine) -> Vec<usize> {
    (0..engine.rows.len()).collect()
}

/// As [`leave_sites_out`], of these rows alone (ascending); where `fit` has not seen them, their
/// predictions.
pub fn leave_out(engine: &Engine, fit: &Fit, of: &[usize], seed: u64) -> Left {
    leave(engine, fit, of, seed, DRAWS)
}

fn leave(engine: &Engine, fit: &Fit, of: &[usize], seed: u64, draws: usize) -> Left {
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
            predict(engine, fit, &cavity, &mut left, (&mut rng, draws))
        });
    }
    left
}

/// Most folds of [`leave_units_out`].
const FOLDS: usize = 20;

/// As [`leave_sites_out`], each unit predicted from the others by a fit that has not seen it (at most 20
/// folds); `elpd` is of folds, sites counting as independent given the fit. `None` where a fit fails.
pub fn leave_units_out(engine: &Engine, fit: &Fit, unit: &Unit, seed: u64) -> Option<Left> {
    let (n, folds) = (engine.rows.len(), unit.n.min(FOLDS));
    let mut all = Left { residual: vec![0.0; n], predicted: vec![f64::NAN; n], elpd: vec![] };
    for fold in 0..folds {
        let is_hidden =
            |r: &usize| unit.group[engine.model.table_row(engine.rows[*r].id)] % folds == fold;
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

/// Sum of squared errors in each fold of [`leave_units_out`]; a row without a middle has none.
pub(super) fn squared_errors(engine: &Engine, left: &Left, unit: &Unit) -> Vec<f64> {
    let mut squares = vec![0.0; left.elpd.len()];
    for (row, predicted) in engine.rows.iter().zip(&left.predicted) {
        let cells = engine.model.observes[row.id.observe].observed_row(row.id.row);
        let square = (cells.iter().sum::<f64>() / cells.len() as f64 - predicted).powi(2);
        if square.is_finite() {
            squares[unit.group[engine.model.table_row(row.id)] % left.elpd.len()] += square;
        }
    }
    squares
}

/// Predicts a cavity's rows; returns their joint log predictive density.
fn predict(
    engine: &Engine,
    fit: &Fit,
    cavity: &Cavity,
    left: &mut Left,
    (rng, draws): (&mut ChaCha8Rng, usize),
) -> f64 {
    let noise = fit.noise();
    let root = square_root(&cavity.covariance);
    let rows = &cavity.rows;
    let mut below = vec![[0.0; 2]; rows.len()];
    let mut sums = vec![(0.0, 0.0); rows.len()];
    let mut ln = vec![];
    for _ in 0..draws {
        let z = DVector::from_fn(cavity.mean.len(), |_, _| rng.sample::<f64, _>(StandardNormal));
        let locals = &cavity.mean + &root * z;
        let (mut at, mut total) = (0, 0.0);
        for (i, r) in rows.iter().enumerate() {
            let row = &engine.rows[*r];
            let own = &mut locals.as_slice()[at..at + row.n].to_vec();
            at += row.n;
            total += engine.model.row_ln(row.id, own, &noise);
            if let Some(location) = engine.model.row_location(row.id, own) {
                sums[i].0 += location;
                sums[i].1 += 1.0;
            }
            own[row.observable] += fit.error(rng);
            let cells = engine.model.row_replicate(row.id, own, rng);
            let observed = &engine.model.observes[row.id.observe].observed_row(row.id.row);
            match order(&cells, observed) {
                std::cmp::Ordering::Less => below[i][0] += 1.0,
                std::cmp::Ordering::Equal => below[i][1] += 1.0,
                std::cmp::Ordering::Greater => {}
            }
        }
        ln.push(total);
    }
    for (i, r) in rows.iter().enumerate() {
        let u: f64 = rng.random();
        let rank = (below[i][0] + u * (below[i][1] + 1.0)) / (draws as f64 + 1.0);
        left.residual[*r] = crate::diagnostics::normal_quantile(rank);
        left.predicted[*r] = sums[i].0 / sums[i].1;
    }
    let most = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    most + (ln.iter().map(|l| (l - most).exp()).sum::<f64>() / draws as f64).ln()
}

/// Compares measurements by their first finite cell.
pub(super) fn order(a: &[f64], b: &[f64]) -> std::cmp::Ordering {
    let key = |x: &[f64]| {
        x.iter().copied().fold(0.0, |sum, x| sum + if x.is_finite() { x } else { x.signum() * 1e9 })
    };
    key(a).total_cmp(&key(b))
}

/// `R Rᵀ = covariance`, also where it is singular.
fn square_root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let mut eigen = nalgebra::SymmetricEigen::new(covariance.clone());
    eigen.eigenvalues.apply(|e| *e = e.max(0.0).sqrt());
    &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues)
}
