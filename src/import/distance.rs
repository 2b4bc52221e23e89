//! How far a point lies from a surface.

use nalgebra::Vector3;

use crate::manifold::nearest_vertex;
use crate::mesh::TriMesh;

/// Which triangles each vertex belongs to.
#[derive(Debug, Default)]
pub(super) struct Incidence {
    /// Where the triangles of each vertex begin in `triangles`.
    first: Vec<u32>,
    triangles: Vec<u32>,
}

impl Incidence {
    pub(super) fn new(mesh: &TriMesh) -> Self {
        let mut first = vec![0; mesh.n_vertices() + 1];
        for v in mesh.triangles().iter().flatten() {
            first[*v as usize + 1] += 1;
        }
        for v in 0..mesh.n_vertices() {
            first[v + 1] += first[v];
        }
        let mut next = first.clone();
        let mut triangles = vec![0; 3 * mesh.n_triangles()];
        for (t, v) in (0..).zip(mesh.triangles()).flat_map(|(t, c)| c.map(|v| (t, v))) {
            triangles[next[v as usize] as usize] = t;
            next[v as usize] += 1;
        }
        Self { first, triangles }
    }

    /// The vertex nearest to a point, and the distance of the point from the triangles around it, mm.
    pub(super) fn nearest(&self, mesh: &TriMesh, point: [f64; 3]) -> (u32, f64) {
        let (vertex, to_vertex) = nearest_vertex(mesh, point);
        let at = |v: u32| Vector3::from(mesh.vertices()[v as usize]);
        let own = self.first[vertex as usize] as usize..self.first[vertex as usize + 1] as usize;
        let distances = self.triangles[own]
            .iter()
            .map(|t| distance(Vector3::from(point), mesh.triangles()[*t as usize].map(at)));
        (vertex, distances.fold(to_vertex, f64::min))
    }
}

/// Distances of points from a surface, mm.
pub fn from_surface(mesh: &TriMesh, points: &[[f64; 3]]) -> Vec<f64> {
    let triangles = Incidence::new(mesh);
    points.iter().map(|point| triangles.nearest(mesh, *point).1).collect()
}

/// Distance of a point from a triangle: from its plane if the foot lies inside, else from its nearest edge.
fn distance(p: Vector3<f64>, [a, b, c]: [Vector3<f64>; 3]) -> f64 {
    let normal = (b - a).cross(&(c - a));
    let is_left =
        |from: Vector3<f64>, to: Vector3<f64>| (to - from).cross(&(p - from)).dot(&normal) >= 0.0;
    if is_left(a, b) && is_left(b, c) && is_left(c, a) {
        return ((p - a).dot(&normal) / normal.norm()).abs();
    }
    let edge = |from: Vector3<f64>, to: Vector3<f64>| {
        let along = to - from;
        let t = ((p - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (p - from - t * along).norm()
    };
    edge(a, b).min(edge(b, c)).min(edge(c, a))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_is_as_far_as_the_triangle_below_it() {
        let vertices = vec![[0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [4.0, 4.0, 0.0]];
        let mesh = TriMesh::new(vertices, vec![[0, 1, 2], [1, 3, 2]]).unwrap();
        let triangles = Incidence::new(&mesh);
        for (point, expected) in [
            ([1.0, 1.0, 2.0], (0, 2.0)),
            ([-3.0, 0.0, 4.0], (0, 5.0)),
            ([1.0, -2.0, 0.0], (0, 2.0)),
            ([3.5, 3.5, -1.0], (3, 1.0)),
        ] {
            let (vertex, distance) = triangles.nearest(&mesh, point);
            assert_eq!(vertex, expected.0);
            assert!((distance - expected.1).abs() < 1e-12, "{point:?}: {distance}");
        }
    }
}
