//! The smallest eigenpairs of `K φ = λ M φ` on a surface.
//!
//! With the symmetric form `M^−½ K M^−½ y = λ y`, `y = M^½ φ`: block Lanczos on the inverse of the
//! shifted operator, or a dense decomposition where the mesh is too small for a Krylov space.

use super::cholesky::Cholesky;
use super::lanczos::{self, BLOCK};
use super::laplacian::require_connected;
use super::{Basis, Laplacian, ManifoldError};
use crate::mesh::TriMesh;
use faer::{Mat, MatMut, MatRef, Side};
use std::f64::consts::PI;

/// More modes are refused: their wavelength would near the mesh's edges and their memory a machine's.
const MAX_MODES: usize = 2048;

/// The most `‖M^−½ (K φ − λ M φ)‖ / λ` may be; measured: 1e-11 to 3e-8 (160,000 vertices).
const MAX_RESIDUAL: f64 = 1e-6;

/// The `n_modes` smallest eigenpairs of the Laplace–Beltrami operator (P1, lumped mass, no-flux).
///
/// `K φ = λ M φ`, `φᵀ M φ = 1`, λ ascending in mm⁻², φ in mm⁻¹.  λ₀ = 0 and φ₀ = area^(−1/2)
/// exactly; the sign makes the largest entry of each mode positive.  Deterministic.
///
/// # Errors
/// [`ManifoldError::NoModes`], [`ManifoldError::TooManyModes`] (fewer than vertices, at most 2048),
/// [`ManifoldError::Disconnected`] and numerical failures.
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
    let laplacian = Laplacian::new(mesh);
    let vectors = if n_vertices <= lanczos::capacity(n_modes) + BLOCK {
        dense(&laplacian, n_modes)?
    } else {
        let operator = ShiftInvert::new(&laplacian)?;
        let found =
            lanczos::largest(&|input, out| operator.apply(input, out), n_vertices, n_modes)?;
        // An error of 1e-10 in the inverse operator is λ_max/λ times as large in K φ = λ M φ, and small
        // angles make λ_max huge. One more application damps just those components.
        let mut smoothed = found.clone();
        operator.apply(found.as_ref(), smoothed.as_mut());
        smoothed
    };
    finish(&laplacian, &vectors)
}

/// `M^½ (K + s M)⁻¹ M^½`, whose largest eigenvalues 1/(λ + s) belong to the smallest λ.
struct ShiftInvert {
    factor: Cholesky,
    sqrt_mass: Vec<f64>,
}

impl ShiftInvert {
    fn new(laplacian: &Laplacian) -> Result<Self, ManifoldError> {
        // A twentieth of a sphere's first eigenvalue, 8π/area: small beside λ₁, far from singular.
        let shift = 0.4 * PI / laplacian.area();
        Ok(Self {
            factor: Cholesky::new(laplacian, shift)?,
            sqrt_mass: laplacian.mass.iter().map(|m| m.sqrt()).collect(),
        })
    }

    fn scale_rows(&self, mut block: MatMut<'_, f64>) {
        for column in block.as_mut().col_iter_mut() {
            for (value, weight) in column.iter_mut().zip(&self.sqrt_mass) {
                *value *= weight;
            }
        }
    }

    fn apply(&self, input: MatRef<'_, f64>, mut out: MatMut<'_, f64>) {
        out.copy_from(input);
        self.scale_rows(out.as_mut());
        self.factor.solve(out.as_mut());
        self.scale_rows(out);
    }
}

/// Eigenvectors `y` `(n_vertices, n_modes)` by a dense decomposition.
fn dense(laplacian: &Laplacian, n_modes: usize) -> Result<Mat<f64>, ManifoldError> {
    let n = laplacian.mass.len();
    let mut matrix = Mat::<f64>::zeros(n, n);
    for row in 0..n {
        for (column, value) in laplacian.stiffness.row(row) {
            matrix[(row, column)] = value / (laplacian.mass[row] * laplacian.mass[column]).sqrt();
        }
    }
    let decomposition =
        matrix.self_adjoint_eigen(Side::Lower).map_err(|error| ManifoldError::LinearAlgebra {
            during: "the dense eigenproblem",
            reason: format!("{error:?}"),
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
    let mut modes =
        vec![Mode { eigenvalue: 0.0, values: vec![constant; laplacian.mass.len()], residual: 0.0 }];
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
    for v in &mut values {
        *v -= mean;
    }
    let norm = values.iter().zip(mass).map(|(v, m)| v * v * m).sum::<f64>().sqrt();
    let largest =
        values.iter().fold(0.0_f64, |best, &v| if v.abs() > best.abs() { v } else { best });
    for v in &mut values {
        *v /= norm * largest.signum();
    }
    let image = laplacian.stiffness.multiply(&values);
    let eigenvalue = values.iter().zip(&image).map(|(v, kv)| v * kv).sum::<f64>();
    let squared: f64 = (0..values.len())
        .map(|i| (image[i] - eigenvalue * mass[i] * values[i]).powi(2) / mass[i])
        .sum();
    Mode { eigenvalue, residual: squared.sqrt() / eigenvalue, values }
}

#[cfg(test)]
mod tests {
    use super::super::test_meshes::{icosphere, rectangle};
    use super::*;

    /// Worst `|φᵀ M φ − 1|` and `|φⱼᵀ M φₖ|`.
    fn orthonormality_error(mesh: &TriMesh, basis: &Basis) -> f64 {
        let mass = Laplacian::new(mesh).mass;
        let n = basis.n_modes();
        let mut gram = vec![0.0; n * n];
        for (vertex, m) in mass.iter().enumerate() {
            let modes = basis.at(vertex);
            for j in 0..n {
                for k in 0..n {
                    gram[j * n + k] += m * modes[j] * modes[k];
                }
            }
        }
        (0..n * n).map(|i| (gram[i] - f64::from(i % (n + 1) == 0)).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn sphere_eigenvalues_converge_with_order_two() {
        // l (l + 1) / r², each 2 l + 1 times; levels 3 and up go through Lanczos.
        let radius = 20.0;
        let exact: Vec<f64> = (0..4_i32)
            .flat_map(|l| vec![f64::from(l * (l + 1)) / (radius * radius); (2 * l + 1) as usize])
            .collect();
        let errors = [3, 4, 5].map(|level| {
            let basis = eigenpairs(&icosphere(level, radius), exact.len()).unwrap();
            (4..exact.len())
                .map(|k| (basis.eigenvalues[k] / exact[k] - 1.0).abs())
                .fold(0.0, f64::max)
        });
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            assert!((order - 2.0).abs() < 0.05, "order {order} from {errors:?}");
        }
        assert!(errors[2] < 1e-3, "{errors:?}");
    }

    #[test]
    fn every_copy_of_a_multiple_eigenvalue_is_found() {
        // Seen to fail with a block of one vector, which misses copies.
        // The gaps after 1, 1+3, 1+3+5, 1+3+5+7 modes are wide, the spread within each is small.
        let eigenvalues = eigenpairs(&icosphere(4, 1.0), 17).unwrap().eigenvalues;
        for l in 1..4 {
            let exact = (l * (l + 1)) as f64;
            for value in &eigenvalues[l * l..(l + 1) * (l + 1)] {
                assert!((value / exact - 1.0).abs() < 0.01, "l = {l}: {value}");
            }
        }
        assert!((eigenvalues[16] / 20.0 - 1.0).abs() < 0.02);
    }

    #[test]
    fn open_edges_carry_no_flux() {
        // Neumann modes of a rectangle: π² (i²/a² + j²/b²).
        let mesh = rectangle(60, 40, 0.5);
        let eigenvalues = eigenpairs(&mesh, 8).unwrap().eigenvalues;
        let mut exact: Vec<f64> = (0..5)
            .flat_map(|i| (0..5).map(move |j| (f64::from(i), f64::from(j))))
            .map(|(i, j)| PI * PI * (i * i / 900.0 + j * j / 400.0))
            .collect();
        exact.sort_by(f64::total_cmp);
        for k in 1..8 {
            assert!((eigenvalues[k] / exact[k] - 1.0).abs() < 3e-3, "{k}: {eigenvalues:?}");
        }
    }

    #[test]
    fn modes_are_orthonormal_with_the_constant_exact_and_signs_fixed() {
        let mesh = rectangle(40, 30, 1.0);
        let basis = eigenpairs(&mesh, 24).unwrap();
        let error = orthonormality_error(&mesh, &basis);
        assert!(error < 1e-9, "{error:e}");
        assert!(basis.eigenvalues.is_sorted());
        assert_eq!(basis.eigenvalues[0].to_bits(), 0.0_f64.to_bits());
        for k in 0..24 {
            let column: Vec<f64> = (0..basis.n_vertices()).map(|v| basis.at(v)[k]).collect();
            let highest = column.iter().copied().fold(f64::MIN, f64::max);
            let lowest = column.iter().copied().fold(f64::MAX, f64::min);
            assert!(highest >= -lowest * (1.0 - 1e-12), "mode {k}: {lowest} to {highest}");
            if k == 0 {
                assert_eq!(highest.to_bits(), lowest.to_bits());
                assert!((highest - 1200.0_f64.powf(-0.5)).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn lanczos_agrees_with_the_dense_decomposition() {
        let mesh = rectangle(17, 13, 1.0);
        let few = eigenpairs(&mesh, 20).unwrap();
        assert!(mesh.n_vertices() > lanczos::capacity(20) + BLOCK, "few must go through Lanczos");
        let all = eigenpairs(&mesh, mesh.n_vertices() - 1).unwrap();
        for k in 1..20 {
            let relative = (few.eigenvalues[k] / all.eigenvalues[k] - 1.0).abs();
            assert!(relative < 1e-12, "mode {k}: {relative:e}");
        }
        assert!(orthonormality_error(&mesh, &all) < 1e-11);
    }

    #[test]
    fn two_runs_give_the_same_bits() {
        let mesh = icosphere(3, 10.0);
        let [one, two] = [0, 1].map(|_| eigenpairs(&mesh, 16).unwrap().eigenfunctions);
        assert!(one.iter().zip(&two).all(|(a, b)| a.to_bits() == b.to_bits()));
    }

    #[test]
    fn impossible_requests_say_what_is_possible() {
        let mesh = rectangle(3, 2, 1.0);
        let message = |n_modes| eigenpairs(&mesh, n_modes).unwrap_err().to_string();
        assert!(message(0).contains("at least 1 mode"));
        assert!(message(12).contains("at most 11"), "{}", message(12));
        assert!(eigenpairs(&mesh, 11).is_ok());
    }

    #[test]
    fn a_surface_in_pieces_is_refused() {
        let mesh = rectangle(2, 2, 1.0);
        let (mut vertices, mut triangles) = (mesh.vertices().to_vec(), mesh.triangles().to_vec());
        vertices.extend(mesh.vertices().iter().map(|v| [v[0] + 10.0, v[1], v[2]]));
        triangles.extend(mesh.triangles().iter().map(|t| t.map(|v| v + 9)));
        let two_pieces = TriMesh::new(vertices, triangles).unwrap();
        let error = eigenpairs(&two_pieces, 3).unwrap_err();
        assert!(
            matches!(
                error,
                ManifoldError::Disconnected { n_pieces: 2, largest: 9, n_vertices: 18 }
            ),
            "{error}"
        );
    }

    /// A clinical shell rounded to 3 decimals has angles below 1° and failed for 8 and 24 modes, but
    /// not for 16 and 32: it is chance how far beyond its tolerance the iteration ends.
    #[test]
    fn very_small_angles_do_not_spoil_the_smallest_modes() {
        let plain = rectangle(30, 40, 1.0);
        let mut thin = plain.vertices().to_vec();
        for vertex in &mut thin {
            if (vertex[0] - 15.0).abs() < 0.5 {
                vertex[0] = 14.0002; // a column of triangles 0.0002 mm wide
            }
        }
        let mesh = TriMesh::new(thin, plain.triangles().to_vec()).unwrap();
        let many = eigenpairs(&mesh, 40).unwrap();
        for n_modes in 5..30 {
            let basis = eigenpairs(&mesh, n_modes).unwrap();
            for (a, b) in basis.eigenvalues.iter().zip(&many.eigenvalues) {
                assert!((a - b).abs() <= 1e-9 * b, "{n_modes} modes: {a} against {b}");
            }
        }
    }
}
