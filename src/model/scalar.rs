//! Scalar expressions over parameters: a field's mean and amplitudes.

use std::marker::PhantomData;

use super::expansion::ScalarFn;
use super::scope::Local;
use super::tape::Bent;
use crate::num::{Dual, Num};

/// A scalar of the value vector.
pub(super) trait Scalar: Bent + Send + Sync + std::fmt::Debug {
    fn value(&self, v: &[f64]) -> f64;
    /// Carries the adjoint `bar` of the value on.
    fn pull(&self, v: &[f64], bar: f64, g: &mut [f64]);
    /// The values that it depends on.
    fn mentions(&self) -> Vec<usize>;
}

#[derive(Debug)]
pub(super) struct ScalarAt<F, const N: usize> {
    pub(super) local: Local<N>,
    pub(super) f: PhantomData<F>,
}

impl<F: ScalarFn<N>, const N: usize> Scalar for ScalarAt<F, N> {
    fn value(&self, v: &[f64]) -> f64 {
        F::value(self.local.plain(v)).0
    }
    fn pull(&self, v: &[f64], bar: f64, g: &mut [f64]) {
        let x: Num<Dual<N>> = F::value(self.local.dual(v));
        self.local.scatter(&(x * bar), g);
    }
    fn mentions(&self) -> Vec<usize> {
        self.local.places()
    }
}
