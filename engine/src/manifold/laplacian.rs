//! The Laplace–Beltrami operator of a triangle surface: cotangent stiffness and lumped mass.
//!
//! Piecewise linear finite elements.  Knows nothing of eigenpairs or distances.

use super::ManifoldError;
use crate::mesh::TriMesh;

/// A sparse square matrix, compressed by rows; columns ascend within a row.
#[derive(Clone, Debug)]
pub struct Csr {
    row_start: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

/// The weak Laplacian of a surface: `∫ ∇u·∇v = uᵀ K v`, `∫ u v ≈ uᵀ M v`.
///
/// ```text
/// K_ij = −½ Σ cot(angle opposite edge ij),   K_ii = −Σ_j K_ij,   M_ii = ⅓ Σ area(triangles at i)
/// ```
/// `K` is `(n_vertices, n_vertices)`, symmetric, positive semidefinite with the constants in its null
/// space, dimensionless; `M` is diagonal, mm².  No-flux on open edges.  Valid for any triangles with
/// area, also obtuse ones (off-diagonal entries may then be positive).
#[derive(Clone, Debug)]
pub struct Laplacian {
    /// Stiffness `K`.
    pub stiffness: Csr,
    /// Diagonal of the lumped mass `M`, mm² `(n_vertices)`.
    pub mass: Vec<f64>,
}

impl Csr {
    /// Sums the `entries` (row, column, value) of an `n` by `n` matrix, in their order.
    fn from_entries(n: usize, mut entries: Vec<(u32, u32, f64)>) -> Self {
        entries.sort_by_key(|&(row, column, _)| (row, column));
        let mut matrix = Self { row_start: vec![0; n + 1], columns: vec![], values: vec![] };
        let mut previous = None;
        for (row, column, value) in entries {
            if previous == Some((row, column)) {
                if let Some(last) = matrix.values.last_mut() {
                    *last += value;
                }
                continue;
            }
            previous = Some((row, column));
            matrix.columns.push(column);
            matrix.values.push(value);
            matrix.row_start[row as usize + 1] += 1;
        }
        for row in 0..n {
            matrix.row_start[row + 1] += matrix.row_start[row];
        }
        matrix
    }

    /// Number of rows, which is the number of columns.
    pub fn n_rows(&self) -> usize {
        self.row_start.len() - 1
    }

    /// The entries (column, value) of one row.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = self.row_start[row]..self.row_start[row + 1];
        let columns = self.columns[range.clone()].iter().map(|&column| column as usize);
        columns.zip(self.values[range].iter().copied())
    }

    /// `y = A x`.
    pub fn multiply(&self, x: &[f64]) -> Vec<f64> {
        (0..self.n_rows()).map(|i| self.row(i).map(|(j, value)| value * x[j]).sum()).collect()
    }
}

impl Laplacian {
    /// Assembles both matrices.
    pub fn new(mesh: &TriMesh) -> Self {
        let mut entries = Vec::with_capacity(12 * mesh.triangles().len());
        let mut mass = vec![0.0; mesh.n_vertices()];
        for &triangle in mesh.triangles() {
            let corners = triangle.map(|v| mesh.vertices()[v as usize]);
            let doubled_area = doubled_area(corners);
            for corner in 0..3 {
                let (next, other) = ((corner + 1) % 3, (corner + 2) % 3);
                let along = subtract(corners[next], corners[corner]);
                let across = subtract(corners[other], corners[corner]);
                let half_cotangent = 0.5 * dot(along, across) / doubled_area;
                let (i, j) = (triangle[next], triangle[other]);
                entries.extend([
                    (i, j, -half_cotangent),
                    (j, i, -half_cotangent),
                    (i, i, half_cotangent),
                    (j, j, half_cotangent),
                ]);
                mass[triangle[corner] as usize] += doubled_area / 6.0;
            }
        }
        Self { stiffness: Csr::from_entries(mesh.n_vertices(), entries), mass }
    }

    /// Area of the surface, mm².
    pub fn area(&self) -> f64 {
        self.mass.iter().sum()
    }
}

/// Refuses a surface that is not one connected piece.
pub(super) fn require_connected(mesh: &TriMesh) -> Result<(), ManifoldError> {
    let n_vertices = mesh.n_vertices();
    let mut parent: Vec<u32> = (0..n_vertices as u32).collect();
    for &[a, b, c] in mesh.triangles() {
        for other in [b, c] {
            let (one, two) = (root(&mut parent, a), root(&mut parent, other));
            parent[one.max(two) as usize] = one.min(two);
        }
    }
    let mut size = vec![0; n_vertices];
    for vertex in 0..n_vertices as u32 {
        size[root(&mut parent, vertex) as usize] += 1;
    }
    let n_pieces = size.iter().filter(|&&s| s > 0).count();
    if n_pieces > 1 {
        let largest = size.into_iter().max().unwrap_or(0);
        return Err(ManifoldError::Disconnected { n_pieces, largest, n_vertices });
    }
    Ok(())
}

/// The representative of a vertex's piece; halves the path on its way.
fn root(parent: &mut [u32], mut vertex: u32) -> u32 {
    while parent[vertex as usize] != vertex {
        parent[vertex as usize] = parent[parent[vertex as usize] as usize];
        vertex = parent[vertex as usize];
    }
    vertex
}

pub(super) fn subtract(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Twice the area of a triangle, mm².
fn doubled_area([a, b, c]: [[f64; 3]; 3]) -> f64 {
    let normal = cross(subtract(b, a), subtract(c, a));
    dot(normal, normal).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::test_meshes::{icosphere, rectangle};
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    /// `K` the other way: Σ area ∇uᵢ · ∇uⱼ, the gradients from solving for each hat function.
    fn by_gradients(mesh: &TriMesh) -> Vec<Vec<f64>> {
        let mut stiffness = vec![vec![0.0; mesh.n_vertices()]; mesh.n_vertices()];
        for triangle in mesh.triangles() {
            let [a, b, c] = triangle.map(|v| nalgebra::Vector3::from(mesh.vertices()[v as usize]));
            let edges = nalgebra::Matrix3x2::from_columns(&[b - a, c - a]);
            // Rows of the pseudo-inverse: gradients of the hats at b and c within the plane.
            let inverse = (edges.transpose() * edges).try_inverse().unwrap() * edges.transpose();
            let (at_b, at_c) = (inverse.row(0).transpose(), inverse.row(1).transpose());
            let gradients = [-at_b - at_c, at_b, at_c];
            let area = 0.5 * (b - a).cross(&(c - a)).norm();
            for i in 0..3 {
                for j in 0..3 {
                    stiffness[triangle[i] as usize][triangle[j] as usize] +=
                        area * gradients[i].dot(&gradients[j]);
                }
            }
        }
        stiffness
    }

    fn assert_built_two_ways(mesh: &TriMesh) {
        let stiffness = Laplacian::new(mesh).stiffness;
        for (i, expected) in by_gradients(mesh).into_iter().enumerate() {
            let mut row = vec![0.0; mesh.n_vertices()];
            stiffness.row(i).for_each(|(j, value)| row[j] = value);
            let size: f64 = row.iter().map(|v| v.abs()).sum();
            assert!(row.iter().sum::<f64>().abs() < 1e-12 * size, "row {i} does not sum to zero");
            for j in 0..row.len() {
                assert!(
                    (row[j] - expected[j]).abs() < 1e-9 * size,
                    "({i}, {j}): {} {}",
                    row[j],
                    expected[j]
                );
            }
        }
    }

    #[test]
    fn right_angles_give_the_five_point_stencil() {
        let stiffness = Laplacian::new(&rectangle(2, 2, 3.0)).stiffness;
        let middle: Vec<(usize, f64)> =
            stiffness.row(4).filter(|&(_, v)| v.abs() > 1e-15).collect();
        let expected = [(1, -1.0), (3, -1.0), (4, 4.0), (5, -1.0), (7, -1.0)];
        assert_eq!(middle.len(), 5, "{middle:?}");
        for (got, want) in middle.iter().zip(expected) {
            assert!(got.0 == want.0 && (got.1 - want.1).abs() < 1e-14, "{middle:?}");
        }
    }

    #[test]
    fn both_constructions_agree_on_a_closed_and_an_open_surface() {
        assert_built_two_ways(&icosphere(2, 7.0));
        assert_built_two_ways(&rectangle(5, 3, 0.4));
    }

    proptest! {
        #[test]
        fn both_constructions_agree_on_crumpled_surfaces(
            offsets in prop::collection::vec(prop::array::uniform3(-0.4..0.4_f64), 20)
        ) {
            let flat = rectangle(4, 3, 1.0);
            let moved = flat.vertices().iter().zip(&offsets);
            let vertices = moved.map(|(v, o)| [v[0] + o[0], v[1] + o[1], v[2] + o[2]]).collect();
            assert_built_two_ways(&TriMesh::new(vertices, flat.triangles().to_vec()).unwrap());
        }
    }

    #[test]
    fn the_matrix_is_symmetric_to_the_last_bit() {
        let stiffness = Laplacian::new(&icosphere(2, 7.0)).stiffness;
        for i in 0..stiffness.n_rows() {
            for (j, value) in stiffness.row(i) {
                let mirrored = stiffness.row(j).find(|&(column, _)| column == i).unwrap().1;
                assert_eq!(value.to_bits(), mirrored.to_bits());
            }
        }
    }

    #[test]
    fn mass_sums_to_the_area() {
        let flat = Laplacian::new(&rectangle(6, 4, 0.5));
        assert!((flat.area() - 6.0).abs() < 1e-12);
        let sphere = Laplacian::new(&icosphere(4, 10.0));
        assert!((sphere.area() / (400.0 * PI) - 1.0).abs() < 5e-3);
    }
}
