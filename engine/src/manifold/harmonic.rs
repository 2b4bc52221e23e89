//! Functions on a surface that are as smooth as their known values let them be.

use super::cholesky::Cholesky;
use super::laplacian::require_connected;
use super::{Laplacian, ManifoldError};
use crate::mesh::TriMesh;
use faer::Mat;

/// How stiffly known values are held. The stiffness of a surface is of the order of 1.
const STIFF: f64 = 1e6;

/// The functions with least `∫ |∇u|²` that have known values at these vertices (n_vertices each). `values` has a list
/// for each function (known). Nothing flows through open edges.
///
/// # Errors
/// [`ManifoldError`] if the surface is in pieces or the factorisation fails.
pub fn harmonic(
    mesh: &TriMesh,
    known: &[u32],
    values: &[Vec<f64>],
) -> Result<Vec<Vec<f64>>, ManifoldError> {
    require_connected(mesh)?;
    let mut laplacian = Laplacian::new(mesh);
    laplacian.mass.fill(0.0);
    let mut u = Mat::zeros(mesh.n_vertices(), values.len());
    for (i, vertex) in known.iter().map(|v| *v as usize).enumerate() {
        laplacian.mass[vertex] = 1.0;
        for (j, values) in values.iter().enumerate() {
            u[(vertex, j)] = STIFF * values[i];
        }
    }
    Cholesky::new(&laplacian, STIFF)?.solve(u.as_mut());
    Ok(u.col_iter().map(|column| column.iter().copied().collect()).collect())
}

#[cfg(test)]
mod tests {
    use super::super::test_meshes::icosphere;
    use super::*;

    /// Between two circles of latitude on a sphere, ln tan(θ/2) is harmonic.
    #[test]
    fn between_circles_of_latitude_it_is_the_mercator_projection() {
        let mesh = icosphere(4, 10.0);
        let mercator = |p: &[f64; 3]| (0.5 * (p[2] / 10.0).acos()).tan().ln();
        let is_known = |p: &[f64; 3]| (7.0..9.99).contains(&p[2].abs());
        let points = || (0u32..).zip(mesh.vertices());
        let known = points().filter(|(_, p)| is_known(p));
        let (known, values): (Vec<u32>, Vec<f64>) = known.map(|(v, p)| (v, mercator(p))).unzip();
        let ones = vec![1.0; known.len()];
        let found = harmonic(&mesh, &known, &[values, ones]).unwrap();
        for ((v, p), u) in points().zip(&found[0]) {
            // the poles themselves have no finite value
            let error = if p[2].abs() > 9.99 { 0.0 } else { (u - mercator(p)).abs() };
            assert!(error < if is_known(p) { 1e-4 } else { 5e-3 }, "{p:?}: {error}");
            assert!((found[1][v as usize] - 1.0).abs() < 1e-6);
        }
    }
}
