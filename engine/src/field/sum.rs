//! Kernels that add.

use std::marker::PhantomData;
use std::ops::{Add, Mul};

use super::{Covariance, Kernel, Product};
use crate::num::Real;

/// The kernel `k₁ + k₂` of a sum of two independent fields: `S = S₁ + S₂`.
///
/// It is written `Rbf(a) + Matern32(b)`. Its variance is the sum of the variances: 2 for two
/// kernels that ship.
#[derive(Clone, Copy, Debug)]
pub struct Sum<D, A, B> {
    a: A,
    b: B,
    number: PhantomData<D>,
}

impl<D: Real, A: Kernel<D>, B: Kernel<D>> Sum<D, A, B> {
    /// `a + b`, where `a` is a kernel without operators of its own.
    #[inline(always)]
    pub fn new(a: A, b: B) -> Self {
        Self { a, b, number: PhantomData }
    }
}

impl<D: Real, A: Kernel<D>, B: Kernel<D>> Kernel<D> for Sum<D, A, B> {
    #[inline(always)]
    fn sqrt_density(&self, w: f64) -> D {
        let (a, b) = (self.a.sqrt_density(w), self.b.sqrt_density(w));
        // no square of a number that underflows: its root has no derivative
        let (small, large) = if a.re() < b.re() { (a, b) } else { (b, a) };
        if large.re() > 0.0 {
            let ratio = small / large;
            large * (ratio * ratio + 1.0).sqrt()
        } else {
            large
        }
    }
}

impl<D: Real, A: Covariance<D>, B: Covariance<D>> Covariance<D> for Sum<D, A, B> {
    fn covariance(&self, r: f64) -> D {
        self.a.covariance(r) + self.b.covariance(r)
    }
}

impl<D: Real, A: Kernel<D>, B: Kernel<D>, K: Kernel<D>> Add<K> for Sum<D, A, B> {
    type Output = Sum<D, Self, K>;
    fn add(self, other: K) -> Self::Output {
        Sum::new(self, other)
    }
}

impl<D: Real, A: Covariance<D>, B: Covariance<D>, K: Covariance<D>> Mul<K> for Sum<D, A, B> {
    type Output = Product<D, Self, K>;
    fn mul(self, other: K) -> Self::Output {
        Product::new(self, other)
    }
}
