//! Normal numbers with a covariance matrix.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::{CholeskyFactor, OneOrEach, Sequence, Step, cholesky, of_each};
use crate::dist::Support;
use crate::num::{Argument, LN_SQRT_2PI, Real};

/// Normal distribution of N numbers with covariance `C = L Lᵀ`:
/// `−½ |z|² − Σ ln Lᵢᵢ − N ln √(2π)`, `L z = x − mean`.
#[derive(Clone, Copy, Debug)]
pub struct MultivariateNormal<D, const N: usize, const M: usize> {
    /// One mean for all numbers (M = 1), or one for each (M = N).
    mean: [D; M],
    /// L.
    factor: CholeskyFactor<D, N>,
}

/// `MultivariateNormal(mean, covariance)`, the mean one number for all or one for each.
///
/// The covariance is either a matrix of numbers or parameters, `[[4.0, 1.0], [1.0, 2.0]]`, or a
/// Cholesky factor. A factor is written `correlation_cholesky(l).scaled(sd)`, with a parameter `l`
/// whose prior is [`LkjCholesky`](super::LkjCholesky) and with standard deviations `sd`, one for
/// all or one for each.
///
/// Each number is an unknown of its own. If data say little about each number but much about `sd`,
/// write `param z(3) ~ Normal(0.0, 1.0)` and use `correlation_cholesky(l).scaled(sd).times(z)`
/// instead.
#[allow(non_snake_case)]
pub fn MultivariateNormal<D: Real, const N: usize, const M: usize, K>(
    mean: impl OneOrEach<D, M, K>,
    covariance: impl CovarianceMatrix<D, N>,
) -> MultivariateNormal<D, N, M> {
    const { assert!(M == 1 || M == N, "one mean, or as many as the covariance has rows") };
    MultivariateNormal { mean: mean.each(), factor: covariance.factor() }
}

/// What [`fn@MultivariateNormal`] takes as a covariance.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a covariance of {N} numbers",
    label = "expected a matrix [[4.0, 1.0], [1.0, 2.0]] or correlation_cholesky(l).scaled(sd)"
)]
pub trait CovarianceMatrix<D, const N: usize> {
    /// Its Cholesky factor.
    fn factor(self) -> CholeskyFactor<D, N>;
}

impl<D, const N: usize> CovarianceMatrix<D, N> for CholeskyFactor<D, N> {
    fn factor(self) -> Self {
        self
    }
}

impl<D: Real, T: Argument<D>, const N: usize> CovarianceMatrix<D, N> for [[T; N]; N] {
    fn factor(self) -> CholeskyFactor<D, N> {
        cholesky(self)
    }
}

impl<D: Real, const N: usize, const M: usize> MultivariateNormal<D, N, M> {
    /// `Lᵢᵢ zᵢ`: what is left of `x − mean` if `z` is known before i.
    fn rest(&self, i: usize, x: D, z: &[D]) -> D {
        let row = &self.factor[i];
        let start = x - of_each(&self.mean, i);
        row[..i].iter().zip(z).fold(start, |rest, (l, z)| rest - *l * *z)
    }
}

/// The carry is z, number by number.
impl<D: Real, const N: usize, const M: usize> Sequence<D> for MultivariateNormal<D, N, M> {
    fn support(&self) -> Support {
        Support::Real
    }
    fn length(&self, _: usize) -> usize {
        N
    }
    fn n_carry(&self, n: usize) -> usize {
        n
    }
    fn step(&self, i: usize, _: usize, u: D, carry: &mut [D]) -> Step<D> {
        let z = self.rest(i, u, carry) / self.factor[i][i];
        carry[i] = z;
        Step { x: u, ln_kernel: z * z * -0.5 }
    }
    fn unconstrain(&self, _: usize, _: usize, x: f64, _: &[f64]) -> f64 {
        x
    }
    fn ln_norm(&self, n: usize) -> D {
        (0..n).fold(D::from(0.0), |sum, i| sum - self.factor[i][i].ln() - LN_SQRT_2PI)
    }
    fn initial(&self, i: usize) -> f64 {
        of_each(&self.mean, i).re()
    }
    fn sample(&self, n: usize, rng: &mut dyn Rng) -> Option<Vec<f64>> {
        let z: Vec<f64> = (0..n).map(|_| rng.sample(StandardNormal)).collect();
        let number = |i: usize| {
            let row = self.factor[i][..=i].iter().zip(&z);
            row.fold(of_each(&self.mean, i).re(), |sum, (l, z)| sum + l.re() * z)
        };
        let x: Vec<f64> = (0..n).map(number).collect();
        Some(x).filter(|x| x.iter().all(|x| x.is_finite()))
    }
}
