//! Numbers in increasing order.

use rand::Rng;

use super::{Sequence, Step};
use crate::dist::{Cauchy, Dist, Laplace, Normal, StudentT, Support, ln_gamma};
use crate::num::Real;

/// A prior with mass on the whole real line, which [`Ordered`] takes.
#[diagnostic::on_unimplemented(
    message = "`Ordered` takes a prior on the real line, not `{Self}`",
    label = "expected Normal(mu, sd), StudentT(nu, mu, sd), Cauchy(mu, scale) or Laplace(mu, scale)"
)]
pub trait RealLine<D: Real>: Dist<D> {
    /// `ln p(x)`, for log densities written by hand.
    #[inline]
    fn ln_density(&self, x: D) -> D {
        self.ln_kernel(x, x) + self.ln_norm()
    }
}

impl<D: Real> RealLine<D> for Normal<D> {}
impl<D: Real> RealLine<D> for StudentT<D> {}
impl<D: Real> RealLine<D> for Cauchy<D> {}
impl<D: Real> RealLine<D> for Laplace<D> {}

/// Numbers with one prior, in increasing order: density `n! Π p(xᵢ)` where `x₀ < x₁ < …`.
///
/// `x₀ = u₀`, `xᵢ = xᵢ₋₁ + e^(uᵢ)`.
#[derive(Clone, Copy, Debug)]
pub struct Ordered<T>(
    /// The prior of each number.
    pub T,
);

impl<D: Real, T: RealLine<D>> Sequence<D> for Ordered<T> {
    fn support(&self) -> Support {
        Support::Ordered
    }
    fn length(&self, n: usize) -> usize {
        n.max(2)
    }
    fn step(&self, i: usize, _: usize, u: D, carry: &mut [D]) -> Step<D> {
        let (x, ln_jacobian) = if i == 0 { (u, D::from(0.0)) } else { (carry[0] + u.exp(), u) };
        carry[0] = x;
        Step { x, ln_kernel: self.0.ln_kernel(x, x) + ln_jacobian }
    }
    fn unconstrain(&self, i: usize, _: usize, x: f64, carry: &[f64]) -> f64 {
        if i == 0 { x } else { (x - carry[0]).ln() }
    }
    fn ln_norm(&self, n: usize) -> D {
        self.0.ln_norm() * n as f64 + ln_gamma(n as f64 + 1.0)
    }
    fn initial(&self, i: usize) -> f64 {
        if i == 0 { self.0.centre() } else { 0.0 }
    }
    fn sample(&self, n: usize, rng: &mut dyn Rng) -> Option<Vec<f64>> {
        let mut x: Vec<f64> = (0..n).map(|_| self.0.sample(rng)).collect::<Option<_>>()?;
        x.sort_by(f64::total_cmp);
        Some(x)
    }
}
