//! Errors on data that played no part: predictions from the draws of a fit on other rows.

use std::cmp::Ordering;

use rand::Rng;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::leave::order;
use crate::model::{Model, Noise, RowId};
use crate::num::ln_mean_exp;
use crate::random::Stream;
use crate::table::{MEASURED, Measurements};

/// What a model says of a measurement that it has not seen.
#[derive(Clone, Debug)]
pub struct Predicted {
    /// Row of the table.
    pub table_row: usize,
    /// Mean of the predicted value; NaN if the likelihood has none.
    pub value: f64,
    /// Middle of what was measured. NaN if nothing was measured, or if the bracket is open.
    pub measured: f64,
    /// Log predictive density.
    pub ln_density: f64,
    /// Quantile of the measurement among its replicates. Ties are broken at random.
    pub quantile: f64,
}

/// A table for predictions: the rows of `train`, then those of `heldout`. A held-out row without a
/// measurement borrows that of a row of `train` of the same protocol; predictions do not depend on
/// it.
pub fn with_heldout(train: &Measurements, heldout: &Measurements, own: &[&str]) -> Measurements {
    let mut measured = MEASURED.to_vec();
    measured.extend(own);
    train.followed_by(heldout, &measured)
}

/// Predictions of rows that were not fitted.
#[derive(Clone, Debug)]
pub struct Predictions {
    /// The prediction of each row.
    pub rows: Vec<Predicted>,
    /// Log likelihood of each row `(rows)` at each draw.
    ln: Vec<Vec<f64>>,
}

impl Predictions {
    /// The joint log predictive density of each of these sets of rows. So a difference that the
    /// rows of a site share counts once.
    pub fn joint(&self, sets: &[Vec<usize>]) -> Vec<f64> {
        let n = self.ln.first().map_or(0, Vec::len);
        let one = |rows: &Vec<usize>| {
            let total = |draw: usize| rows.iter().map(|row| self.ln[*row][draw]).sum();
            ln_mean_exp(&(0..n).map(total).collect::<Vec<f64>>())
        };
        sets.iter().map(one).collect()
    }
}

/// Predicts the rows of `model`, beginning with row `first` of its table. `draws` are draws of the
/// unknowns of `fitted`, the same model on fewer rows. Coefficients of labels that `fitted` has not
/// seen are drawn from their prior.
pub fn predict_rows(
    model: &Model,
    fitted: &Model,
    draws: &[Vec<f64>],
    first: usize,
    seed: u64,
) -> Predictions {
    let ids: Vec<RowId> =
        model.row_ids().into_iter().filter(|id| model.table_row(*id) >= first).collect();
    let mut rng = Stream::HeldOut.rng(seed);
    let mut sums = vec![Sum::default(); ids.len()];
    model.at_draws(fitted, draws, &ids, &mut rng, &mut |row, own, rng| {
        sums[row].add(model, ids[row], own, rng);
    });
    let rows = ids.iter().zip(&sums).map(|(id, sum)| sum.predicted(model, *id, &mut rng));
    Predictions { rows: rows.collect(), ln: sums.into_iter().map(|sum| sum.ln).collect() }
}

#[derive(Clone, Debug, Default)]
struct Sum {
    n: f64,
    value: f64,
    below: f64,
    equal: f64,
    ln: Vec<f64>,
}

impl Sum {
    fn add(&mut self, model: &Model, id: RowId, locals: &[f64], rng: &mut dyn Rng) {
        self.n += 1.0;
        self.value += model.row_location(id, locals).unwrap_or(f64::NAN);
        let measured = model.measured_row(id);
        self.ln.push(model.row_ln(id, &measured, locals, &Noise::default()));
        match order(&model.row_replicate(id, &measured, locals, rng), &measured) {
            Ordering::Less => self.below += 1.0,
            Ordering::Equal => self.equal += 1.0,
            Ordering::Greater => {}
        }
    }

    fn predicted(&self, model: &Model, id: RowId, rng: &mut ChaCha8Rng) -> Predicted {
        let cells = model.measured_row(id);
        let measured = cells.iter().sum::<f64>() / cells.len() as f64;
        let u: f64 = rng.random();
        Predicted {
            table_row: model.table_row(id),
            value: self.value / self.n,
            measured: if measured.is_finite() { measured } else { f64::NAN },
            ln_density: ln_mean_exp(&self.ln),
            quantile: (self.below + u * (self.equal + 1.0)) / (self.n + 1.0),
        }
    }
}

/// How well measurements were predicted.
#[derive(Clone, Copy, Debug)]
pub struct Score {
    /// Root mean squared difference between the predicted value and the middle of what was
    /// measured.
    pub rmse: f64,
    /// Sum of log predictive densities.
    pub elpd: f64,
    /// Share of measurements inside their central 90 % predictive interval.
    pub coverage90: f64,
    /// Number of measurements.
    pub n: usize,
}

/// The score of those predictions whose rows were measured.
pub fn score_of(predicted: &[Predicted]) -> Score {
    let n = predicted.len();
    let errors: Vec<f64> = predicted
        .iter()
        .map(|p| (p.value - p.measured).powi(2))
        .filter(|square| square.is_finite())
        .collect();
    let inside = predicted.iter().filter(|p| (0.05..=0.95).contains(&p.quantile)).count();
    Score {
        rmse: (errors.iter().sum::<f64>() / errors.len() as f64).sqrt(),
        elpd: predicted.iter().map(|p| p.ln_density).sum(),
        coverage90: inside as f64 / n as f64,
        n,
    }
}
