//! An expression at every vertex of the surface: what an operator over the whole surface reads.

use super::error::ModelError;
use super::functions::{Columns, LetFn};
use super::map::ReadCell;
use crate::num::{Num, derivatives, dual, variable};

/// Where a number of such an expression lives in the value vector.
#[derive(Clone, Copy, Debug)]
pub(super) enum Where {
    /// It is the same at every vertex.
    Same(u32),
    /// The first of one for each vertex.
    Each(u32),
}

impl Where {
    fn at(self, vertex: usize) -> usize {
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
    /// Its values (n_vertices).
    fn values(&self, v: &[f64], from: &[Where], out: &mut [f64]);
    /// Their change (n_vertices), where the values change by `d`.
    fn push(&self, v: &[f64], from: &[Where], d: &[f64], out: &mut [f64]);
    /// Adds to `g` the adjoint of what it depends on; `bars` (n_vertices) is that of its values.
    fn pull(&self, v: &[f64], from: &[Where], bars: &[f64], g: &mut [f64]);
}

/// The expression F of N numbers: those of `from`, then an offset for each `let` that it mentions, which is zero.
pub(super) struct PlaceAt<F: LetFn<N>, const N: usize> {
    row: F::Columns,
}

impl<F: LetFn<N>, const N: usize> PlaceAt<F, N> {
    pub(super) fn new() -> Self {
        let absent = F::Columns::read(&mut |_| Ok::<_, std::convert::Infallible>(f64::NAN));
        let Ok(row) = absent;
        Self { row }
    }

    /// Number `i` at a vertex; zero if it is an offset.
    fn number(v: &[f64], from: &[Where], i: usize, vertex: usize) -> f64 {
        from.get(i).map_or(0.0, |from| v[from.at(vertex)])
    }
}

impl<F: LetFn<N>, const N: usize> PlaceFn for PlaceAt<F, N> {
    fn read(&mut self, columns: &[&str], cell: ReadCell<'_>) -> Result<(), ModelError> {
        let all = F::Columns::names().into_iter();
        let own = all.filter(|(column, _)| columns.contains(column));
        let own: Vec<String> = own.flat_map(|(_, names)| names).collect();
        self.row = F::Columns::read(&mut |name| {
            if own.iter().any(|own| own == name) { cell(name) } else { Ok(f64::NAN) }
        })?;
        Ok(())
    }

    fn values(&self, v: &[f64], from: &[Where], out: &mut [f64]) {
        for (vertex, out) in out.iter_mut().enumerate() {
            let number = |i| Num(Self::number(v, from, i, vertex));
            *out = F::value(std::array::from_fn(number), &self.row).0;
        }
    }

    fn push(&self, v: &[f64], from: &[Where], d: &[f64], out: &mut [f64]) {
        for (vertex, out) in out.iter_mut().enumerate() {
            let change = |i| Self::number(d, from, i, vertex);
            let number = |i| Num(dual(Self::number(v, from, i, vertex), [change(i)]));
            *out = derivatives(&F::value(std::array::from_fn(number), &self.row).0)[0];
        }
    }

    fn pull(&self, v: &[f64], from: &[Where], bars: &[f64], g: &mut [f64]) {
        for (vertex, bar) in bars.iter().enumerate().filter(|(_, bar)| **bar != 0.0) {
            let number = |i| Num(variable::<N>(Self::number(v, from, i, vertex), i));
            let slopes = derivatives(&F::value(std::array::from_fn(number), &self.row).0);
            for (from, slope) in from.iter().zip(slopes) {
                g[from.at(vertex)] += bar * slope;
            }
        }
    }
}
