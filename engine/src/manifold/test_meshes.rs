//! Surfaces whose answers are known in closed form, for the tests of this layer.

use crate::mesh::TriMesh;
use std::collections::BTreeMap;

/// An icosahedron subdivided `level` times onto a sphere: 10·4^level + 2 vertices.
pub(super) fn icosphere(level: usize, radius: f64) -> TriMesh {
    let (vertices, triangles) = icosahedron();
    let (mut vertices, mut triangles) = (vertices.map(unit).to_vec(), triangles.to_vec());
    for _ in 0..level {
        let mut midpoints = BTreeMap::new();
        let mut midpoint = |a: u32, b: u32| {
            *midpoints.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let (p, q) = (vertices[a as usize], vertices[b as usize]);
                vertices.push(unit([p[0] + q[0], p[1] + q[1], p[2] + q[2]]));
                vertices.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (midpoint(a, b), midpoint(b, c), midpoint(c, a));
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
    }
    let vertices = vertices.iter().map(|v| v.map(|x| radius * x)).collect();
    TriMesh::new(vertices, triangles).unwrap()
}

fn icosahedron() -> ([[f64; 3]; 12], [[u32; 3]; 20]) {
    let t = f64::midpoint(1.0, 5.0_f64.sqrt());
    #[rustfmt::skip]
    let vertices = [
        [-1.0, t, 0.0], [1.0, t, 0.0], [-1.0, -t, 0.0], [1.0, -t, 0.0],
        [0.0, -1.0, t], [0.0, 1.0, t], [0.0, -1.0, -t], [0.0, 1.0, -t],
        [t, 0.0, -1.0], [t, 0.0, 1.0], [-t, 0.0, -1.0], [-t, 0.0, 1.0],
    ];
    #[rustfmt::skip]
    let triangles = [
        [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4],
        [11, 10, 2], [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8],
        [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
    ];
    (vertices, triangles)
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let norm = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    v.map(|x| x / norm)
}

/// A flat `nx` by `ny` rectangle of squares of side `edge` mm, diagonals alternating; vertex
/// (i, j) has index j (nx + 1) + i.
pub(super) fn rectangle(nx: u32, ny: u32, edge: f64) -> TriMesh {
    let at = |i: u32, j: u32| j * (nx + 1) + i;
    let vertices = (0..=ny)
        .flat_map(|j| (0..=nx).map(move |i| [f64::from(i) * edge, f64::from(j) * edge, 0.0]))
        .collect();
    let mut triangles = vec![];
    for j in 0..ny {
        for i in 0..nx {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if (i + j) % 2 == 0 {
                triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                triangles.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
    TriMesh::new(vertices, triangles).unwrap()
}

/// Six made-up modes at 12 vertices.
pub(crate) fn made_up() -> super::Basis {
    let entry =
        |i: usize| if i.is_multiple_of(6) { 0.01 } else { ((i * 37 % 29) as f64 - 14.0) / 900.0 };
    super::Basis {
        eigenvalues: (0..6).map(|k| 4e-4 * f64::from(k)).collect(),
        eigenfunctions: (0..72).map(entry).collect(),
    }
}
