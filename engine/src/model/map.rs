//! A derived quantity as a function of a row or of a place.

use super::error::ModelError;
use super::functions::{Columns, LetFn};
use crate::num::Num;

/// Reads one row's columns, by name.
pub(super) type ReadCell<'a> = &'a mut dyn FnMut(&str) -> Result<f64, ModelError>;

/// A `let` that depends on a place alone, through its fields and parameters.
#[derive(Debug)]
pub(super) struct Map {
    /// The `let`.
    pub(super) of: &'static str,
    /// Its name. If the `let` has a map for each label, the name is followed by the label.
    pub(super) name: String,
    pub(super) unit: String,
    pub(super) range: Option<(f64, f64)>,
    /// Which label it belongs to, if there is one map for each.
    pub(super) label: Option<usize>,
    /// Where each number that it mentions comes from.
    pub(super) sources: Vec<Source>,
    pub(super) at: Box<dyn MapFn>,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Source {
    Value(usize),
    Field(usize),
}

pub(super) trait MapFn: Send + Sync {
    /// Takes the columns of one more row.
    fn read(&mut self, cell: ReadCell<'_>) -> Result<(), ModelError>;
    /// The value at these scalars, in one of the rows that were taken, or at a place that is in no
    /// table.
    fn value(&self, s: &[f64], row: Option<usize>) -> f64;
}

pub(super) struct MapAt<F: LetFn<N>, const N: usize> {
    nowhere: F::Columns,
    rows: Vec<F::Columns>,
}

impl<F: LetFn<N>, const N: usize> MapAt<F, N> {
    pub(super) fn new() -> Self {
        let absent = F::Columns::read(&mut |_| Ok::<_, std::convert::Infallible>(f64::NAN));
        let Ok(nowhere) = absent;
        Self { nowhere, rows: vec![] }
    }
}

impl<F: LetFn<N>, const N: usize> MapFn for MapAt<F, N> {
    fn read(&mut self, cell: ReadCell<'_>) -> Result<(), ModelError> {
        self.rows.push(F::Columns::read(cell)?);
        Ok(())
    }

    fn value(&self, s: &[f64], row: Option<usize>) -> f64 {
        let s = std::array::from_fn(|i| Num(s[i]));
        F::value(s, row.map_or(&self.nowhere, |row| &self.rows[row])).0
    }
}
