//! Sparse Cholesky factor of `K + s M`: minimum degree ordering, supernodes, all by faer.
//!
//! Sequential, so every result is the same on any number of threads.  Knows nothing of what is
//! solved for.

use super::{Laplacian, ManifoldError};
use dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltError;
use faer::prelude::default;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};

/// `P (K + s M) Pᵀ = L Lᵀ`
#[derive(Debug)]
pub(super) struct Cholesky {
    symbolic: SymbolicCholesky<usize>,
    /// Entries of `L`, in the order that `symbolic` says.
    factor: Vec<f64>,
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
        // Measured on 164,000 vertices: a simplicial factorisation takes 8 times as long, and solves
        // for a block of right-hand sides take the same.
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..default()
        };
        let symbolic =
            factorize_symbolic_cholesky(pattern, Side::Lower, SymmetricOrdering::Amd, params)
                .map_err(|error| failed("symbolic factorisation", &error))?;
        let factor = numeric(&symbolic, matrix)?;
        Ok(Self { symbolic, factor })
    }

    /// Solves `(K + s M) X = B`; `x` `(n_vertices, any)` holds `B` on entry and `X` on return.
    pub(super) fn solve(&self, x: MatMut<'_, f64>) {
        let scratch = self.symbolic.solve_in_place_scratch::<f64>(x.ncols(), Par::Seq);
        let mut memory = MemBuffer::new(scratch);
        LltRef::new(&self.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            x,
            Par::Seq,
            MemStack::new(&mut memory),
        );
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
