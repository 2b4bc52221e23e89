//! Cholesky factors of covariance and correlation matrices whose numbers carry derivatives.

use std::ops::Index;

use super::{OneOrEach, of_each};
use crate::num::{Argument, Real};

/// The lower-triangular factor L of a covariance or correlation matrix `L Lᵀ`, zero above the diagonal.
///
/// `l[i][j]` is row i, column j, counted from 0.
#[derive(Clone, Copy, Debug)]
pub struct CholeskyFactor<D, const N: usize>(
    /// Rows of L.
    pub [[D; N]; N],
);

impl<D, const N: usize> Index<usize> for CholeskyFactor<D, N> {
    type Output = [D; N];
    fn index(&self, row: usize) -> &[D; N] {
        &self.0[row]
    }
}

impl<D: Real, const N: usize> CholeskyFactor<D, N> {
    /// The factor of `diag(sd) L Lᵀ diag(sd)`: it makes a covariance matrix of a correlation
    /// matrix. `sd` is one standard deviation for all rows, or one for each row.
    #[must_use]
    pub fn scaled<const M: usize, K>(mut self, sd: impl OneOrEach<D, M, K>) -> Self {
        let sd = sd.each();
        for (i, row) in self.0.iter_mut().enumerate() {
            for x in row {
                *x *= of_each(&sd, i);
            }
        }
        self
    }

    /// `L z`. If z are independent standard normal numbers, these are normal numbers with this
    /// covariance.
    #[must_use]
    pub fn times(&self, z: [D; N]) -> [D; N] {
        std::array::from_fn(|i| (0..=i).fold(D::from(0.0), |sum, j| sum + self.0[i][j] * z[j]))
    }

    /// Number (i, j) of `L Lᵀ`.
    #[must_use]
    pub fn product(&self, i: usize, j: usize) -> D {
        (0..=i.min(j)).fold(D::from(0.0), |sum, k| sum + self.0[i][k] * self.0[j][k])
    }
}

/// The Cholesky factor of a covariance matrix of numbers or parameters.
///
/// Its numbers are NaN if the matrix is not symmetric or not positive definite.
pub fn cholesky<D: Real, T: Argument<D>, const N: usize>(
    covariance: [[T; N]; N],
) -> CholeskyFactor<D, N> {
    let a = covariance.map(|row| row.map(Argument::number));
    let mut l = [[D::from(0.0); N]; N];
    for i in 0..N {
        for j in 0..=i {
            let is_symmetric = a[i][j].re().to_bits() == a[j][i].re().to_bits();
            let known = (0..j).fold(D::from(0.0), |sum, k| sum + l[i][k] * l[j][k]);
            let rest = a[i][j] - known;
            l[i][j] = match (i == j, is_symmetric) {
                (_, false) => D::from(f64::NAN),
                (true, _) if rest.re() > 0.0 => rest.sqrt(),
                (true, _) => D::from(f64::NAN),
                (false, _) => rest / l[j][j],
            };
        }
    }
    CholeskyFactor(l)
}

/// The Cholesky factor of the correlation matrix that the numbers of a parameter with the prior
/// [`LkjCholesky`](super::LkjCholesky) describe. The numbers are in the order of that prior.
pub fn correlation_cholesky<T: CorrelationRows>(below_the_diagonal: T) -> T::Factor {
    below_the_diagonal.factor()
}

/// An array of the numbers below the diagonal of a matrix of 2 to 12 rows.
#[diagnostic::on_unimplemented(
    message = "`{Self}` does not fill the part of a matrix below its diagonal",
    label = "expected a parameter of 1, 3, 6, 10, 15, … numbers: N(N − 1)/2, N up to 12"
)]
pub trait CorrelationRows {
    /// A [`CholeskyFactor`].
    type Factor;
    /// Puts the numbers in their places, and adds the diagonal that makes every row's length 1.
    fn factor(self) -> Self::Factor;
}

macro_rules! correlation_rows {
    ($($N:literal)*) => {$(
        impl<D: Real> CorrelationRows for [D; $N * ($N - 1) / 2] {
            type Factor = CholeskyFactor<D, $N>;
            fn factor(self) -> Self::Factor {
                let mut l = [[D::from(0.0); $N]; $N];
                let mut numbers = self.into_iter();
                for (i, row) in l.iter_mut().enumerate() {
                    let mut rest = D::from(1.0);
                    for (x, number) in row[..i].iter_mut().zip(&mut numbers) {
                        *x = number;
                        rest -= number * number;
                    }
                    row[i] = rest.sqrt();
                }
                CholeskyFactor(l)
            }
        }
    )*};
}
correlation_rows! { 2 3 4 5 6 7 8 9 10 11 12 }

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{Dual, derivatives, variable};

    #[test]
    fn a_factor_gives_its_matrix_back() {
        let a = [[4.0, 2.0, 0.6], [2.0, 5.0, -1.0], [0.6, -1.0, 3.0]];
        let l: CholeskyFactor<f64, 3> = cholesky(a);
        for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
            assert!((l.product(i, j) - a[i][j]).abs() < 1e-14, "{i} {j}");
            assert!(j <= i || l[i][j].to_bits() == 0f64.to_bits());
        }
        let scaled = l.scaled([1.0, 2.0, 3.0]);
        assert!((scaled.product(2, 1) + 6.0).abs() < 1e-14);
        assert!((l.times([0.0, 1.0, 0.0])[2] - l[2][1]).abs() < 1e-15);
    }

    #[test]
    fn what_is_no_covariance_has_no_factor() {
        let singular: CholeskyFactor<f64, 2> = cholesky([[1.0, 1.0], [1.0, 1.0]]);
        let skew: CholeskyFactor<f64, 2> = cholesky([[1.0, 0.2], [0.1, 1.0]]);
        assert!(singular[1][1].is_nan() && skew[1][0].is_nan());
    }

    #[test]
    fn rows_of_a_correlation_have_length_one() {
        let l = correlation_cholesky([0.3, -0.4, 0.5]);
        for i in 0..3 {
            assert!((l.product(i, i) - 1.0).abs() < 1e-15, "{i}");
        }
        assert!((l[1][0] - 0.3).abs() < 1e-15 && (l[2][1] - 0.5).abs() < 1e-15);
    }

    #[test]
    fn a_factors_derivative_matches_a_difference() {
        let at = |x: f64| cholesky::<f64, f64, 2>([[2.0, x], [x, 3.0]])[1][1];
        let x = variable::<1>(0.7, 0);
        let two = [Dual::from(2.0), x];
        let l = cholesky([two, [x, Dual::from(3.0)]]);
        let difference = (at(0.7 + 1e-5) - at(0.7 - 1e-5)) / 2e-5;
        assert!((derivatives(&l[1][1])[0] - difference).abs() < 1e-9);
    }
}
