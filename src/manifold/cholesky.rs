//! Sparse Cholesky factor of `K + s M`, and solves for a few right-hand sides at once.
//!
//! faer orders (minimum degree), analyses and factorises into supernodes; the triangular solves are
//! ours because faer's handle each column of a narrow block separately.  Sequential, so every result
//! is the same on any number of threads.  Knows nothing of what is solved for.

use super::{Laplacian, ManifoldError};
use dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltError;
use faer::prelude::default;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky, supernodal::SymbolicSupernodalCholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Par, Side};
use std::ops::Range;

/// `P (K + s M) Pᵀ = L Lᵀ`, `L` stored as dense column blocks (supernodes).
#[derive(Clone, Debug)]
pub(super) struct Cholesky {
    /// Row of the original matrix at each row of the permuted one.
    permutation: Vec<usize>,
    supernodes: Vec<Supernode>,
    /// Rows below the diagonal blocks, supernode after supernode.
    rows: Vec<u32>,
    /// Column-major blocks, supernode after supernode.
    values: Vec<f64>,
}

/// Columns that share their rows: a dense lower triangle on top of a dense rectangle.
#[derive(Clone, Debug)]
struct Supernode {
    columns: Range<usize>,
    rows: Range<usize>,
    values: Range<usize>,
}

impl Cholesky {
    /// Factorises `K + shift M`; `shift` in mm⁻².
    ///
    /// # Errors
    /// [`ManifoldError::NotPositiveDefinite`] when a pivot is not positive, and
    /// [`ManifoldError::LinearAlgebra`] when memory runs out.
    pub(super) fn new(laplacian: &Laplacian, shift: f64) -> Result<Self, ManifoldError> {
        let (column_start, row_indices, values) = lower_triangle(laplacian, shift);
        let n = laplacian.mass.len();
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &column_start, None, &row_indices);
        let matrix = SparseColMatRef::new(pattern, &values);
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..default()
        };
        let symbolic =
            factorize_symbolic_cholesky(pattern, Side::Lower, SymmetricOrdering::Amd, params)
                .map_err(|error| failed("symbolic factorisation", &error))?;
        let factor = numeric(&symbolic, matrix)?;
        let (SymbolicCholeskyRaw::Supernodal(blocks), Some(permutation)) =
            (symbolic.raw(), symbolic.perm())
        else {
            return Err(failed("symbolic factorisation", &"not supernodal"));
        };
        let permutation = permutation.arrays().0.to_vec();
        Ok(Self::from_supernodes(blocks, permutation, factor))
    }

    fn from_supernodes(
        symbolic: &SymbolicSupernodalCholesky<usize>,
        permutation: Vec<usize>,
        values: Vec<f64>,
    ) -> Self {
        let mut rows = vec![];
        let mut supernodes = Vec::with_capacity(symbolic.n_supernodes());
        for index in 0..symbolic.n_supernodes() {
            let first_row = rows.len();
            rows.extend(symbolic.supernode(index).pattern().iter().map(|&row| row as u32));
            let block = symbolic.col_ptr_for_val();
            supernodes.push(Supernode {
                columns: symbolic.supernode_begin()[index]..symbolic.supernode_end()[index],
                rows: first_row..rows.len(),
                values: block[index]..block[index + 1],
            });
        }
        Self { permutation, supernodes, rows, values }
    }

    /// Solves `(K + s M) x = b` for `B` right-hand sides; `x` holds `b` on entry.
    pub(super) fn solve<const B: usize>(&self, x: &mut [[f64; B]]) {
        let mut permuted: Vec<[f64; B]> = self.permutation.iter().map(|&row| x[row]).collect();
        for supernode in &self.supernodes {
            self.forward(supernode, &mut permuted);
        }
        for supernode in self.supernodes.iter().rev() {
            self.backward(supernode, &mut permuted);
        }
        for (&row, value) in self.permutation.iter().zip(permuted) {
            x[row] = value;
        }
    }

    /// One supernode of `x ← L⁻¹ x`.
    fn forward<const B: usize>(&self, supernode: &Supernode, x: &mut [[f64; B]]) {
        let width = supernode.columns.len();
        let rows = &self.rows[supernode.rows.clone()];
        let values = &self.values[supernode.values.clone()];
        for (c, column) in values.chunks_exact(width + rows.len()).enumerate() {
            let (diagonal, below) = column.split_at(width);
            let (solved, rest) = x[supernode.columns.start + c..].split_at_mut(1);
            scale(&mut solved[0], 1.0 / diagonal[c]);
            for (factor, target) in diagonal[c + 1..].iter().zip(rest) {
                subtract_scaled(target, *factor, &solved[0]);
            }
            let solved = solved[0];
            for (factor, &row) in below.iter().zip(rows) {
                subtract_scaled(&mut x[row as usize], *factor, &solved);
            }
        }
    }

    /// One supernode of `x ← L⁻ᵀ x`.
    fn backward<const B: usize>(&self, supernode: &Supernode, x: &mut [[f64; B]]) {
        let width = supernode.columns.len();
        let rows = &self.rows[supernode.rows.clone()];
        let values = &self.values[supernode.values.clone()];
        for (c, column) in values.chunks_exact(width + rows.len()).enumerate().rev() {
            let (diagonal, below) = column.split_at(width);
            let first = supernode.columns.start + c;
            let mut sum = x[first];
            for (factor, &row) in below.iter().zip(rows) {
                subtract_scaled(&mut sum, *factor, &x[row as usize]);
            }
            for (factor, source) in diagonal[c + 1..].iter().zip(&x[first + 1..]) {
                subtract_scaled(&mut sum, *factor, source);
            }
            scale(&mut sum, 1.0 / diagonal[c]);
            x[first] = sum;
        }
    }
}

#[inline(always)]
fn subtract_scaled<const B: usize>(target: &mut [f64; B], factor: f64, source: &[f64; B]) {
    for k in 0..B {
        target[k] -= factor * source[k];
    }
}

#[inline(always)]
fn scale<const B: usize>(target: &mut [f64; B], factor: f64) {
    for value in target {
        *value *= factor;
    }
}

/// The lower triangle of `K + shift M` by columns: (column starts, rows, values).
fn lower_triangle(laplacian: &Laplacian, shift: f64) -> (Vec<usize>, Vec<usize>, Vec<f64>) {
    let (mut starts, mut rows, mut values) = (vec![0], vec![], vec![]);
    for (column, mass) in laplacian.mass.iter().enumerate() {
        // K is symmetric: its row is its column.
        for (row, value) in laplacian.stiffness.row(column).filter(|&(row, _)| row >= column) {
            rows.push(row);
            values.push(if row == column { value + shift * mass } else { value });
        }
        starts.push(rows.len());
    }
    (starts, rows, values)
}

fn numeric(
    symbolic: &SymbolicCholesky<usize>,
    matrix: SparseColMatRef<'_, usize, f64>,
) -> Result<Vec<f64>, ManifoldError> {
    let mut factor = vec![0.0; symbolic.len_val()];
    let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, default());
    let mut memory =
        MemBuffer::try_new(scratch).map_err(|error| failed("numeric factorisation", &error))?;
    symbolic
        .factorize_numeric_llt(
            &mut factor,
            matrix,
            Side::Lower,
            default(),
            Par::Seq,
            MemStack::new(&mut memory),
            default(),
        )
        .map_err(|LltError::NonPositivePivot { index }| ManifoldError::NotPositiveDefinite {
            pivot: index,
        })?;
    Ok(factor)
}

fn failed(during: &'static str, reason: &dyn std::fmt::Debug) -> ManifoldError {
    ManifoldError::LinearAlgebra { during, reason: format!("{reason:?}") }
}
