//! The unknown behind a parameter: which number of the whole line a sampler moves.

use crate::dist::{Dist, Gaussian};
use crate::num::{LN_SQRT_2PI, Num, Real};

/// How an unknown `u` makes a parameter `x`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coordinate {
    /// Whether the prior's normaliser is no constant: its own parameters are parameters.
    has_norm: bool,
    /// Whether `u` is the deviation from a normal prior's mean in units of its sd. Its density knows nothing
    /// of either, so that a small sd does not squeeze the space that is sampled.
    is_deviation: bool,
}

impl Coordinate {
    /// That of the prior's support.
    pub(super) fn of_support(has_norm: bool) -> Self {
        Self { has_norm, is_deviation: false }
    }

    /// Deviations, if this prior is normal and its mean or sd a parameter.
    pub(super) fn deviating(self, dist: &impl Dist<Num<f64>>) -> Self {
        Self { is_deviation: self.has_norm && dist.at_deviation(Num(0.0)).is_some(), ..self }
    }

    /// Whether the unknown is a deviation.
    pub(super) fn is_deviation(self) -> bool {
        self.is_deviation
    }

    /// The parameter.
    #[inline]
    pub(super) fn x<D: Real>(self, dist: &impl Dist<Num<D>>, u: Num<D>) -> Num<D> {
        let deviation = if self.is_deviation { dist.at_deviation(u) } else { None };
        deviation.unwrap_or_else(|| dist.constrain(u))
    }

    /// The unknown.
    pub(super) fn u(self, dist: &impl Dist<Num<f64>>, x: f64) -> f64 {
        match dist.gaussian().filter(|_| self.is_deviation) {
            Some(Gaussian { location, scale, .. }) => (x - location) / scale,
            None => dist.unconstrain(x),
        }
    }

    /// Log density of the unknown, without a normaliser that is a constant.
    #[inline]
    pub(super) fn ln_prior<D: Real>(
        self,
        dist: &impl Dist<Num<D>>,
        u: Num<D>,
        x: Num<D>,
    ) -> Num<D> {
        if self.is_deviation {
            return u * u * -0.5 - LN_SQRT_2PI;
        }
        let l = dist.ln_kernel(u, x);
        if self.has_norm { l + dist.ln_norm() } else { l }
    }
}
