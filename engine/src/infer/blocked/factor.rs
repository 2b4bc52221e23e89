//! The Cholesky factor of a small matrix with one further column, in rows of whole vector
//! registers.

const LANES: usize = 4;

/// Neighbouring columns of a row.
pub(super) type Lanes = [f64; LANES];

/// U of `B = UᵀU` for a symmetric `(n, n)`, and `U⁻ᵀ c` for one further column c.
///
/// Rows are padded to whole lanes. From row n on, only entry (n, n) means anything.
#[derive(Clone, Debug)]
pub(super) struct Upper {
    n: usize,
    /// Lanes of a row.
    width: usize,
    /// Row-major. What is below the diagonal means nothing.
    rows: Vec<Lanes>,
}

impl Upper {
    /// Memory.
    pub(super) fn new(n: usize) -> Self {
        let width = lanes(n);
        Self { n, width, rows: vec![[0.0; LANES]; LANES * width * width] }
    }

    /// Row `i` from its first column to column n, writable.
    pub(super) fn row_mut(&mut self, i: usize) -> &mut [f64] {
        &mut self.rows.as_flattened_mut()[LANES * self.width * i..][..=self.n]
    }

    /// Row `i` of U from the diagonal on, without the further column.
    pub(super) fn row(&self, i: usize) -> &[f64] {
        &self.rows.as_flattened()[LANES * self.width * i..][i..self.n]
    }

    /// Entry `i` of the further column.
    pub(super) fn last(&self, i: usize) -> f64 {
        self.rows.as_flattened()[LANES * self.width * i + self.n]
    }

    /// Sets the matrix to `leftᵀ right`, of columns 0 to n of two matrices whose rows are as long
    /// as these. For each four columns of the left matrix, `support` has the rows that are not zero
    /// there.
    #[inline(always)]
    pub(super) fn set_product(&mut self, left: &[Lanes], right: &[Lanes], support: &[Vec<usize>]) {
        let width = self.width;
        for (b, (rows, support)) in
            self.rows.chunks_exact_mut(LANES * width).zip(support).enumerate()
        {
            for c in b..width {
                let mut sum = [[0.0; LANES]; LANES];
                for k in support {
                    add_outer(&mut sum, 1.0, &left[k * width + b], &right[k * width + c]);
                }
                for (row, sum) in rows.chunks_exact_mut(width).zip(sum) {
                    row[c] = sum;
                }
            }
        }
    }

    /// Factorises in place. Returns ln|U| and what is left of entry (n, n), which is `B(n, n) −
    /// |U⁻ᵀ c|²`. Returns `None` if B is not positive definite.
    #[inline(always)]
    pub(super) fn factorise(&mut self) -> Option<(f64, f64)> {
        let (n, width) = (self.n, self.width);
        let (mut ln_det, mut product, mut left) = (0.0, 1.0, 0.0);
        for b in 0..width {
            let (done, rest) = self.rows.split_at_mut(LANES * b * width);
            let (mut diagonal, mut inverse) = ([[0.0; LANES]; LANES], [0.0; LANES]);
            for c in b..width {
                let mut x: [Lanes; LANES] = std::array::from_fn(|r| rest[r * width + c]);
                for row in done.chunks_exact(width) {
                    add_outer(&mut x, -1.0, &row[b], &row[c]);
                }
                for r in 0..LANES {
                    for s in 0..r {
                        let (u, above) = (if c == b { x[s][r] } else { diagonal[s][r] }, x[s]);
                        add_lanes(&mut x[r], -u, &above);
                    }
                    let i = LANES * b + r;
                    if c == b && i < n {
                        let pivot = x[r][r].sqrt();
                        if !(pivot > 0.0 && pivot < f64::INFINITY) {
                            return None;
                        }
                        inverse[r] = 1.0 / pivot;
                        product *= pivot;
                    } else if c == b && i == n {
                        left = x[r][r];
                    }
                    x[r].iter_mut().for_each(|x| *x *= inverse[r]);
                }
                if c == b {
                    diagonal = x;
                }
                for (r, x) in x.into_iter().enumerate() {
                    rest[r * width + c] = x;
                }
            }
            if !(1e-100..1e100).contains(&product) {
                ln_det += product.ln();
                product = 1.0;
            }
        }
        Some((ln_det + product.ln(), left))
    }
}

/// Lanes of a row of n columns and one more.
pub(super) fn lanes(n: usize) -> usize {
    (n + 1).div_ceil(LANES)
}

/// The columns of each of a row's lanes.
pub(super) fn columns(n: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    (0..lanes(n)).map(|b| LANES * b..LANES * (b + 1))
}

/// m += s a bᵀ
#[inline(always)]
fn add_outer(m: &mut [Lanes; LANES], s: f64, a: &Lanes, b: &Lanes) {
    for (row, a) in m.iter_mut().zip(a) {
        add_lanes(row, s * a, b);
    }
}

/// y += c x
#[inline(always)]
pub(super) fn add_lanes(y: &mut Lanes, c: f64, x: &Lanes) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += c * x;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the definition, for sizes around whole lanes.
    #[test]
    fn the_factor_and_the_further_column_solve_the_system() {
        for n in 1..14 {
            let entry = |i: usize, j: usize| ((i * 7 + j * 3) % 11) as f64 - 4.5;
            let width = lanes(n);
            // A (m, n + 1), so that AᵀA is positive definite
            let m = n + 3;
            let mut a = vec![[0.0; LANES]; m * width];
            for k in 0..m {
                for j in 0..=n {
                    a.as_flattened_mut()[k * width * LANES + j] =
                        entry(k, j) + if k == j { 9.0 } else { 0.0 };
                }
            }
            let at = |k: usize, j: usize| a.as_flattened()[k * width * LANES + j];
            let b = |i: usize, j: usize| (0..m).map(|k| at(k, i) * at(k, j)).sum::<f64>();
            let mut upper = Upper::new(n);
            upper.set_product(&a, &a, &vec![(0..m).collect(); width]);
            let (ln_det, left) = upper.factorise().unwrap();
            let u = |k: usize, i: usize| if k <= i { upper.row(k)[i - k] } else { 0.0 };
            for i in 0..n {
                for j in i..n {
                    let sum: f64 = (0..n).map(|k| u(k, i) * u(k, j)).sum();
                    assert!((sum - b(i, j)).abs() < 1e-10 * b(i, i).max(b(j, j)));
                }
                let sum: f64 = (0..=i).map(|k| u(k, i) * upper.last(k)).sum();
                assert!((sum - b(i, n)).abs() < 1e-10 * b(i, i).max(b(n, n)));
            }
            let squares: f64 = (0..n).map(|k| upper.last(k).powi(2)).sum();
            assert!((left - (b(n, n) - squares)).abs() < 1e-10 * b(n, n));
            let sum: f64 = (0..n).map(|k| u(k, k).ln()).sum();
            assert!((ln_det - sum).abs() < 1e-10 * n as f64);
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factor() {
        let mut upper = Upper::new(2);
        upper.row_mut(0)[..2].copy_from_slice(&[1.0, 2.0]);
        upper.row_mut(1)[1] = 3.0;
        assert!(upper.factorise().is_none());
    }
}
