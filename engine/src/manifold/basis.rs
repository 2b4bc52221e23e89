//! The smallest eigenpairs of a surface's Laplace–Beltrami operator.
//!
//! Knows nothing of how they are computed or stored.

use super::{Laplacian, ManifoldError};
use crate::mesh::TriMesh;

/// Eigenpairs `K φ = λ M φ` with `φᵀ M φ = 1`, ascending in λ; λ in mm⁻², φ in mm⁻¹.
#[derive(Clone, Debug)]
pub struct Basis {
    /// Eigenvalues `(n_modes)`, λ₀ = 0.
    pub eigenvalues: Vec<f64>,
    /// Eigenfunctions, row-major `(n_vertices, n_modes)`: the modes at one vertex are contiguous.
    pub eigenfunctions: Vec<f64>,
}

impl Basis {
    /// Number of modes.
    pub fn n_modes(&self) -> usize {
        self.eigenvalues.len()
    }

    /// Number of vertices.
    pub fn n_vertices(&self) -> usize {
        self.eigenfunctions.len() / self.n_modes().max(1)
    }

    /// The modes at one vertex.
    pub fn at(&self, vertex: usize) -> &[f64] {
        let k = self.n_modes();
        &self.eigenfunctions[vertex * k..(vertex + 1) * k]
    }

    /// The first `n_modes` modes.
    ///
    /// # Errors
    /// [`ManifoldError::NoModes`] for 0, [`ManifoldError::BasisTooSmall`] for more than there are.
    pub fn truncated(&self, n_modes: usize) -> Result<Self, ManifoldError> {
        if n_modes == 0 {
            return Err(ManifoldError::NoModes);
        }
        if n_modes > self.n_modes() {
            return Err(ManifoldError::BasisTooSmall { n_modes, available: self.n_modes() });
        }
        let rows = self.eigenfunctions.chunks_exact(self.n_modes());
        Ok(Self {
            eigenvalues: self.eigenvalues[..n_modes].to_vec(),
            eigenfunctions: rows.flat_map(|row| &row[..n_modes]).copied().collect(),
        })
    }

    /// The same eigenpairs in another unit of length, of which the present one is `factor`.
    #[must_use]
    pub fn in_unit_of(mut self, factor: f64) -> Self {
        self.eigenvalues.iter_mut().for_each(|lambda| *lambda /= factor * factor);
        self.eigenfunctions.iter_mut().for_each(|phi| *phi /= factor);
        self
    }

    /// Checks a basis from elsewhere against the mesh it is said to belong to.
    ///
    /// Every mode must have `φᵀ M φ = 1` within a tenth (room for another mass matrix); a basis in
    /// other units of length is off by a factor of at least 100.
    ///
    /// # Errors
    /// [`ManifoldError::BasisMismatch`].
    pub fn require_fit(&self, mesh: &TriMesh) -> Result<(), ManifoldError> {
        let mismatch = |expected, got| Err(ManifoldError::BasisMismatch { expected, got });
        if self.n_vertices() != mesh.n_vertices() {
            return mismatch(
                format!("{} vertices", mesh.n_vertices()),
                format!("{}", self.n_vertices()),
            );
        }
        let Laplacian { mass, stiffness } = Laplacian::new(mesh);
        let largest = self.eigenvalues.last().copied().unwrap_or(0.0);
        for mode in 0..self.n_modes() {
            let norm: f64 =
                mass.iter().enumerate().map(|(v, m)| m * self.at(v)[mode].powi(2)).sum();
            if !(0.9..=1.1).contains(&norm) {
                return mismatch(
                    format!("mode {mode} with an integral of φ² over the surface of 1"),
                    format!("{norm:.3e}"),
                );
            }
            // of an eigenfunction it is the eigenvalue, whoever discretised the surface; of a constant it is 0, of
            // values at the wrong vertices far more
            let phi: Vec<f64> = (0..mesh.n_vertices()).map(|v| self.at(v)[mode]).collect();
            let bending: f64 = stiffness.multiply(&phi).iter().zip(&phi).map(|(s, p)| s * p).sum();
            let eigenvalue = self.eigenvalues[mode];
            let (quotient, slack) = (bending / norm, 1e-2 * largest);
            if !(0.5 * eigenvalue - slack..=2.0 * eigenvalue + slack).contains(&quotient) {
                return mismatch(
                    format!(
                        "mode {mode} with an integral of |∇φ|² of its eigenvalue, {eigenvalue:.3e}"
                    ),
                    format!("{quotient:.3e}"),
                );
            }
            for other in [0, mode.saturating_sub(1)].into_iter().filter(|other| *other < mode) {
                let product: f64 = mass
                    .iter()
                    .enumerate()
                    .map(|(v, m)| m * self.at(v)[mode] * self.at(v)[other])
                    .sum();
                if product.abs() > 0.1 {
                    return mismatch(
                        format!("modes {other} and {mode} orthogonal: ∫ φ φ′ = 0"),
                        format!("{product:.3e}"),
                    );
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_meshes::rectangle;
    use super::*;

    fn small() -> Basis {
        Basis {
            eigenvalues: vec![0.0, 0.25, 1.0 / 3.0],
            eigenfunctions: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        }
    }

    #[test]
    fn truncation_keeps_the_first_modes_of_every_vertex() {
        let two = small().truncated(2).unwrap();
        assert!(two.eigenvalues == [0.0, 0.25] && two.eigenfunctions == [1.0, 2.0, 4.0, 5.0]);
        assert!(matches!(
            small().truncated(4),
            Err(ManifoldError::BasisTooSmall { available: 3, .. })
        ));
        assert!(matches!(small().truncated(0), Err(ManifoldError::NoModes)));
    }

    #[test]
    fn a_basis_of_another_mesh_or_unit_does_not_fit() {
        let mesh = rectangle(4, 3, 2.0);
        let good = super::super::eigenpairs(&mesh, 5).unwrap();
        assert!(good.require_fit(&mesh).is_ok());
        let other = rectangle(4, 4, 2.0);
        assert!(good.require_fit(&other).unwrap_err().to_string().contains("25 vertices, got 20"));
        let cm = rectangle(4, 3, 0.2);
        assert!(good.require_fit(&cm).unwrap_err().to_string().contains("got 1.000e-2"));
    }
}
