//! Priors of parameters. Each has the transform that takes its support to the real line.
//!
//! A model file writes a prior as `Normal(0.0, 10.0)`. This calls a function that has the name of
//! the prior's type. Its arguments are numbers or earlier parameters.

use rand::Rng;

use crate::num::Real;

/// Where a prior has mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Support {
    /// All real numbers.
    Real,
    /// The positive half-line.
    Positive,
    /// An open interval; an end may be infinite.
    Interval(f64, f64),
    /// An interval whose ends depend on other parameters.
    Between,
    /// Vectors of positive numbers whose sum is 1.
    Simplex,
    /// Vectors of increasing numbers.
    Ordered,
    /// Other vectors, in a few words.
    Described(&'static str),
}

/// A prior: the transform of its support, and its density in the unconstrained coordinate `u`.
///
/// With `x = constrain(u)` the log density of `u` is `ln p(x) + ln |dx/du| = ln_kernel + ln_norm`.
/// The two parts are separate because `ln_norm` is a constant if the prior's own parameters are
/// constants.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a prior",
    label = "expected a prior such as Normal(0.0, 1.0), HalfNormal(5.0), InvGamma(1.0, 5.0), Flat; a vector `param p(3)` also takes Dirichlet(1.0) and Ordered(Normal(0.0, 1.0))"
)]
pub trait Dist<D: Real> {
    /// The support at the prior's current parameters.
    fn support(&self) -> Support {
        Support::Real
    }
    /// `x` from the unconstrained `u`.
    fn constrain(&self, u: D) -> D {
        u
    }
    /// `u` from `x` inside the support.
    fn unconstrain(&self, x: f64) -> f64 {
        x
    }
    /// `ln p(x) + ln |dx/du|` without the terms that depend on the prior's parameters alone.
    fn ln_kernel(&self, u: D, x: D) -> D;
    /// What [`Dist::ln_kernel`] leaves out.
    fn ln_norm(&self) -> D;
    /// A typical value, from which the search for a starting point sets out.
    fn centre(&self) -> f64;
    /// A draw. `None` where none can be made: the prior is improper, or its parameters are out of
    /// range.
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let _ = rng;
        None
    }
    /// If the prior is normal or flat, the prior of `x` as a linear function of a Gaussian
    /// coefficient.
    fn gaussian(&self) -> Option<Gaussian> {
        None
    }
    /// For a normal prior, the `x` that is this far from the mean in standard deviations. The
    /// density of this distance does not depend on the prior's own parameters.
    fn at_deviation(&self, _: D) -> Option<D> {
        None
    }
    /// Whether the density is constant (an improper prior).
    fn is_flat(&self) -> bool {
        self.gaussian().is_some_and(|prior| prior.precision == 0.0)
    }
}

/// `x = location + scale w`. The coefficient w is normal with mean 0 and this precision, or flat if
/// the precision is 0.
#[derive(Clone, Copy, Debug)]
pub struct Gaussian {
    /// The mean, in the unit of x.
    pub location: f64,
    /// The standard deviation; 1 if it is flat.
    pub scale: f64,
    /// 1, or 0 if it is flat.
    pub precision: f64,
}

/// Transform of the positive half-line: `x = eᵘ`.
macro_rules! positive {
    () => {
        fn support(&self) -> Support {
            Support::Positive
        }
        #[inline]
        fn constrain(&self, u: D) -> D {
            u.exp()
        }
        fn unconstrain(&self, x: f64) -> f64 {
            x.ln()
        }
    };
}

/// A struct with its parameters and a function of the same name that takes numbers or parameters.
macro_rules! family {
    ($($(#[$doc:meta])* $T:ident ( $($a:ident : $what:literal),* );)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $T<D> { $(#[doc = $what] pub $a: D),* }

        $(#[$doc])*
        #[allow(non_snake_case)]
        #[inline]
        pub fn $T<D: Real>($($a: impl crate::num::Argument<D>),*) -> $T<D> {
            $T { $($a: crate::num::Argument::number($a)),* }
        }
    )*};
}

mod bounded;
mod interval;
mod normal_cdf;
mod positive;
mod real;
mod sequence;
mod special;
mod tails;
#[cfg(test)]
mod tests;

pub use bounded::{FlatBetween, FlatPositive, TruncatedNormal};
pub use interval::{Beta, Uniform};
pub(crate) use normal_cdf::{between, carried, ln_normal_below, ln_normal_between};
pub use positive::{Exponential, Gamma, HalfCauchy, HalfNormal, InvGamma, LogNormal};
pub use real::{Flat, Normal, StudentT};
pub use sequence::{
    CholeskyFactor, CorrelationRows, CovarianceMatrix, Dirichlet, LkjCholesky, MultivariateNormal,
    OfNumbers, OfVector, OneOrEach, Ordered, RealLine, Sequence, Step, SumToZero, Vector,
    VectorPrior, cholesky, correlation_cholesky, vector,
};
pub use special::{ln_gamma, ln_logistic, logistic};
pub use tails::{Cauchy, HalfStudentT, Laplace};
