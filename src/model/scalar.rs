//! Scalar expressions over parameters: a field's mean and amplitudes.

use std::marker::PhantomData;

use super::scope::Local;
use super::tape::Bent;
use crate::num::{Dual, Real};

/// A scalar as a function of the names in its scope.
pub trait ScalarFn: Send + Sync + std::fmt::Debug {
    /// The value at the scope's scalars.
    fn value<D: Real>(s: &[D]) -> D;
}

/// A scalar of the value vector.
pub(super) trait Scalar: Bent + Send + Sync + std::fmt::Debug {
    fn value(&self, v: &[f64]) -> f64;
    /// Carries the adjoint `bar` of the value on.
    fn pull(&self, v: &[f64], bar: f64, g: &mut [f64]);
    /// The values that it depends on.
    fn mentions(&self) -> Vec<usize>;
}

#[derive(Debug)]
pub(super) struct ScalarAt<F, const N: usize, const W: usize> {
    pub(super) local: Local<N, W>,
    pub(super) f: PhantomData<F>,
}

impl<F: ScalarFn, const N: usize, const W: usize> Scalar for ScalarAt<F, N, W> {
    fn value(&self, v: &[f64]) -> f64 {
        F::value::<f64>(&self.local.plain(v))
    }
    fn pull(&self, v: &[f64], bar: f64, g: &mut [f64]) {
        let x: Dual<W> = F::value(&self.local.dual(v));
        self.local.scatter(&(x * bar), g);
    }
    fn mentions(&self) -> Vec<usize> {
        self.local.mentioned()
    }
}
