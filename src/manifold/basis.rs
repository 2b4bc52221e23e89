//! The smallest eigenpairs of a surface's Laplace–Beltrami operator.

/// Eigenpairs `K φ = λ M φ` with `φᵀ M φ = 1`, ascending in λ; λ in mm⁻², φ in mm⁻¹.
#[derive(Clone, Debug)]
pub struct Basis {
    /// Eigenvalues (n_modes), λ₀ = 0.
    pub eigenvalues: Vec<f64>,
    /// Eigenfunctions, row-major (n_vertices, n_modes): the modes at one vertex are contiguous.
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
}
