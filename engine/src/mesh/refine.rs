//! A finer mesh of the same surface.

use super::{MeshError, TriMesh};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// A mesh whose triangles were cut into four, once or several times.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The finer mesh; the vertices of the coarse one come first.
    pub mesh: TriMesh,
    /// For each cut the two ends of the edge that each new vertex halves.
    ends: Vec<Vec<[u32; 2]>>,
}

impl Refined {
    /// `coarse`, cut `times` times; 0 leaves it as it is.
    ///
    /// # Errors
    /// What is no surface once it is cut: two triangles on the same three vertices; needles.
    pub fn new(coarse: TriMesh, times: u32) -> Result<Self, MeshError> {
        let (mut mesh, mut ends) = (coarse, vec![]);
        for _ in 0..times {
            let (finer, halved) = mesh.refined()?;
            mesh = finer;
            ends.push(halved);
        }
        Ok(Self { mesh, ends })
    }

    /// Values at the vertices of the coarse mesh carried over: a new vertex has the `mean` of its edge's ends.
    pub fn carry<T: Copy>(&self, values: Vec<T>, mean: impl Fn(T, T) -> T) -> Vec<T> {
        let mut values = values;
        for ends in &self.ends {
            let new: Vec<T> =
                ends.iter().map(|[a, b]| mean(values[*a as usize], values[*b as usize])).collect();
            values.extend(new);
        }
        values
    }
}

impl TriMesh {
    /// Every triangle cut into four at the middles of its edges; the vertices stay, and for each new one,
    /// which follow, the two ends of its edge.
    fn refined(&self) -> Result<(TriMesh, Vec<[u32; 2]>), MeshError> {
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
        Ok((TriMesh::new(vertices, triangles)?, ends))
    }
}

/// The direction halfway between two, whose signs mean nothing.
pub fn halfway(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    let (a, b) = (Vector3::from(a).normalize(), Vector3::from(b).normalize());
    if a.dot(&b) < 0.0 { (a - b).into() } else { (a + b).into() }
}

#[cfg(test)]
mod tests {
    use super::{Refined, TriMesh, halfway};
    use crate::mesh::left_atrium;

    #[test]
    fn the_surface_stays_and_edges_halve() {
        let coarse = left_atrium(3.0).mesh;
        let (fine, ends) = coarse.refined().unwrap();
        assert!((fine.area() / coarse.area() - 1.0).abs() < 1e-12);
        assert!((fine.mean_edge_length() / coarse.mean_edge_length() - 0.5).abs() < 0.02);
        assert_eq!(fine.euler_characteristic(), coarse.euler_characteristic());
        assert_eq!(fine.boundary_loops().len(), coarse.boundary_loops().len());
        assert_eq!(fine.n_vertices(), coarse.n_vertices() + ends.len());
        assert_eq!(fine.vertices()[..coarse.n_vertices()], *coarse.vertices());
    }

    #[test]
    fn what_cannot_be_cut_is_refused() {
        let corners = vec![[0.0; 3], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]];
        if let Ok(pillow) = TriMesh::new(corners, vec![[0, 1, 2], [0, 2, 1]]) {
            assert!(Refined::new(pillow.clone(), 0).is_ok());
            assert!(Refined::new(pillow, 1).is_err());
        }
    }

    #[test]
    fn what_is_linear_stays_so() {
        let coarse = left_atrium(3.0).mesh;
        let x = |p: &[f64; 3]| p[0];
        let values: Vec<f64> = coarse.vertices().iter().map(x).collect();
        let twice = Refined::new(coarse, 2).unwrap();
        let carried = twice.carry(values, |a, b| 0.5 * (a + b));
        assert_eq!(carried, twice.mesh.vertices().iter().map(x).collect::<Vec<f64>>());
    }

    #[test]
    fn halfway_knows_no_sign() {
        let (a, b) = ([2.0, 0.0, 0.0], [0.0, -1.0, 0.0]);
        assert_eq!(halfway(a, b).to_vec(), [1.0, -1.0, 0.0]);
        assert_eq!(halfway(a, [-1.0, 0.0, 0.0]).to_vec(), [2.0, 0.0, 0.0]);
    }
}
