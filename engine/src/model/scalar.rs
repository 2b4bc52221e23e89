//! Scalar expressions over parameters: a field's mean and amplitudes.

use super::functions::ScalarFn;
use super::scope::Local;
use super::tape::{Bent, Tape};
use crate::num::{Dual, Num};

/// A scalar of the value vector.
pub(super) trait Scalar: Bent + Send + Sync {
    fn value(&self, v: &[f64]) -> f64;
    /// Carries the adjoint `bar` of the value to what it depends on.
    fn pull(&self, v: &[f64], bar: f64, g: &mut [f64]);
    /// The values that it depends on.
    fn mentions(&self) -> Vec<usize>;
}

pub(super) struct ScalarAt<F, const N: usize> {
    pub(super) local: Local<N>,
    pub(super) f: F,
}

impl<F: ScalarFn<N>, const N: usize> Scalar for ScalarAt<F, N> {
    fn value(&self, v: &[f64]) -> f64 {
        self.f.value(self.local.plain(v)).0
    }
    fn pull(&self, v: &[f64], bar: f64, g: &mut [f64]) {
        let x: Num<Dual<N>> = self.f.value(self.local.dual(v));
        self.local.scatter(&(x * bar), g);
    }
    fn mentions(&self) -> Vec<usize> {
        self.local.places()
    }
}

/// A plain number in the model file.
pub(super) struct Constant(pub(super) f64);

impl Scalar for Constant {
    fn value(&self, _: &[f64]) -> f64 {
        self.0
    }
    fn pull(&self, _: &[f64], _: f64, _: &mut [f64]) {}
    fn mentions(&self) -> Vec<usize> {
        vec![]
    }
}

impl Bent for Constant {
    fn bend(&self, _: &Tape, _: &[f64], _: &[f64], _: &mut Tape) {}
}

/// A parameter and nothing else.
pub(super) struct Lone(pub(super) usize);

impl Scalar for Lone {
    fn value(&self, v: &[f64]) -> f64 {
        v[self.0]
    }
    fn pull(&self, _: &[f64], bar: f64, g: &mut [f64]) {
        g[self.0] += bar;
    }
    fn mentions(&self) -> Vec<usize> {
        vec![self.0]
    }
}

impl Bent for Lone {
    fn bend(&self, _: &Tape, _: &[f64], _: &[f64], _: &mut Tape) {}
}
