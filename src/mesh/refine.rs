//! A finer mesh of the same surface.

use super::TriMesh;
use std::collections::BTreeMap;

impl TriMesh {
    /// Every triangle cut into four at the middles of its edges; the vertices stay, and for each new one,
    /// which follow, the two ends of its edge.
    ///
    /// # Panics
    /// Never: halves of valid triangles are valid.
    #[allow(clippy::expect_used, reason = "halves of valid triangles are valid")]
    pub fn refined(&self) -> (TriMesh, Vec<[u32; 2]>) {
        let n = self.n_vertices() as u32;
        let (mut middle_of, mut ends) = (BTreeMap::new(), vec![]);
        let mut middle = |a: u32, b: u32| {
            *middle_of.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                ends.push([a.min(b), a.max(b)]);
                n + ends.len() as u32 - 1
            })
        };
        let mut triangles = Vec::with_capacity(4 * self.n_triangles());
        for &[a, b, c] in self.triangles() {
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        let point = |v: u32| self.vertices()[v as usize];
        let halfway = |[a, b]: &[u32; 2]| {
            let (a, b) = (point(*a), point(*b));
            std::array::from_fn(|k| 0.5 * (a[k] + b[k]))
        };
        let mut vertices = self.vertices().to_vec();
        vertices.extend(ends.iter().map(halfway));
        (TriMesh::new(vertices, triangles).expect("a valid surface"), ends)
    }
}

#[cfg(test)]
mod tests {
    use crate::mesh::left_atrium;

    #[test]
    fn the_surface_stays_and_edges_halve() {
        let coarse = left_atrium(3.0).mesh;
        let (fine, ends) = coarse.refined();
        assert!((fine.area() / coarse.area() - 1.0).abs() < 1e-12);
        assert!((fine.mean_edge_length() / coarse.mean_edge_length() - 0.5).abs() < 0.02);
        assert_eq!(fine.euler_characteristic(), coarse.euler_characteristic());
        assert_eq!(fine.boundary_loops().len(), coarse.boundary_loops().len());
        assert_eq!(fine.n_vertices(), coarse.n_vertices() + ends.len());
        assert_eq!(fine.vertices()[..coarse.n_vertices()], *coarse.vertices());
    }
}
