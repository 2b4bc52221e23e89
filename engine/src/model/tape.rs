//! The scratch memory of one evaluation, and the operations of which a model is a list.

use pulp::{Arch, NullaryFnOnce};
use rand::Rng;

use super::operator::Memo;
use crate::dist::Gaussian;
use crate::num::vector::axpy;

/// The memory of one evaluation; one per thread.
#[derive(Clone, Debug)]
pub struct Tape {
    /// Unconstrained unknowns.
    pub(super) u: Vec<f64>,
    /// Adjoint of `u`.
    pub(super) gu: Vec<f64>,
    /// Values; `v[0]` is always zero.
    pub(super) v: Vec<f64>,
    /// Adjoint of `v`.
    pub(super) g: Vec<f64>,
    /// What operations keep from their forward pass for their backward pass.
    pub(super) work: Vec<f64>,
    /// What each operator over the surface keeps for its backward pass.
    pub(super) kept: Vec<Memo>,
    /// Log density so far.
    pub(super) lp: f64,
}

/// One step between unknowns and log density.
pub(super) trait Op: Second + Send + Sync {
    /// Computes values from unknowns and earlier values.
    fn forward(&self, _: &mut Tape) {}
    /// Sets unknowns to a typical value, and computes values from them.
    fn initial(&self, t: &mut Tape) {
        self.forward(t);
    }
    /// Draws its unknowns from their prior, and computes values from them; `None` if it cannot.
    fn draw(&self, _: &mut Tape, _: &mut dyn Rng) -> Option<()> {
        None
    }
    /// The prior of each of its numbers at these values, if it is normal or flat.
    fn gaussian(&self, _: &[f64]) -> Option<Gaussian> {
        None
    }
    /// Of an operation with such a prior, the unknown behind this value.
    fn unknown(&self, _values: &[f64], value: f64) -> f64 {
        value
    }
    /// Adds this operation's log density, and carries adjoints from its values to what they came from.
    fn backward(&self, t: &mut Tape);
    /// Adds the same log density; of the adjoints nothing is asked.
    fn ln_density(&self, t: &mut Tape) {
        self.backward(t);
    }
}

/// A `Debug` that prints only the name of the type, so that less is compiled with each model.
macro_rules! opaque {
    ($($T:ty),*) => {$(
        impl std::fmt::Debug for $T {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(stringify!($T))
            }
        }
    )*};
}
pub(super) use opaque;
opaque!(dyn Op);

/// How an operation changes along a direction. `t` holds a point after a backward pass. `d` holds
/// the change of each of its numbers.
pub(super) trait Second {
    /// Writes the change of its values. It follows from that of unknowns and of earlier values.
    fn push(&self, _t: &Tape, _d: &mut Tape) {}
    /// Adds the change of the adjoints that its backward pass adds.
    fn pull(&self, _t: &Tape, _d: &mut Tape) {}
}

/// Terms of the log density that depend on a few scalars each.
pub(super) trait Curved {
    /// Their Hessians in their scalars.
    fn curvatures(&self, t: &Tape) -> Vec<LocalHessian>;
}

/// A Hessian in a few scalars.
#[derive(Debug)]
pub(super) struct LocalHessian {
    /// Where in `v` each scalar lives, and the offset added to it (`v[0]`, which is zero, if none).
    places: Vec<(usize, usize)>,
    /// `(n, n)`
    hessian: Vec<f64>,
}

impl LocalHessian {
    /// From `entry(a, b)`, which is symmetric.
    pub(super) fn new(places: Vec<(usize, usize)>, entry: impl Fn(usize, usize) -> f64) -> Self {
        let n = places.len();
        let mut hessian = vec![0.0; n * n];
        for (a, b) in (0..n).flat_map(|a| (a..n).map(move |b| (a, b))) {
            hessian[a * n + b] = entry(a, b);
            hessian[b * n + a] = hessian[a * n + b];
        }
        Self { places, hessian }
    }

    pub(super) fn pull(&self, d: &mut Tape) {
        let rows = self.hessian.chunks_exact(self.places.len().max(1));
        for ((value, offset), row) in self.places.iter().zip(rows) {
            let change = |((v, o), h): (&(usize, usize), &f64)| h * (d.v[*v] + d.v[*o]);
            let bar: f64 = self.places.iter().zip(row).map(change).sum();
            d.g[*value] += bar;
            if *offset > 0 {
                d.g[*offset] += bar;
            }
        }
    }
}

/// What the curvature of a scalar or a spectrum adds to the change of the adjoints.
pub(super) trait Bent {
    /// Adds Σ bars · ∂²value/∂s∂s · ṡ for its values, at each of `frequency` if it is a spectrum.
    fn bend(&self, t: &Tape, bars: &[f64], frequency: &[f64], d: &mut Tape);
}

/// In four partial sums.
#[inline]
pub(super) fn sum(a: &[f64]) -> f64 {
    let (a4, rest) = a.as_chunks::<4>();
    let mut s = [0.0; 4];
    for a in a4 {
        for i in 0..4 {
            s[i] += a[i];
        }
    }
    (s[0] + s[1]) + (s[2] + s[3]) + rest.iter().sum::<f64>()
}

/// `y += Σ_i x_i row_i` over the rows of a matrix, each as long as `y`.
pub(super) fn add_rows(x: &[f64], rows: &[f64], y: &mut [f64]) {
    Arch::new().dispatch(AddRows { x, rows, y });
}

struct AddRows<'a> {
    x: &'a [f64],
    rows: &'a [f64],
    y: &'a mut [f64],
}

impl NullaryFnOnce for AddRows<'_> {
    type Output = ();

    /// Takes four rows at a time, so that `y` is read and written only a quarter as often.
    #[inline(always)]
    fn call(self) {
        let Self { x, rows, y } = self;
        let n = y.len();
        if n == 0 {
            return;
        }
        let (x4, x_rest) = x.as_chunks::<4>();
        let (rows4, rows_rest) = rows.split_at(4 * n * x4.len());
        for (x, rows) in x4.iter().zip(rows4.chunks_exact(4 * n)) {
            let (a, rows) = rows.split_at(n);
            let (b, rows) = rows.split_at(n);
            let (c, d) = rows.split_at(n);
            for i in 0..n {
                y[i] += (x[0] * a[i] + x[1] * b[i]) + (x[2] * c[i] + x[3] * d[i]);
            }
        }
        for (x, row) in x_rest.iter().zip(rows_rest.chunks_exact(n)) {
            axpy(*x, row, y);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whole numbers: every sum is exact.
    #[test]
    fn rows_are_added_at_every_shape_and_with_the_same_bits_without_avx2() {
        for (n_rows, n) in [(0, 3), (3, 0), (1, 5), (4, 4), (6, 13), (9, 24)] {
            let x: Vec<f64> = (0..n_rows).map(|i| (i * i + 1) as f64).collect();
            let rows: Vec<f64> = (0..n_rows * n).map(|i| (i % 17) as f64 - 3.0).collect();
            let mut y = vec![2.0; n];
            add_rows(&x, &rows, &mut y);
            for (j, y) in y.iter().enumerate() {
                let sum: f64 = (0..n_rows).map(|i| x[i] * rows[i * n + j]).sum();
                assert!((y - 2.0 - sum).abs() < 0.5, "{n_rows} rows of {n}, {j}: {y}");
            }
            let (thirds, mut portable) = (vec![1.0 / 3.0; n_rows], vec![0.1; n]);
            let mut here = portable.clone();
            Arch::Scalar.dispatch(AddRows { x: &thirds, rows: &rows, y: &mut portable });
            add_rows(&thirds, &rows, &mut here);
            assert_eq!(here, portable);
        }
    }
}
