//! The unknown behind a parameter: the number that a sampler moves, which may be any real number.

use crate::dist::{Dist, Gaussian};
use crate::num::{LN_SQRT_2PI, Num, Real};

/// How a parameter `x` is computed from its unknown `u`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coordinate {
    /// Whether the normaliser of the prior varies, because the prior's own parameters are
    /// parameters of the model.
    has_norm: bool,
    /// Whether `u` is the deviation from the mean of a normal prior, in units of its sd. The
    /// density of `u` then depends on neither, so that a small sd does not squeeze the space that
    /// is sampled.
    is_deviation: bool,
}

impl Coordinate {
    /// The coordinate that belongs to the prior's support.
    pub(super) fn of_support(has_norm: bool) -> Self {
        Self { has_norm, is_deviation: false }
    }

    /// The deviation, if this prior is normal and its mean or sd is a parameter.
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

    /// Log density of the unknown. The normaliser is left out if it is a constant.
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
