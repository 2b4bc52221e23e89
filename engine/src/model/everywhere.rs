//! An expression at every vertex of the surface: what an operator over the whole surface reads.

use super::error::ModelError;
use super::functions::{Columns, LetFn};
use super::map::ReadCell;
use crate::num::{Dual, Num, derivatives, variable};

/// Where a number of such an expression lives in the value vector.
#[derive(Clone, Copy, Debug)]
pub(super) enum Where {
    /// It is the same at every vertex.
    Same(u32),
    /// The first of one for each vertex.
    Each(u32),
}

impl Where {
    pub(super) fn at(self, vertex: usize) -> usize {
        match self {
            Self::Same(v) => v as usize,
            Self::Each(v) => v as usize + vertex,
        }
    }
}

/// An expression with its derivatives, compiled with each model.
pub(super) trait PlaceFn: Send + Sync {
    /// Takes these columns of a row, whose cells are then those of every place.
    fn read(&mut self, columns: &[&str], cell: ReadCell<'_>) -> Result<(), ModelError>;
    /// Its values (n_vertices), and its slopes in each number of `from` (n_vertices, from).
    fn values(&self, v: &[f64], from: &[Where], out: &mut [f64], slopes: &mut [f64]);
}

/// The change of an expression's values (n_vertices), where the numbers that it comes `from` change by `d`.
pub(super) fn push(slopes: &[f64], from: &[Where], d: &[f64], out: &mut [f64]) {
    if from.is_empty() {
        return out.fill(0.0);
    }
    for (vertex, (out, slopes)) in out.iter_mut().zip(slopes.chunks_exact(from.len())).enumerate() {
        *out = from.iter().zip(slopes).map(|(from, slope)| slope * d[from.at(vertex)]).sum();
    }
}

/// Adds to `g` the adjoint of what an expression comes `from`; `bars` (n_vertices) is that of its values.
pub(super) fn pull(slopes: &[f64], from: &[Where], bars: &[f64], g: &mut [f64]) {
    let all = bars.iter().zip(slopes.chunks_exact(from.len().max(1))).enumerate();
    for (vertex, (bar, slopes)) in all.filter(|(_, (bar, _))| **bar != 0.0) {
        for (from, slope) in from.iter().zip(slopes) {
            g[from.at(vertex)] += bar * slope;
        }
    }
}

/// The expression F of N numbers: the W of `from`, then an offset for each `let` that it mentions, which is zero.
pub(super) struct PlaceAt<F: LetFn<N>, const N: usize, const W: usize> {
    row: F::Columns,
}

impl<F: LetFn<N>, const N: usize, const W: usize> PlaceAt<F, N, W> {
    pub(super) fn new() -> Self {
        let absent = F::Columns::read(&mut |_| Ok::<_, std::convert::Infallible>(f64::NAN));
        let Ok(row) = absent;
        Self { row }
    }
}

impl<F: LetFn<N>, const N: usize, const W: usize> PlaceFn for PlaceAt<F, N, W> {
    fn read(&mut self, columns: &[&str], cell: ReadCell<'_>) -> Result<(), ModelError> {
        let all = F::Columns::names().into_iter();
        let own = all.filter(|(column, _)| columns.contains(column));
        let own: Vec<String> = own.flat_map(|(_, names)| names).collect();
        self.row = F::Columns::read(&mut |name| {
            if own.iter().any(|own| own == name) { cell(name) } else { Ok(f64::NAN) }
        })?;
        Ok(())
    }

    fn values(&self, v: &[f64], from: &[Where], out: &mut [f64], slopes: &mut [f64]) {
        for (vertex, out) in out.iter_mut().enumerate() {
            let number = |i: usize| match from.get(i) {
                Some(from) => Num(variable::<W>(v[from.at(vertex)], i)),
                None => Num(Dual::from_re(0.0)),
            };
            let value = F::value(std::array::from_fn(number), &self.row).0;
            *out = value.re;
            slopes[vertex * W..][..W].copy_from_slice(&derivatives(&value));
        }
    }
}
