//! Random-walk steps of the hyperparameters, shaped by the warm-up's draws.

use nalgebra::{Cholesky, DMatrix};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// Normal steps with the covariance of the posterior, at several lengths in turn.
#[derive(Clone, Debug)]
pub(super) struct Proposal {
    n: usize,
    /// Lower factor of the covariance, row-major.
    factor: Vec<f64>,
}

impl Proposal {
    /// Mean acceptance that the length is tuned to.
    pub(super) const TARGET: f64 = 0.3;
    /// Long steps find other regimes, short ones are accepted at the edge of one.
    const LENGTHS: [f64; 3] = [2.0, 0.4, 1.0];

    /// Independent steps with these scales.
    pub(super) fn new(scales: &[f64]) -> Self {
        let n = scales.len();
        let entry = |k: usize| if k.is_multiple_of(n + 1) { scales[k / n] } else { 0.0 };
        Self { n, factor: (0..n * n).map(entry).collect() }
    }

    /// Takes the covariance of these draws; what cannot be factorised changes nothing.
    pub(super) fn fit(&mut self, draws: &[Vec<f64>]) {
        /// Added to each variance: a hyperparameter that did not move must move.
        const FLOOR: f64 = 1e-3;
        let (n, count) = (self.n, draws.len() as f64);
        let mean: Vec<f64> =
            (0..n).map(|i| draws.iter().map(|h| h[i]).sum::<f64>() / count).collect();
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            let sum: f64 = draws.iter().map(|h| (h[i] - mean[i]) * (h[j] - mean[j])).sum();
            sum / count + if i == j { FLOOR } else { 0.0 }
        });
        if let Some(cholesky) = Cholesky::new(covariance) {
            let factor = cholesky.l();
            self.factor = (0..n * n).map(|k| factor[(k / n, k % n)]).collect();
        }
    }

    /// Writes the `k`-th step of a transition.
    pub(super) fn draw(&self, k: usize, length: f64, rng: &mut impl Rng, step: &mut [f64]) {
        let length = length * Self::LENGTHS[k % 3];
        step.fill(0.0);
        for j in 0..self.n {
            let x: f64 = rng.sample(StandardNormal);
            for i in j..self.n {
                step[i] += length * self.factor[i * self.n + j] * x;
            }
        }
    }
}
