//! Two kinds of priors may stand behind a vector: a prior of each of its numbers, or one of the
//! vector as a whole.
//!
//! A model file writes both in the same way: `param w(3) ~ Normal(0.0, 1.0)` and `param share(3) ~
//! Dirichlet(1.0)`. The type of the prior tells them apart, so a prior of a user's own needs no
//! keyword.

use rand::Rng;

use super::{Sequence, Step};
use crate::dist::{Dist, Support};
use crate::num::Real;

/// A [`Dist`] (`Kind` = [`OfNumbers`]) or a [`Sequence`] (`Kind` = [`OfVector`]).
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a prior",
    label = "expected a prior of each number, such as Normal(0.0, 1.0), or of the vector, such as Dirichlet(1.0) or Ordered(Normal(0.0, 1.0))"
)]
pub trait VectorPrior<D: Real, Kind> {
    /// The prior with its kind.
    type Vector: Vector<D>;
    /// The prior together with its kind.
    fn vector(self) -> Self::Vector;
}

/// A prior that says itself of which kind it is. Only the one of [`Vector::of_numbers`] and
/// [`Vector::of_vector`] that fits its kind may be called.
pub trait Vector<D: Real> {
    /// Whether it is a prior of the whole vector.
    const IS_WHOLE: bool;
    /// The prior of each number.
    fn of_numbers(self) -> impl Dist<D>;
    /// The prior of the vector.
    fn of_vector(self) -> impl Sequence<D>;
}

/// A prior of each number of a vector.
#[derive(Clone, Copy, Debug)]
pub struct OfNumbers<T>(T);

/// A prior of a vector as a whole.
#[derive(Clone, Copy, Debug)]
pub struct OfVector<T>(T);

impl<D: Real, T: Dist<D>> VectorPrior<D, OfNumbers<()>> for T {
    type Vector = OfNumbers<T>;
    fn vector(self) -> OfNumbers<T> {
        OfNumbers(self)
    }
}

impl<D: Real, T: Sequence<D>> VectorPrior<D, OfVector<()>> for T {
    type Vector = OfVector<T>;
    fn vector(self) -> OfVector<T> {
        OfVector(self)
    }
}

/// A prior with its kind: what the `model!` macro writes around the prior of a vector.
pub fn vector<D: Real, Kind, T: VectorPrior<D, Kind>>(prior: T) -> T::Vector {
    prior.vector()
}

impl<D: Real, T: Dist<D>> Vector<D> for OfNumbers<T> {
    const IS_WHOLE: bool = false;
    fn of_numbers(self) -> impl Dist<D> {
        self.0
    }
    fn of_vector(self) -> impl Sequence<D> {
        Other
    }
}

impl<D: Real, T: Sequence<D>> Vector<D> for OfVector<T> {
    const IS_WHOLE: bool = true;
    fn of_numbers(self) -> impl Dist<D> {
        Other
    }
    fn of_vector(self) -> impl Sequence<D> {
        self.0
    }
}

/// A placeholder for the kind that a prior is not of. It is never evaluated.
#[derive(Clone, Copy, Debug)]
struct Other;

impl<D: Real> Dist<D> for Other {
    fn ln_kernel(&self, _: D, _: D) -> D {
        D::from(f64::NAN)
    }
    fn ln_norm(&self) -> D {
        D::from(f64::NAN)
    }
    fn centre(&self) -> f64 {
        f64::NAN
    }
}

impl<D: Real> Sequence<D> for Other {
    fn support(&self) -> Support {
        Support::Real
    }
    fn step(&self, _: usize, _: usize, x: D, _: &mut [D]) -> Step<D> {
        Step { x, ln_kernel: D::from(f64::NAN) }
    }
    fn unconstrain(&self, _: usize, _: usize, x: f64, _: &[f64]) -> f64 {
        x
    }
    fn ln_norm(&self, _: usize) -> D {
        D::from(f64::NAN)
    }
    fn sample(&self, _: usize, _: &mut dyn Rng) -> Option<Vec<f64>> {
        None
    }
}
