//! Thick-restart block Lanczos: the largest eigenpairs of a symmetric operator.
//!
//! ```text
//! A V = V T + W E,   V orthonormal (n, size), T = Vᵀ A V, W the next block, E its coupling
//! ```
//! Every new block is orthogonalised twice against all of `V`.  A restart keeps the best Ritz vectors,
//! for which `T` is diagonal but for their coupling to `W`.  The block is as wide as the largest
//! multiplicity a symmetric surface brings (five, on an icosphere), so that none is missed.
//! Knows nothing of surfaces.

use super::ManifoldError;
use crate::random::procedure;
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::prelude::{IntoConst, ReborrowMut};
use faer::{Accum, Mat, MatMut, MatRef, Par, Side};
use rand::RngExt;

/// Columns per block.
pub(super) const BLOCK: usize = 8;

/// `‖A y − θ y‖ ≤ TOLERANCE θ` ends the iteration.
const TOLERANCE: f64 = 1e-10;

/// Restarts before the iteration is given up; a few are usual.
const MAX_RESTARTS: usize = 100;

/// Vectors the iteration keeps for `n_wanted` eigenpairs, beside one block more.
pub(super) fn capacity(n_wanted: usize) -> usize {
    (17 * n_wanted / 10).max(n_wanted + 4 * BLOCK).next_multiple_of(BLOCK)
}

/// Orthonormal eigenvectors `(n, n_wanted)` of the `n_wanted` largest eigenvalues, largest first.
///
/// `operator(input, out)` writes `A input` to `out`, both `(n, BLOCK)`; `n` must exceed
/// `capacity(n_wanted) + BLOCK`.
///
/// # Errors
/// [`ManifoldError::NotConverged`] when the restarts are used up, [`ManifoldError::LinearAlgebra`]
/// when a small dense problem fails.
pub(super) fn largest(
    operator: &impl Fn(MatRef<'_, f64>, MatMut<'_, f64>),
    n: usize,
    n_wanted: usize,
) -> Result<Mat<f64>, ManifoldError> {
    let mut krylov = Krylov::start(n, capacity(n_wanted))?;
    let mut n_restarts = 0;
    loop {
        while krylov.size + BLOCK <= capacity(n_wanted) {
            krylov.expand(operator)?;
        }
        let ritz = krylov.ritz()?;
        let residuals = &ritz.relative_residuals[..n_wanted];
        let converged = residuals.iter().filter(|&&r| r <= TOLERANCE).count();
        if converged == n_wanted {
            return Ok(krylov.combine(ritz.vectors.subcols(0, n_wanted)));
        }
        if n_restarts == MAX_RESTARTS {
            let worst = residuals.iter().copied().fold(0.0, f64::max);
            return Err(ManifoldError::NotConverged { n_modes: n_wanted, converged, worst });
        }
        let kept = (n_wanted + (krylov.size - n_wanted) / 3).next_multiple_of(BLOCK);
        krylov.restart(&ritz, kept.min(krylov.size - BLOCK));
        n_restarts += 1;
    }
}

/// The Krylov space: `size` vectors and the block after them.
struct Krylov {
    /// `[V W]` `(n, capacity + BLOCK)`; columns from `size + BLOCK` on are unused.
    vectors: Mat<f64>,
    /// `T`, with the coupling `E` in the BLOCK rows below it and mirrored beside it.
    projected: Mat<f64>,
    size: usize,
}

/// Eigenpairs of `T`, largest first.
struct Ritz {
    values: Vec<f64>,
    /// Eigenvectors of `T` (size, size).
    vectors: Mat<f64>,
    /// `E` times each eigenvector (BLOCK, size).
    coupling: Mat<f64>,
    /// `‖A y − θ y‖ / θ`, which is the norm of the coupling over θ.
    relative_residuals: Vec<f64>,
}

impl Krylov {
    /// A random orthonormal block, the same in every run.
    fn start(n: usize, capacity: usize) -> Result<Self, ManifoldError> {
        let mut random = procedure(0);
        let mut vectors = Mat::zeros(n, capacity + BLOCK);
        for column in 0..BLOCK {
            for row in 0..n {
                vectors[(row, column)] = random.random::<f64>() - 0.5;
            }
        }
        orthonormalise(vectors.as_mut().subcols_mut(0, BLOCK))?;
        Ok(Self { vectors, projected: Mat::zeros(capacity + BLOCK, capacity + BLOCK), size: 0 })
    }

    /// Takes the block `W` into `V` and makes the next one from `A W`.
    fn expand(
        &mut self,
        operator: &impl Fn(MatRef<'_, f64>, MatMut<'_, f64>),
    ) -> Result<(), ManifoldError> {
        let grown = self.size + BLOCK;
        let (old, new) = self.vectors.as_mut().split_at_col_mut(grown);
        let old = old.into_const();
        let mut next = new.subcols_mut(0, BLOCK);
        operator(old.subcols(self.size, BLOCK), next.rb_mut());
        let mut overlap = Mat::zeros(grown, BLOCK);
        for _ in 0..2 {
            let correction = old.transpose() * next.as_ref();
            matmul(next.rb_mut(), Accum::Add, old, &correction, -1.0, Par::Seq);
            overlap += correction;
        }
        let coupling = orthonormalise(next)?;
        for column in 0..BLOCK {
            for row in 0..grown {
                self.set_symmetric(row, self.size + column, overlap[(row, column)]);
            }
            for row in 0..BLOCK {
                self.set_symmetric(grown + row, self.size + column, coupling[(row, column)]);
            }
        }
        self.size = grown;
        Ok(())
    }

    fn set_symmetric(&mut self, row: usize, column: usize, value: f64) {
        self.projected[(row, column)] = value;
        self.projected[(column, row)] = value;
    }

    /// Eigenpairs of `T` and how far each is from an eigenpair of `A`.
    fn ritz(&self) -> Result<Ritz, ManifoldError> {
        let size = self.size;
        let decomposition =
            self.projected.submatrix(0, 0, size, size).self_adjoint_eigen(Side::Lower).map_err(
                |error| ManifoldError::LinearAlgebra {
                    during: "the projected eigenproblem",
                    reason: format!("{error:?}"),
                },
            )?;
        let values: Vec<f64> = decomposition.S().column_vector().iter().rev().copied().collect();
        let vectors = decomposition.U().reverse_cols().to_owned();
        // Only the last block of V couples to W, except right after a restart: use all of E.
        let coupling = self.projected.submatrix(size, 0, BLOCK, size) * &vectors;
        let relative_residuals =
            values.iter().enumerate().map(|(i, value)| coupling.col(i).norm_l2() / value).collect();
        Ok(Ritz { values, vectors, coupling, relative_residuals })
    }

    /// `V` times `coefficients` (size, any).
    fn combine(&self, coefficients: MatRef<'_, f64>) -> Mat<f64> {
        self.vectors.subcols(0, self.size) * coefficients
    }

    /// Keeps the `kept` largest Ritz vectors and the block `W`.
    fn restart(&mut self, ritz: &Ritz, kept: usize) {
        let ritz_vectors = self.combine(ritz.vectors.subcols(0, kept));
        let block = self.vectors.subcols(self.size, BLOCK).to_owned();
        self.vectors.as_mut().subcols_mut(0, kept).copy_from(&ritz_vectors);
        self.vectors.as_mut().subcols_mut(kept, BLOCK).copy_from(&block);
        self.projected.fill(0.0);
        for column in 0..kept {
            self.projected[(column, column)] = ritz.values[column];
            for row in 0..BLOCK {
                self.set_symmetric(kept + row, column, ritz.coupling[(row, column)]);
            }
        }
        self.size = kept;
    }
}

/// `W ← Q` with `W = Q R` by Cholesky QR done twice; returns `R`.
fn orthonormalise(mut block: MatMut<'_, f64>) -> Result<Mat<f64>, ManifoldError> {
    let mut upper = Mat::identity(block.ncols(), block.ncols());
    for _ in 0..2 {
        let gram = block.as_ref().transpose() * block.as_ref();
        let factor = gram.llt(Side::Lower).map_err(|_| ManifoldError::LinearAlgebra {
            during: "Lanczos orthogonalisation",
            reason: "the new block has lost rank".to_owned(),
        })?;
        let lower = factor.L();
        solve_lower_triangular_in_place(lower, block.rb_mut().transpose_mut(), Par::Seq);
        upper = lower.transpose() * upper;
    }
    Ok(upper)
}
