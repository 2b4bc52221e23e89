//! Priors of whole vectors, whose numbers depend on each other.
//!
//! Such a vector is made one number after the other. Each number comes from an unknown of its own,
//! and from the *carry*: what the numbers before it leave behind.

use rand::Rng;

use super::Support;
use crate::num::{Argument, Real};

mod cholesky;
mod dirichlet;
mod lkj;
mod multivariate_normal;
mod ordered;
mod sum_to_zero;
#[cfg(test)]
mod tests;
mod vector;

pub use cholesky::{CholeskyFactor, CorrelationRows, cholesky, correlation_cholesky};
pub use dirichlet::Dirichlet;
pub use lkj::LkjCholesky;
pub use multivariate_normal::{CovarianceMatrix, MultivariateNormal};
pub use ordered::{Ordered, RealLine};
pub use sum_to_zero::SumToZero;
pub use vector::{OfNumbers, OfVector, Vector, VectorPrior, vector};

/// One number of a vector, from its unknown `u` and from what the numbers before it left.
#[derive(Clone, Copy, Debug)]
pub struct Step<D> {
    /// The number.
    pub x: D,
    /// Its part of the log density of the unknowns, without [`Sequence::ln_norm`].
    pub ln_kernel: D,
}

/// A prior of a whole vector of `n` numbers, with the transform that makes it number by number.
///
/// ```text
/// ln p(u) = ln p(x) + ln |det dx/du| = Σᵢ ln_kernel(i) + ln_norm(n)
/// ```
/// Between numbers it keeps the *carry*: one number or a few, all of them [`Sequence::begin`] at
/// first, which [`Sequence::step`] reads and changes. Numbers without an unknown, which come last,
/// are the first number of the carry that is left.
///
/// A model file may hold a prior of its own:
///
/// ```
/// # extern crate eplat_engine as eplat;
/// use eplat::prelude::*;
///
/// /// A random walk: each number is normal about the one before, the first about zero.
/// #[derive(Debug)]
/// struct Walk<D> {
///     step: D,
/// }
///
/// #[allow(non_snake_case)]
/// fn Walk<D: Real>(step: impl Argument<D>) -> Walk<D> {
///     Walk { step: step.number() }
/// }
///
/// impl<D: Real> Sequence<D> for Walk<D> {
///     fn support(&self) -> Support {
///         Support::Real
///     }
///     fn step(&self, _: usize, _: usize, u: D, carry: &mut [D]) -> Step<D> {
///         let z = (u - carry[0]) / self.step;
///         carry[0] = u;
///         Step { x: u, ln_kernel: z * z * -0.5 }
///     }
///     fn unconstrain(&self, _: usize, _: usize, x: f64, _: &[f64]) -> f64 {
///         x
///     }
///     fn ln_norm(&self, n: usize) -> D {
///         (self.step.ln() + 0.5 * std::f64::consts::TAU.ln()) * -(n as f64)
///     }
/// }
///
/// model! {
///     model Drift;
///     param step [ms] ~ HalfNormal(5.0);
///     param level(6) [ms] ~ Walk(step);
///     observe seen(row): Number [ms] ~ Normal(level[0] + level[5], 1.0);
/// }
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a prior of a vector",
    label = "expected Dirichlet(1.0), Ordered(Normal(0.0, 1.0)), MultivariateNormal(0.0, covariance), LkjCholesky(2.0) or SumToZero(1.0)"
)]
pub trait Sequence<D: Real> {
    /// Where the vector lies. [`Support::Real`] promises that each number is its own unknown.
    fn support(&self) -> Support;
    /// How many unknowns `n` numbers have.
    fn n_unknowns(&self, n: usize) -> usize {
        n
    }
    /// `n` if it can be a prior of `n` numbers, otherwise how many it could be a prior of.
    fn length(&self, n: usize) -> usize {
        n
    }
    /// How many numbers the carry of `n` numbers is: at least 1.
    fn n_carry(&self, n: usize) -> usize {
        let _ = n;
        1
    }
    /// Every number of the carry before the first step.
    fn begin(&self) -> f64 {
        0.0
    }
    /// Number `i` of `n` from its unknown `u`; leaves the carry of the next number in `carry`.
    fn step(&self, i: usize, n: usize, u: D, carry: &mut [D]) -> Step<D>;
    /// The unknown behind number `i` of `n`, if it is `x` and finds this carry.
    fn unconstrain(&self, i: usize, n: usize, x: f64, carry: &[f64]) -> f64;
    /// What [`Step::ln_kernel`] leaves out: a function of the prior's own parameters.
    fn ln_norm(&self, n: usize) -> D;
    /// A typical unknown behind number `i`, from which the search for a starting point sets out.
    fn initial(&self, i: usize) -> f64 {
        let _ = i;
        0.0
    }
    /// `n` numbers drawn; `None` where there is no sampler, or parameters are out of range.
    fn sample(&self, n: usize, rng: &mut dyn Rng) -> Option<Vec<f64>> {
        let _ = (n, rng);
        None
    }
}

/// One number for all numbers of a vector (`N` = 1), or one for each: `2.0`, `[1.0, 2.0, 5.0]`, or
/// earlier parameters. `M` tells one from several apart.
pub trait OneOrEach<D, const N: usize, M> {
    /// As N numbers.
    fn each(self) -> [D; N];
}

impl<D, T: Argument<D>> OneOrEach<D, 1, ()> for T {
    fn each(self) -> [D; 1] {
        [self.number()]
    }
}

impl<D, T: Argument<D>, const N: usize> OneOrEach<D, N, [(); N]> for [T; N] {
    fn each(self) -> [D; N] {
        self.map(Argument::number)
    }
}

/// Number `i` of what a [`OneOrEach`] gave.
fn of_each<D: Copy, const N: usize>(numbers: &[D; N], i: usize) -> D {
    numbers[if N == 1 { 0 } else { i }]
}
