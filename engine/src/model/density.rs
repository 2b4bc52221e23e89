//! `density` statements: any log density of parameters and columns, for what the language cannot
//! say otherwise.

use std::marker::PhantomData;

use num_dual::DualStruct;

use super::error::ModelError;
use super::functions::{Columns, DensityFn, Terms};
use super::scope::Local;
use super::tape::{Curved, Op, Tape};
use crate::num::{Dual, Num};

/// What a model asks of a density besides the gradient.
pub(super) trait LogTerms: Op + Curved {
    /// Whether it has a term for each row.
    fn is_per_row(&self) -> bool;
    /// The numeric columns that the model reads: each one's name, and the table's columns behind it.
    fn columns(&self) -> Vec<(&'static str, Vec<String>)>;
    /// Takes the cells of each column, for this many rows.
    fn read(&mut self, cells: Vec<Vec<f64>>, n_rows: usize);
    /// The terms, after a forward pass.
    fn terms(&self, t: &Tape) -> Vec<f64>;
    /// What it reads of its row number `i`.
    fn observed(&self, i: usize) -> Vec<f64>;
}

/// A `density` statement on its data.
#[derive(Debug)]
pub struct Density {
    /// The statement's name.
    pub name: &'static str,
    /// Whether it reads the table. If so it is a likelihood, otherwise a part of the prior.
    pub reads_data: bool,
    /// Rows of the table, from 0, that have a term each. Empty if the density is one number.
    pub rows: Vec<usize>,
    /// How many rows were read before the first one that has a term.
    skipped: usize,
    pub(super) op: Box<dyn LogTerms>,
}

impl Density {
    /// The density on the `rows` that it reads. Which of them have a term is found only once there
    /// are values to evaluate it at: see [`Density::settle`].
    pub(super) fn new(
        name: &'static str,
        reads_data: bool,
        rows: Vec<usize>,
        op: Box<dyn LogTerms>,
    ) -> Self {
        let rows = if op.is_per_row() { rows } else { vec![] };
        Self { name, reads_data, rows, skipped: 0, op }
    }

    /// Finds which of its rows have a term: if it has n terms, the last n.
    ///
    /// # Errors
    /// [`ModelError::Terms`].
    pub(super) fn settle(&mut self, t: &Tape) -> Result<(), ModelError> {
        if self.rows.is_empty() {
            return Ok(());
        }
        let (got, rows) = (self.op.terms(t).len(), self.rows.len());
        if got == 0 || got > rows {
            return Err(ModelError::Terms { density: self.name, got, rows });
        }
        self.skipped = rows - got;
        self.rows.drain(..self.skipped);
        Ok(())
    }

    /// Log density of each row that has one, after a forward pass.
    pub(super) fn pointwise(&self, t: &Tape, out: &mut Vec<f64>) {
        if !self.rows.is_empty() {
            out.extend(self.op.terms(t));
        }
    }

    /// What it reads of each row that has a term.
    pub fn observed(&self) -> Vec<Vec<f64>> {
        (0..self.rows.len()).map(|i| self.op.observed(self.skipped + i)).collect()
    }
}

/// This is asked of the type, because without data there is nothing to evaluate.
fn is_per_row<S, C, D, T: Terms<D>>(_: impl Fn(S, C) -> T) -> bool {
    T::PER_ROW
}

/// A density at the places of its scalars, with the columns it reads (column, row × its width).
pub(super) struct DensityAt<F, const N: usize> {
    pub(super) local: Local<N>,
    pub(super) cells: Vec<Vec<f64>>,
    n_rows: usize,
    f: PhantomData<F>,
}

impl<F, const N: usize> DensityAt<F, N> {
    pub(super) fn new(local: Local<N>) -> Self {
        Self { local, cells: vec![], n_rows: 0, f: PhantomData }
    }
}

impl<F: DensityFn<N>, const N: usize> Op for DensityAt<F, N> {
    fn backward(&self, t: &mut Tape) {
        let data = F::Columns::data(&self.cells);
        let terms = F::terms::<Dual<N>>(self.local.dual(&t.v), &data);
        let x = terms.terms().iter().fold(Num::from(0.0), |sum, x| sum + x);
        t.lp += x.re();
        self.local.scatter(&x, &mut t.g);
    }
}

impl<F: DensityFn<N>, const N: usize> LogTerms for DensityAt<F, N> {
    fn is_per_row(&self) -> bool {
        is_per_row::<_, _, Num<f64>, _>(F::terms::<f64>)
    }

    fn columns(&self) -> Vec<(&'static str, Vec<String>)> {
        F::Columns::names()
    }

    fn read(&mut self, cells: Vec<Vec<f64>>, n_rows: usize) {
        (self.cells, self.n_rows) = (cells, n_rows);
    }

    fn terms(&self, t: &Tape) -> Vec<f64> {
        let data = F::Columns::data(&self.cells);
        F::terms(self.local.plain(&t.v), &data).terms().iter().map(|term| term.0).collect()
    }

    fn observed(&self, i: usize) -> Vec<f64> {
        let of_row = |cells: &Vec<f64>| {
            let width = cells.len() / self.n_rows;
            cells[i * width..][..width].to_vec()
        };
        self.cells.iter().flat_map(of_row).collect()
    }
}
