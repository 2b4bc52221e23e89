//! Priors of positive numbers, made by `x = eᵘ`.

use rand::{Rng, RngExt};
use rand_distr::{Exp1, Open01, StandardNormal};

use super::{Dist, Support, ln_gamma};
use crate::num::{LN_SQRT_2PI, Real};

family! {
    /// Normal distribution folded at zero: density `2 Normal(x; 0, sd)` for `x > 0`.
    HalfNormal(sd: "standard deviation of the unfolded normal");
    /// Cauchy distribution folded at zero: density `2 / (π scale (1 + (x/scale)²))` for `x > 0`.
    HalfCauchy(scale: "median");
    /// Gamma distribution: density `rateᵃ xᵃ⁻¹ e^(−rate x) / Γ(a)`, `a` = shape.
    Gamma(shape: "shape", rate: "rate, the inverse of the scale");
    /// Inverse gamma distribution: density `bᵃ x^(−a−1) e^(−b/x) / Γ(a)`, `a` = shape, `b` = scale.
    InvGamma(shape: "shape", scale: "scale");
    /// Exponential distribution: density `rate e^(−rate x)`.
    Exponential(rate: "rate, the inverse of the mean");
    /// Log-normal distribution: `ln x ~ Normal(mu, sd)`.
    LogNormal(mu: "mean of ln x", sd: "standard deviation of ln x");
}

impl<D: Real> Dist<D> for HalfNormal<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, x: D) -> D {
        let z = x / self.sd;
        z * z * -0.5 + u
    }
    #[inline]
    fn ln_norm(&self) -> D {
        -self.sd.ln() - LN_SQRT_2PI + std::f64::consts::LN_2
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        Some(self.sd.re() * rng.sample::<f64, _>(StandardNormal).abs())
    }
    fn centre(&self) -> f64 {
        self.sd.re()
    }
}

impl<D: Real> Dist<D> for HalfCauchy<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, x: D) -> D {
        let z = x / self.scale;
        u - (z * z).ln_1p()
    }
    #[inline]
    fn ln_norm(&self) -> D {
        -self.scale.ln() + std::f64::consts::FRAC_2_PI.ln()
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let p: f64 = rng.sample(Open01);
        Some(self.scale.re() * (std::f64::consts::FRAC_PI_2 * p).tan())
    }
    fn centre(&self) -> f64 {
        self.scale.re()
    }
}

impl<D: Real> Dist<D> for Gamma<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, x: D) -> D {
        self.shape * u - self.rate * x
    }
    fn ln_norm(&self) -> D {
        self.shape * self.rate.ln() - ln_gamma(self.shape)
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let unit = rand_distr::Gamma::new(self.shape.re(), 1.0).ok()?;
        Some(rng.sample(unit) / self.rate.re())
    }
    fn centre(&self) -> f64 {
        (self.shape / self.rate).re()
    }
}

impl<D: Real> Dist<D> for InvGamma<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, x: D) -> D {
        -(self.shape * u) - self.scale / x
    }
    fn ln_norm(&self) -> D {
        self.shape * self.scale.ln() - ln_gamma(self.shape)
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let unit = rand_distr::Gamma::new(self.shape.re(), 1.0).ok()?;
        Some(self.scale.re() / rng.sample(unit))
    }
    fn centre(&self) -> f64 {
        (self.scale / self.shape).re()
    }
}

impl<D: Real> Dist<D> for Exponential<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, x: D) -> D {
        u - self.rate * x
    }
    fn ln_norm(&self) -> D {
        self.rate.ln()
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        Some(rng.sample::<f64, _>(Exp1) / self.rate.re())
    }
    fn centre(&self) -> f64 {
        self.rate.recip().re()
    }
}

impl<D: Real> Dist<D> for LogNormal<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        let z = (u - self.mu) / self.sd;
        z * z * -0.5
    }
    fn ln_norm(&self) -> D {
        -self.sd.ln() - LN_SQRT_2PI
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        Some((self.mu.re() + self.sd.re() * rng.sample::<f64, _>(StandardNormal)).exp())
    }
    fn centre(&self) -> f64 {
        self.mu.re().exp()
    }
}
