//! The Cholesky factor of a precision matrix.

use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{ColMut, Mat, MatRef, Par, Side};
use serde::{Deserialize, Serialize};

/// L of P = L Lᵀ, `(dim, dim)`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Factor {
    dim: usize,
    /// Column-major; 0 above the diagonal.
    lower: Vec<f64>,
}

impl Factor {
    /// Of a symmetric matrix, whose lower triangle is read. `None` where it is not positive definite.
    pub(crate) fn of(precision: MatRef<'_, f64>) -> Option<Self> {
        let is_finite = precision.col_iter().all(|column| column.iter().all(|x| x.is_finite()));
        let llt = is_finite.then(|| precision.llt(Side::Lower).ok()).flatten()?;
        let dim = precision.nrows();
        let mut lower = Vec::with_capacity(dim * dim);
        llt.L().col_iter().for_each(|column| lower.extend(column.iter()));
        Some(Self { dim, lower })
    }

    /// Whether it is of `dim` coordinates.
    pub(crate) fn fits(&self, dim: usize) -> bool {
        self.dim == dim && Some(self.lower.len()) == dim.checked_mul(dim)
    }

    fn lower(&self) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(&self.lower, self.dim, self.dim)
    }

    /// ln |L|
    pub(crate) fn ln_det(&self) -> f64 {
        self.lower.iter().step_by(self.dim + 1).map(|x| x.ln()).sum()
    }

    /// x ← L⁻¹ x
    pub(crate) fn solve(&self, x: &mut [f64]) {
        let x = ColMut::from_slice_mut(x).as_mat_mut();
        solve_lower_triangular_in_place(self.lower(), x, Par::Seq);
    }

    /// x ← L⁻ᵀ x, which makes a draw of the standard normal one of the normal with precision P
    pub(crate) fn solve_transposed(&self, x: &mut [f64]) {
        let x = ColMut::from_slice_mut(x).as_mat_mut();
        solve_upper_triangular_in_place(self.lower().transpose(), x, Par::Seq);
    }

    /// The diagonal of P⁻¹, (dim).
    pub(crate) fn variances(&self) -> Vec<f64> {
        let mut inverse = Mat::identity(self.dim, self.dim);
        solve_lower_triangular_in_place(self.lower(), inverse.as_mut(), Par::Seq);
        inverse.col_iter().map(|column| column.squared_norm_l2()).collect()
    }

    /// Lᵀ x
    pub(crate) fn whitened(&self, x: &[f64]) -> Vec<f64> {
        let product: Mat<f64> =
            self.lower().transpose() * MatRef::from_column_major_slice(x, self.dim, 1);
        product.col(0).iter().copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_with_the_factor_its_inverse_and_their_transposes() {
        let l =
            Mat::from_fn(3, 3, |i, j| [[2.0, 0.0, 0.0], [-0.7, 0.5, 0.0], [0.3, 1.1, 3.0]][i][j]);
        let precision = &l * l.transpose();
        let factor = Factor::of(precision.as_ref()).unwrap();
        assert!((factor.ln_det() - 3f64.ln()).abs() < 1e-14);
        let x = [0.4, -1.3, 0.8];
        let mut product = [0.0; 3];
        for (i, p) in product.iter_mut().enumerate() {
            *p = (0..3).map(|j| l[(i, j)] * x[j]).sum();
        }
        factor.solve(&mut product);
        let mut whitened = factor.whitened(&x);
        let expected: Vec<f64> = (0..3).map(|i| (0..3).map(|j| l[(j, i)] * x[j]).sum()).collect();
        let gap =
            |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(gap(&product, &x) < 1e-14 && gap(&whitened, &expected) < 1e-14);
        factor.solve_transposed(&mut whitened);
        assert!(gap(&whitened, &x) < 1e-14);
        for (i, variance) in factor.variances().into_iter().enumerate() {
            let mut column = [0.0; 3];
            column[i] = 1.0;
            factor.solve(&mut column);
            factor.solve_transposed(&mut column);
            assert!((variance - column[i]).abs() < 1e-14 * variance);
        }
    }

    #[test]
    fn what_is_no_precision_has_no_factor() {
        for entry in [-1.0, 0.0, f64::NAN, f64::INFINITY] {
            let matrix = Mat::from_fn(2, 2, |i, j| [[1.0, 0.1], [0.1, entry]][i][j]);
            assert!(Factor::of(matrix.as_ref()).is_none(), "{entry}");
        }
    }
}
