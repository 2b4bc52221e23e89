//! Priors on an interval, made by the logistic function.

use rand::{Rng, RngExt};
use rand_distr::Open01;

use super::{Dist, Support, ln_gamma, ln_logistic, logistic};
use crate::num::Real;

family! {
    /// Uniform distribution on `(lower, upper)`.
    Uniform(lower: "lower end", upper: "upper end");
    /// Beta distribution on (0, 1): density `x^(a−1) (1−x)^(b−1) / B(a, b)`.
    Beta(a: "first shape", b: "second shape");
}

impl<D: Real> Dist<D> for Uniform<D> {
    fn support(&self) -> Support {
        Support::Interval(self.lower.re(), self.upper.re())
    }
    #[inline]
    fn constrain(&self, u: D) -> D {
        self.lower + (self.upper - self.lower) * logistic(u)
    }
    fn unconstrain(&self, x: f64) -> f64 {
        ((x - self.lower.re()) / (self.upper.re() - x)).ln()
    }
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        ln_logistic(u) + ln_logistic(-u) // the width of the density and of the Jacobian cancel
    }
    fn ln_norm(&self) -> D {
        D::from(0.0)
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let p: f64 = rng.sample(Open01);
        Some(self.lower.re() + (self.upper.re() - self.lower.re()) * p)
    }
    fn centre(&self) -> f64 {
        0.5 * (self.lower.re() + self.upper.re())
    }
}

impl<D: Real> Dist<D> for Beta<D> {
    fn support(&self) -> Support {
        Support::Interval(0.0, 1.0)
    }
    #[inline]
    fn constrain(&self, u: D) -> D {
        logistic(u)
    }
    fn unconstrain(&self, x: f64) -> f64 {
        (x / (1.0 - x)).ln()
    }
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        self.a * ln_logistic(u) + self.b * ln_logistic(-u)
    }
    fn ln_norm(&self) -> D {
        ln_gamma(self.a + self.b) - ln_gamma(self.a) - ln_gamma(self.b)
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let beta = rand_distr::Beta::new(self.a.re(), self.b.re()).ok()?;
        Some(rng.sample(beta))
    }
    fn centre(&self) -> f64 {
        (self.a / (self.a + self.b)).re()
    }
}
