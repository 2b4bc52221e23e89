//! Priors on the whole real line: flat, normal, Student's t.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::{Dist, Gaussian, ln_gamma};
use crate::num::{LN_SQRT_2PI, Real};

/// The improper constant density on the real line.
#[derive(Clone, Copy, Debug)]
pub struct Flat;

family! {
    /// Normal distribution: `−z²/2 − ln sd − ½ ln 2π`, `z = (x − mu)/sd`.
    Normal(mu: "mean", sd: "standard deviation");
    /// Student's t with `nu` degrees of freedom, location `mu` and scale `sd`.
    StudentT(nu: "degrees of freedom", mu: "location", sd: "scale");
}

impl<D: Real> Dist<D> for Flat {
    fn ln_kernel(&self, _: D, _: D) -> D {
        D::from(0.0)
    }
    fn ln_norm(&self) -> D {
        D::from(0.0)
    }
    fn centre(&self) -> f64 {
        0.0
    }
    fn gaussian(&self) -> Option<Gaussian> {
        Some(Gaussian { location: 0.0, scale: 1.0, precision: 0.0 })
    }
}

impl<D: Real> Dist<D> for Normal<D> {
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        let z = (u - self.mu) / self.sd;
        z * z * -0.5
    }
    #[inline]
    fn ln_norm(&self) -> D {
        -self.sd.ln() - LN_SQRT_2PI
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        Some(self.mu.re() + self.sd.re() * rng.sample::<f64, _>(StandardNormal))
    }
    fn gaussian(&self) -> Option<Gaussian> {
        Some(Gaussian { location: self.mu.re(), scale: self.sd.re(), precision: 1.0 })
    }
    fn at_deviation(&self, z: D) -> Option<D> {
        Some(self.mu + self.sd * z)
    }
    fn centre(&self) -> f64 {
        self.mu.re()
    }
}

impl<D: Real> Dist<D> for StudentT<D> {
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        let z = (u - self.mu) / self.sd;
        (self.nu + 1.0) * -0.5 * (z * z / self.nu).ln_1p()
    }
    fn ln_norm(&self) -> D {
        let half = self.nu * 0.5;
        ln_gamma(half + 0.5)
            - ln_gamma(half)
            - (self.nu * std::f64::consts::PI).ln() * 0.5
            - self.sd.ln()
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let unit = rand_distr::StudentT::new(self.nu.re()).ok()?;
        Some(self.mu.re() + self.sd.re() * rng.sample(unit))
    }
    fn centre(&self) -> f64 {
        self.mu.re()
    }
}
