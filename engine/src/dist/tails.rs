//! Priors with heavy tails: Cauchy, half Student's t, Laplace.

use rand::{Rng, RngExt};
use rand_distr::Open01;

use super::{Dist, StudentT, Support};
use crate::num::Real;

family! {
    /// Cauchy distribution: density `1 / (π scale (1 + z²))`, `z = (x − mu)/scale`.
    Cauchy(mu: "location", scale: "half width at half maximum");
    /// Student's t with `nu` degrees of freedom folded at zero: density `2 StudentT(x; nu, 0, sd)` for
    /// `x > 0`.
    HalfStudentT(nu: "degrees of freedom", sd: "scale of the unfolded distribution");
    /// Laplace or double exponential distribution: density `e^(−|x − mu|/scale) / (2 scale)`.
    Laplace(mu: "location", scale: "mean distance from it");
}

impl<D: Real> Dist<D> for Cauchy<D> {
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        let z = (u - self.mu) / self.scale;
        -(z * z).ln_1p()
    }
    fn ln_norm(&self) -> D {
        -(self.scale * std::f64::consts::PI).ln()
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let p: f64 = rng.sample(Open01);
        Some(self.mu.re() + self.scale.re() * (std::f64::consts::PI * (p - 0.5)).tan())
    }
    fn centre(&self) -> f64 {
        self.mu.re()
    }
}

impl<D: Real> HalfStudentT<D> {
    fn unfolded(&self) -> StudentT<D> {
        StudentT { nu: self.nu, mu: D::from(0.0), sd: self.sd }
    }
}

impl<D: Real> Dist<D> for HalfStudentT<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, x: D) -> D {
        self.unfolded().ln_kernel(x, x) + u
    }
    fn ln_norm(&self) -> D {
        self.unfolded().ln_norm() + std::f64::consts::LN_2
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        self.unfolded().sample(rng).map(f64::abs)
    }
    fn centre(&self) -> f64 {
        self.sd.re()
    }
}

impl<D: Real> Dist<D> for Laplace<D> {
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        -(u - self.mu).abs() / self.scale
    }
    fn ln_norm(&self) -> D {
        -(self.scale * 2.0).ln()
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let p: f64 = rng.sample(Open01);
        let distance = -(1.0 - 2.0 * (p - 0.5).abs()).ln();
        Some(self.mu.re() + self.scale.re() * distance.copysign(p - 0.5))
    }
    fn centre(&self) -> f64 {
        self.mu.re()
    }
}
