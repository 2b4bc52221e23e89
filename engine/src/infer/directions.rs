//! Directions in which draws spread much more, or much less, than their coordinates' scales tell.
//!
//! With the draws' positions and gradients in units of the scales, and their covariances `C_q` and
//! `C_g`, the inverse mass matrix that minimises the Fisher divergence solves `M⁻¹ C_g M⁻¹ = C_q`: it
//! is the geometric mean of `C_q` and `C_g⁻¹`. For a normal it is exact for any draws that span the
//! space, however few and however correlated. It is computed in the space that the draws and
//! gradients span. Elsewhere, and along directions of nearly unit spread, it is left to the scales.
//!
//! # Source
//! Seyboldt, Carlson & Carpenter, "Preconditioning Hamiltonian Monte Carlo by minimizing Fisher
//! divergence" (the low-rank metric).

use super::hamiltonian::{Metric, Shape};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par, Side};

/// Added to both covariances: where neither positions nor gradients vary, the spread is 1.
const FLOOR: f64 = 1e-5;
/// A direction counts if its variance is larger than this, or smaller than the reciprocal.
const LEAST: f64 = 2.0;

/// Replaces the metric's directions by those of these draws, each row-major `(n, dim)`. They stay as
/// they are if something is not finite.
pub(super) fn fit(positions: &[f64], gradients: &[f64], metric: &mut Metric) {
    if let Some((directions, stretch)) = directions(positions, gradients, &metric.scale) {
        metric.shape = Shape::Stretched { directions, stretch };
    }
}

fn directions(positions: &[f64], gradients: &[f64], scale: &[f64]) -> Option<(Vec<f64>, Vec<f64>)> {
    let dim = scale.len();
    let positions = centred(positions, dim, |i| 1.0 / scale[i]);
    let gradients = centred(gradients, dim, |i| scale[i]);
    let n = positions.ncols();
    let (basis, c_q, c_g) =
        if 2 * n < dim {
            let both = Mat::from_fn(dim, 2 * n, |i, j| {
                if j < n { positions[(i, j)] } else { gradients[(i, j - n)] }
            });
            let basis = both.qr().compute_thin_Q();
            let within = |m: &Mat<f64>| covariance((basis.transpose() * m).as_ref());
            let (c_q, c_g) = (within(&positions), within(&gradients));
            (Some(basis), c_q, c_g)
        } else {
            (None, covariance(positions.as_ref()), covariance(gradients.as_ref()))
        };
    let mean = geometric_mean(&c_q, &c_g)?;
    let eigen = mean.self_adjoint_eigen(Side::Lower).ok()?;
    let (vectors, values) = (eigen.U(), eigen.S().column_vector());
    let (mut directions, mut stretch) = (vec![], vec![]);
    for r in 0..values.nrows() {
        let variance = values[r];
        if !(variance > 0.0 && variance.is_finite()) {
            return None;
        }
        if (LEAST.recip()..LEAST).contains(&variance) {
            continue;
        }
        stretch.push(variance.sqrt());
        match &basis {
            Some(basis) => directions.extend((basis * vectors.col(r)).iter()),
            None => directions.extend(vectors.col(r).iter()),
        }
    }
    Some((directions, stretch))
}

/// Rows of draws as columns, minus their mean, each coordinate times its factor.
fn centred(rows: &[f64], dim: usize, factor: impl Fn(usize) -> f64) -> Mat<f64> {
    let n = rows.len() / dim;
    let mean = |i: usize| rows[i..].iter().step_by(dim).sum::<f64>() / n as f64;
    let means: Vec<f64> = (0..dim).map(mean).collect();
    Mat::from_fn(dim, n, |i, j| factor(i) * (rows[j * dim + i] - means[i]))
}

/// Of the columns, with the floor on its diagonal.
fn covariance(m: MatRef<'_, f64>) -> Mat<f64> {
    let mut c = Mat::<f64>::identity(m.nrows(), m.nrows()) * faer::Scale(FLOOR);
    let n = 1.0 / m.ncols() as f64;
    matmul(&mut c, Accum::Add, m, m.transpose(), n, Par::Seq);
    c
}

/// The symmetric positive definite X with X B X = A: `A^½ (A^½ B A^½)^−½ A^½`.
fn geometric_mean(a: &Mat<f64>, b: &Mat<f64>) -> Option<Mat<f64>> {
    let root = power(a, 0.5)?;
    let inner = power(&(&root * b * &root), -0.5)?;
    Some(&root * inner * &root)
}

/// A symmetric positive definite matrix to a power.
fn power(m: &Mat<f64>, exponent: f64) -> Option<Mat<f64>> {
    let eigen = m.self_adjoint_eigen(Side::Lower).ok()?;
    let (u, values) = (eigen.U(), eigen.S().column_vector());
    let is_positive = (0..values.nrows()).all(|r| values[r] > 0.0 && values[r].is_finite());
    let scaled = Mat::from_fn(m.nrows(), m.nrows(), |i, r| u[(i, r)] * values[r].powf(exponent));
    is_positive.then(|| scaled * u.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    /// Any draws of a normal that span the space tell its covariance exactly.
    #[test]
    fn a_normal_is_known_from_a_few_draws() {
        let dim = 6;
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut uniform = |_: usize, _: usize| rng.random_range(-1.0..1.0);
        let root = Mat::from_fn(dim, dim, &mut uniform);
        let covariance =
            &root * root.transpose() + Mat::<f64>::identity(dim, dim) * faer::Scale(0.1);
        let precision = power(&covariance, -1.0).unwrap();
        let draws = Mat::from_fn(dim, 12, &mut uniform);
        let gradients = &precision * &draws * faer::Scale(-1.0);
        let rows = |m: &Mat<f64>| -> Vec<f64> {
            m.col_iter().flat_map(|c| c.iter().copied().collect::<Vec<_>>()).collect()
        };
        let mut metric = Metric::diagonal(vec![1.0; dim]);
        fit(&rows(&draws), &rows(&gradients), &mut metric);
        let Shape::Stretched { directions, stretch } = &metric.shape else { panic!("{metric:?}") };
        for (u, stretch) in directions.chunks_exact(dim).zip(stretch) {
            let u = Mat::from_fn(dim, 1, |i, _| u[i]);
            let variance = (u.transpose() * &covariance * &u)[(0, 0)];
            assert!((variance / stretch.powi(2) - 1.0).abs() < 1e-2, "{variance} {stretch}");
        }
        let eigen = covariance.self_adjoint_eigen(Side::Lower).unwrap();
        let far = eigen.S().column_vector().iter().filter(|v| !(0.5..2.0).contains(*v)).count();
        assert_eq!(stretch.len(), far);
    }
}
