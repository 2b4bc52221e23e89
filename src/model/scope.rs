//! What an expression of a model file can see, and how it is handed over.

use super::uses::{uses, width};
use crate::num::{Argument, Dual, Real, derivatives, dual};

/// The names an expression can see, how many scalars are behind each, and which it mentions.
#[derive(Clone, Copy, Debug)]
pub struct Scope {
    /// Names in the order in which their scalars are handed over.
    pub names: &'static [&'static str],
    /// Scalars behind each name.
    pub lens: &'static [usize],
    /// How many of the names, the last ones, are `let`s; their scalar is an offset.
    pub lets: usize,
    /// Bit `i`: the expression mentions `names[i]`.
    pub mask: u128,
}

impl Scope {
    /// Number of scalars in sight.
    pub const fn size(&self) -> usize {
        width(u128::MAX, self.lens)
    }
    /// Number of scalars that carry a derivative: those mentioned, without the offsets of `let`s.
    pub const fn width(&self) -> usize {
        width(self.mask & !(u128::MAX << (self.names.len() - self.lets)), self.lens)
    }
    /// Which of the scalars in sight each of the W = [`Scope::width`] is that carry a derivative.
    pub const fn slots<const W: usize>(&self) -> [usize; W] {
        let (mut slots, mut scalar, mut j, mut i) = ([0; W], 0, 0, 0);
        while i < self.names.len() - self.lets {
            let end = scalar + self.lens[i];
            while scalar < end {
                if self.mask >> i & 1 == 1 {
                    slots[j] = scalar;
                    j += 1;
                }
                scalar += 1;
            }
            i += 1;
        }
        slots
    }
    /// Whether the expression mentions `name`, itself or through a `let`.
    pub const fn has(&self, name: &str) -> bool {
        uses(name, self.names) & self.mask != 0
    }
    pub(super) fn mentions(&self, i: usize) -> bool {
        self.mask >> i & 1 == 1
    }
    pub(super) fn first_let(&self) -> usize {
        self.names.len() - self.lets
    }
}

/// Hands out the scalars of a scope in order, as the types of its names.
pub trait Take<D> {
    /// The next value of this type.
    fn take(from: &mut impl Iterator<Item = D>) -> Self;
}

#[allow(clippy::expect_used, reason = "the macro hands over as many scalars as the scope has")]
#[inline(always)]
fn next<D>(from: &mut impl Iterator<Item = D>) -> D {
    from.next().expect("one scalar for every name in scope")
}

impl<D: Real> Take<D> for D {
    #[inline(always)]
    fn take(from: &mut impl Iterator<Item = D>) -> D {
        next(from)
    }
}

impl<D: Real, const N: usize> Take<D> for [D; N] {
    #[inline(always)]
    fn take(from: &mut impl Iterator<Item = D>) -> Self {
        std::array::from_fn(|_| next(from))
    }
}

/// A constant or a number with derivatives, as the latter.
#[inline(always)]
pub fn lift<D: Real>(x: impl Argument<D>) -> D {
    x.number()
}

/// One scalar for a name that stands for one.
pub const fn one(_: &str) -> usize {
    1
}

/// Where a scope's N scalars live in `v`, and which W of them carry a derivative (`used` ≤ W).
#[derive(Debug)]
pub(super) struct Local<const N: usize, const W: usize> {
    pub(super) at: [u32; N],
    pub(super) slot: [u32; W],
    pub(super) used: usize,
    /// Derivatives of each scalar in the W: 1 in its own.
    pub(super) unit: [[f64; W]; N],
}

impl<const N: usize, const W: usize> Local<N, W> {
    #[inline(always)]
    pub(super) fn plain(&self, v: &[f64]) -> [f64; N] {
        std::array::from_fn(|i| v[self.at[i] as usize])
    }

    #[inline(always)]
    pub(super) fn dual(&self, v: &[f64]) -> [Dual<W>; N] {
        std::array::from_fn(|i| dual(v[self.at[i] as usize], self.unit[i]))
    }

    /// The values that the expression mentions.
    pub(super) fn mentioned(&self) -> Vec<usize> {
        self.slot[..self.used].iter().map(|i| self.at[*i as usize] as usize).collect()
    }

    /// Adds the derivatives that `x` carries to the adjoint.
    #[inline(always)]
    pub(super) fn scatter(&self, x: &Dual<W>, g: &mut [f64]) {
        self.scatter_array(&derivatives(x), g);
    }

    #[inline(always)]
    pub(super) fn scatter_array(&self, e: &[f64; W], g: &mut [f64]) {
        for j in 0..self.used {
            g[self.at[self.slot[j] as usize] as usize] += e[j];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_are_the_scalars_of_the_mentioned_names_without_lets() {
        let (names, lens) = (&["a", "b", "w", "f"], &[1, 1, 3, 1]);
        let scope = Scope { names, lens, lets: 1, mask: uses("w[0] + b * f(x)", names) };
        assert_eq!((scope.size(), scope.width()), (6, 4));
        assert_eq!(scope.slots::<4>(), [1, 2, 3, 4]);
    }
}
