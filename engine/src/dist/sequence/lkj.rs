//! Correlation matrices, by their Cholesky factor.

use rand::{Rng, RngExt};

use super::{Sequence, Step};
use crate::dist::{Support, ln_gamma, ln_logistic};
use crate::num::Real;

family! {
    /// Lewandowski, Kurowicka and Joe's distribution of correlation matrices R, with the density `∝
    /// det(R)^(eta − 1)`. It is uniform if `eta` is 1. The larger `eta` is, the nearer R is to no
    /// correlation.
    ///
    /// The n = N(N − 1)/2 numbers of the parameter are those below the diagonal of the Cholesky
    /// factor L of `R = L Lᵀ`, row by row: `L₁₀, L₂₀, L₂₁, L₃₀, …` (rows and columns counted from
    /// 0). The diagonal follows from them, because every row of L has length 1.
    /// [`correlation_cholesky`](super::correlation_cholesky) gives the whole of L. If N = 2, the
    /// one number is the correlation.
    ///
    /// The numbers are made from canonical partial correlations: `Lᵢⱼ = zᵢⱼ √(1 − Σ_{k<j} Lᵢₖ²)`,
    /// `zᵢⱼ = tanh(u/2)`. These are independent, with `(z + 1)/2 ~ Beta(a, a)` and `a = eta + (N −
    /// 2 − j)/2`.
    ///
    /// # Source
    /// Lewandowski, Kurowicka and Joe 2009, "Generating random correlation matrices based on vines and
    /// extended onion method"
    LkjCholesky(eta: "shape, positive");
}

/// The number of rows N of the smallest matrix with at least `n` numbers below its diagonal.
fn n_rows(n: usize) -> usize {
    let mut rows = 2;
    while rows * (rows - 1) / 2 < n {
        rows += 1;
    }
    rows
}

/// Column of number `i` below the diagonal.
fn column(i: usize) -> usize {
    let mut column = i;
    let mut row = 1;
    while column >= row {
        column -= row;
        row += 1;
    }
    column
}

impl<D: Real> LkjCholesky<D> {
    /// Shape of the partial correlations in a column.
    fn shape(&self, column: usize, n: usize) -> D {
        self.eta + 0.5 * (n_rows(n) as f64 - 2.0 - column as f64)
    }
}

/// The carry is what is left of the square of a row's length.
impl<D: Real> Sequence<D> for LkjCholesky<D> {
    fn support(&self) -> Support {
        Support::Described("below the diagonal of a correlation's Cholesky factor")
    }
    fn length(&self, n: usize) -> usize {
        let rows = n_rows(n);
        rows * (rows - 1) / 2
    }
    fn step(&self, i: usize, n: usize, u: D, carry: &mut [D]) -> Step<D> {
        let column = column(i);
        if column == 0 {
            carry[0] = D::from(1.0);
        }
        let ln_share = ln_logistic(u) + ln_logistic(-u);
        let x = (u * 0.5).tanh() * carry[0].sqrt();
        carry[0] *= ln_share.exp() * 4.0; // 1 − z²
        Step { x, ln_kernel: self.shape(column, n) * ln_share }
    }
    fn unconstrain(&self, i: usize, _: usize, x: f64, carry: &[f64]) -> f64 {
        let rest = if column(i) == 0 { 1.0 } else { carry[0] };
        2.0 * (x / rest.sqrt()).atanh()
    }
    fn ln_norm(&self, n: usize) -> D {
        let ln_beta = |i: usize| {
            let shape = self.shape(column(i), n);
            ln_gamma(shape) * 2.0 - ln_gamma(shape * 2.0)
        };
        (0..n).fold(D::from(0.0), |sum, i| sum - ln_beta(i))
    }
    fn sample(&self, n: usize, rng: &mut dyn Rng) -> Option<Vec<f64>> {
        let mut rest = 1.0;
        let number = |i: usize| {
            let shape = self.shape(column(i), n).re();
            let z = 2.0 * rng.sample(rand_distr::Beta::new(shape, shape).ok()?) - 1.0;
            if column(i) == 0 {
                rest = 1.0;
            }
            let x = z * f64::sqrt(rest);
            rest *= 1.0 - z * z;
            Some(x)
        };
        (0..n).map(number).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_row_by_row_below_the_diagonal() {
        let columns: Vec<usize> = (0..10).map(column).collect();
        assert_eq!(columns, [0, 0, 1, 0, 1, 2, 0, 1, 2, 3]);
        let lengths: Vec<usize> = (1..8).map(|n| LkjCholesky::<f64>(1.0).length(n)).collect();
        assert_eq!(lengths, [1, 3, 3, 6, 6, 6, 10]);
    }
}
