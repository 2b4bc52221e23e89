//! Where the numbers that an expression mentions live.

use crate::num::{Dual, Num, derivatives, variable};

/// The places in the value vector of the N numbers that an expression mentions.
#[derive(Clone, Debug)]
pub(super) struct Local<const N: usize> {
    pub(super) at: [u32; N],
}

impl<const N: usize> Local<N> {
    /// The numbers at these places. If there are fewer than N, the others are `v[0]`, which is
    /// zero.
    pub(super) fn new(places: &[u32]) -> Self {
        let mut at = [0; N];
        at.iter_mut().zip(places).for_each(|(at, place)| *at = *place);
        Self { at }
    }

    /// Their values.
    #[inline(always)]
    pub(super) fn plain(&self, v: &[f64]) -> [Num<f64>; N] {
        std::array::from_fn(|i| Num(v[self.at[i] as usize]))
    }

    /// Their values, each with a derivative of its own. Further derivatives, up to W, are zero.
    #[inline(always)]
    pub(super) fn dual<const W: usize>(&self, v: &[f64]) -> [Num<Dual<W>>; N] {
        std::array::from_fn(|i| Num(variable(v[self.at[i] as usize], i)))
    }

    /// Their places, of those that there are.
    pub(super) fn places(&self) -> Vec<usize> {
        self.at.iter().filter(|at| **at != 0).map(|at| *at as usize).collect()
    }

    /// Adds the derivatives that `x` carries to the adjoint.
    #[inline(always)]
    pub(super) fn scatter<const W: usize>(&self, x: &Num<Dual<W>>, g: &mut [f64]) {
        self.scatter_array(&derivatives(&x.0), g);
    }

    /// Adds these derivatives to the adjoint. Those from number N on belong to something else and
    /// are not added.
    #[inline(always)]
    pub(super) fn scatter_array<const W: usize>(&self, e: &[f64; W], g: &mut [f64]) {
        for (at, e) in self.at.iter().zip(e) {
            g[*at as usize] += e;
        }
    }
}
