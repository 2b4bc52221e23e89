//! One row of an `observe` statement at many values of the fields at its place.

use pulp::{Simd, WithSimd};

use super::functions::RowFn;
use crate::likelihood::Likelihood;
use crate::num::Num;
use crate::num::lanes::LANES;

/// The numbers of a row as linear functions of the latent values at its place, `(n_blocks)`.
#[derive(Clone, Copy)]
pub(super) struct Line<'a> {
    /// The numbers where all are zero.
    pub(super) base: &'a [f64],
    pub(super) slopes: &'a [Slope],
    pub(super) n_blocks: usize,
}

/// What a number of a row gains as the value of a block grows by one.
#[derive(Clone, Copy)]
pub(super) struct Slope {
    pub(super) number: usize,
    pub(super) block: usize,
    pub(super) per_unit: f64,
}

/// Log likelihoods of one row at many latent values.
pub(super) struct AddLns<'a, F: RowFn<N>, const N: usize> {
    /// The row's columns, and its measurement.
    pub(super) columns: &'a F::Columns,
    pub(super) y: &'a F::Y,
    pub(super) line: Line<'a>,
    pub(super) theta: &'a [f64],
    pub(super) out: &'a mut [f64],
}

impl<F: RowFn<N>, const N: usize> AddLns<'_, F, N> {
    #[inline(always)]
    fn likelihood(&self, k: usize) -> impl Likelihood<Num<f64>, F::Y> + use<F, N> {
        let mut s: [Num<f64>; N] = std::array::from_fn(|j| Num(self.line.base[j]));
        let theta = &self.theta[k * self.line.n_blocks..];
        for Slope { number, block, per_unit } in self.line.slopes {
            s[*number] += per_unit * theta[*block];
        }
        F::likelihood(s, self.columns)
    }
}

impl<F: RowFn<N>, const N: usize> WithSimd for AddLns<'_, F, N> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.out.len();
        for first in (0..n).step_by(LANES) {
            let row = |lane: usize| (self.likelihood((first + lane).min(n - 1)), self.y); // the last fills up
            let values = Likelihood::ln_likelihoods([row(0), row(1), row(2), row(3)]);
            for (out, value) in self.out[first..].iter_mut().zip(values) {
                *out += value.0;
            }
        }
    }
}
