//! The smallest eigenpairs of `K φ = λ M φ` on a surface.
//!
//! With the symmetric form `M^−½ K M^−½ y = λ y`, `y = M^½ φ`: block Lanczos on the inverse of the
//! shifted operator, or a dense decomposition where the mesh is too small for a Krylov space.

use super::cholesky::Cholesky;
use super::lanczos::{self, BLOCK, Operator};
use super::laplacian::require_connected;
use super::{Basis, Laplacian, ManifoldError};
use crate::mesh::TriMesh;
use faer::{Mat, MatMut, MatRef, Side};
use std::f64::consts::PI;

/// More modes are refused: their wavelength would near the mesh's edges and their memory a machine's.
const MAX_MODES: usize = 2048;

/// The most `‖M^−½ (K φ − λ M φ)‖ / λ` may be; it measures about a hundredth of this.
const MAX_RESIDUAL: f64 = 1e-6;

/// The `n_modes` smallest eigenpairs of the Laplace–Beltrami operator (P1, lumped mass, no-flux).
///
/// `K φ = λ M φ`, `φᵀ M φ = 1`, λ ascending in mm⁻², φ in mm⁻¹.  λ₀ = 0 and φ₀ = area^(−1/2)
/// exactly; the sign makes the largest entry of each mode positive.  Deterministic.
///
/// # Errors
/// [`ManifoldError::NoModes`], [`ManifoldError::TooManyModes`] (fewer than vertices, at most 2048),
/// [`ManifoldError::Disconnected`], [`ManifoldError::DegenerateTriangle`], and numerical failures.
pub fn eigenpairs(mesh: &TriMesh, n_modes: usize) -> Result<Basis, ManifoldError> {
    let n_vertices = mesh.n_vertices();
    let largest = MAX_MODES.min(n_vertices.saturating_sub(1));
    if n_modes == 0 {
        return Err(ManifoldError::NoModes);
    }
    if n_modes > largest {
        return Err(ManifoldError::TooManyModes { n_modes, n_vertices, largest });
    }
    require_connected(mesh)?;
    let laplacian = Laplacian::new(mesh)?;
    let vectors = if n_vertices <= lanczos::capacity(n_modes) + BLOCK {
        dense(&laplacian, n_modes)?
    } else {
        lanczos::largest(&mut ShiftInvert::new(&laplacian)?, n_vertices, n_modes)?
    };
    finish(&laplacian, &vectors)
}

/// `M^½ (K + s M)⁻¹ M^½`, whose largest eigenvalues 1/(λ + s) belong to the smallest λ.
struct ShiftInvert {
    factor: Cholesky,
    sqrt_mass: Vec<f64>,
    block: Vec<[f64; BLOCK]>,
}

impl ShiftInvert {
    fn new(laplacian: &Laplacian) -> Result<Self, ManifoldError> {
        // A tenth of a sphere's first eigenvalue, 8π/area, halved: small beside λ₁, far from singular.
        let shift = 0.4 * PI / laplacian.area();
        Ok(Self {
            factor: Cholesky::new(laplacian, shift)?,
            sqrt_mass: laplacian.mass.iter().map(|m| m.sqrt()).collect(),
            block: vec![[0.0; BLOCK]; laplacian.mass.len()],
        })
    }
}

impl Operator for ShiftInvert {
    fn apply(&mut self, input: MatRef<'_, f64>, mut out: MatMut<'_, f64>) {
        for column in 0..BLOCK {
            for ((row, value), weight) in self.block.iter_mut().zip(input.col(column).iter()).zip(&self.sqrt_mass) {
                row[column] = value * weight;
            }
        }
        self.factor.solve(&mut self.block);
        for column in 0..BLOCK {
            for ((row, value), weight) in self.block.iter().zip(out.as_mut().col_mut(column).iter_mut()).zip(&self.sqrt_mass) {
                *value = row[column] * weight;
            }
        }
    }
}

/// Eigenvectors `y` (n_vertices, n_modes) by a dense decomposition.
fn dense(laplacian: &Laplacian, n_modes: usize) -> Result<Mat<f64>, ManifoldError> {
    let n = laplacian.mass.len();
    let mut matrix = Mat::<f64>::zeros(n, n);
    for row in 0..n {
        for (column, value) in laplacian.stiffness.row(row) {
            matrix[(row, column)] = value / (laplacian.mass[row] * laplacian.mass[column]).sqrt();
        }
    }
    let decomposition = matrix.self_adjoint_eigen(Side::Lower).map_err(|error| {
        ManifoldError::LinearAlgebra {
            during: "the dense eigenproblem",
            reason: format!("{error:?}"),
        }
    })?;
    Ok(decomposition.U().subcols(0, n_modes).to_owned())
}

/// One eigenpair with the residual it leaves.
struct Mode {
    eigenvalue: f64,
    values: Vec<f64>,
    residual: f64,
}

/// From eigenvectors `y = M^½ φ` to the basis, in the order of their Rayleigh quotients.
fn finish(laplacian: &Laplacian, vectors: &Mat<f64>) -> Result<Basis, ManifoldError> {
    let n_modes = vectors.ncols();
    // The first vector approximates the constant, which is known exactly.
    let constant = laplacian.area().sqrt().recip();
    let mut modes = vec![Mode {
        eigenvalue: 0.0,
        values: vec![constant; laplacian.mass.len()],
        residual: 0.0,
    }];
    modes.extend((1..n_modes).map(|k| polish(laplacian, vectors.col(k).iter().copied())));
    modes.sort_by(|a, b| a.eigenvalue.total_cmp(&b.eigenvalue));
    let worst = modes.iter().map(|mode| mode.residual).fold(0.0, f64::max);
    if worst.is_nan() || worst > MAX_RESIDUAL {
        let converged = modes.iter().filter(|mode| mode.residual <= MAX_RESIDUAL).count();
        return Err(ManifoldError::NotConverged { n_modes, converged, worst });
    }
    let n_vertices = laplacian.mass.len();
    Ok(Basis {
        eigenvalues: modes.iter().map(|mode| mode.eigenvalue).collect(),
        eigenfunctions: (0..n_vertices)
            .flat_map(|vertex| modes.iter().map(move |mode| mode.values[vertex]))
            .collect(),
    })
}

/// Removes the mean, normalises, fixes the sign and takes the Rayleigh quotient.
fn polish(laplacian: &Laplacian, vector: impl Iterator<Item = f64>) -> Mode {
    let mass = &laplacian.mass;
    let mut values: Vec<f64> = vector.zip(mass).map(|(y, m)| y / m.sqrt()).collect();
    let mean = values.iter().zip(mass).map(|(v, m)| v * m).sum::<f64>() / laplacian.area();
    values.iter_mut().for_each(|v| *v -= mean);
    let norm = values.iter().zip(mass).map(|(v, m)| v * v * m).sum::<f64>().sqrt();
    let largest = values.iter().fold(0.0_f64, |best, &v| if v.abs() > best.abs() { v } else { best });
    values.iter_mut().for_each(|v| *v /= norm * largest.signum());
    let image = laplacian.stiffness.multiply(&values);
    let eigenvalue = values.iter().zip(&image).map(|(v, kv)| v * kv).sum::<f64>();
    let squared: f64 = (0..values.len())
        .map(|i| (image[i] - eigenvalue * mass[i] * values[i]).powi(2) / mass[i])
        .sum();
    Mode { eigenvalue, residual: squared.sqrt() / eigenvalue, values }
}

#[cfg(test)]
mod tests {
    use super::super::test_meshes::icosphere;
    use super::*;
    use std::time::Instant;

    #[test]
    fn timing() {
        for (level, k) in [(4, 32), (5, 32), (5, 256), (7, 32)] {
            let mesh = icosphere(level, 10.0);
            let t = Instant::now();
            let basis = eigenpairs(&mesh, k).unwrap();
            println!("{} {k} {:.3}", mesh.n_vertices(), t.elapsed().as_secs_f64());
            println!("{:?}", basis.eigenvalues.iter().take(10).map(|v| v * 100.0).collect::<Vec<_>>());
        }
    }
}
