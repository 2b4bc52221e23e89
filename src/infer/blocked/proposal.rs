//! Proposals for the hyperparameters, shaped by the warm-up's draws.

use nalgebra::{Cholesky, DMatrix};
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

/// Random-walk steps at several lengths and independent draws, in turn, with the mean and covariance
/// of the posterior.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Proposal {
    mean: Vec<f64>,
    /// Lower factor of the covariance, row-major.
    factor: Vec<f64>,
    /// Whether it knows the posterior well enough for independent draws.
    is_fitted: bool,
}

impl Proposal {
    /// Mean acceptance that the random walk's length is tuned to.
    pub(super) const TARGET: f64 = 0.3;
    /// Long steps find other regimes, short ones are accepted at the edge of one.
    const LENGTHS: [f64; 3] = [1.0, 2.0, 0.4];
    /// Degrees of freedom of independent draws: heavier tails than the posterior's.
    const NU: u32 = 5;

    /// Independent steps with these scales.
    pub(super) fn new(scales: &[f64]) -> Self {
        let n = scales.len();
        let entry = |k: usize| if k.is_multiple_of(n + 1) { scales[k / n] } else { 0.0 };
        Self { mean: vec![0.0; n], factor: (0..n * n).map(entry).collect(), is_fitted: false }
    }

    /// Takes mean and covariance of these draws; what cannot be factorised changes nothing.
    pub(super) fn fit(&mut self, draws: &[Vec<f64>]) {
        /// Added to each variance: a hyperparameter that did not move must move.
        const FLOOR: f64 = 1e-3;
        let (n, count) = (self.mean.len(), draws.len() as f64);
        let mean: Vec<f64> =
            (0..n).map(|i| draws.iter().map(|h| h[i]).sum::<f64>() / count).collect();
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            let sum: f64 = draws.iter().map(|h| (h[i] - mean[i]) * (h[j] - mean[j])).sum();
            sum / count + if i == j { FLOOR } else { 0.0 }
        });
        if let Some(cholesky) = Cholesky::new(covariance) {
            let factor = cholesky.l();
            self.factor = (0..n * n).map(|k| factor[(k / n, k % n)]).collect();
            self.mean = mean;
            self.is_fitted = true;
        }
    }

    /// Whether step `k` of a transition is a random-walk step, whose length adapts.
    pub(super) fn is_walk(&self, k: usize) -> bool {
        !self.is_fitted || k.is_multiple_of(2)
    }

    /// Writes the `k`-th proposal of a transition from `present`; returns the ln ratio of the
    /// densities of proposing the way back and the way there.
    pub(super) fn draw(
        &self,
        k: usize,
        length: f64,
        present: &[f64],
        rng: &mut impl Rng,
        proposed: &mut [f64],
    ) -> f64 {
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        if self.is_walk(k) {
            let length = length * Self::LENGTHS[(k / 2) % 3];
            proposed.copy_from_slice(present);
            self.add_step(proposed, || length * normal());
            return 0.0;
        }
        let there = self.distance(present, proposed);
        let chi_square: f64 = (0..Self::NU).map(|_| normal().powi(2)).sum();
        let scale = (f64::from(Self::NU) / chi_square).sqrt();
        proposed.copy_from_slice(&self.mean);
        let mut back = 0.0;
        self.add_step(proposed, || {
            let x = scale * normal();
            back += x * x;
            x
        });
        self.ln_student(there) - self.ln_student(back)
    }

    /// `h` += factor x
    fn add_step(&self, h: &mut [f64], mut x: impl FnMut() -> f64) {
        let n = h.len();
        for j in 0..n {
            let x = x();
            for (h, row) in h.iter_mut().zip(self.factor.chunks_exact(n)).skip(j) {
                *h += row[j] * x;
            }
        }
    }

    /// Squared distance of `h` from the mean, in units of the covariance.
    fn distance(&self, h: &[f64], scratch: &mut [f64]) -> f64 {
        let n = h.len();
        let mut squares = 0.0;
        for i in 0..n {
            let row = &self.factor[i * n..][..=i];
            let sum: f64 = row[..i].iter().zip(&*scratch).map(|(l, x)| l * x).sum();
            scratch[i] = (h[i] - self.mean[i] - sum) / row[i];
            squares += scratch[i] * scratch[i];
        }
        squares
    }

    /// ln of the density of independent draws at this squared distance, up to a constant.
    fn ln_student(&self, squares: f64) -> f64 {
        let nu = f64::from(Self::NU);
        -0.5 * (nu + self.mean.len() as f64) * (squares / nu).ln_1p()
    }
}
