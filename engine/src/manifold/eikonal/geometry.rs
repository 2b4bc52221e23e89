//! The surface laid flat, triangle by triangle: corners in a frame along the fibres, neighbours, fans.
//!
//! Knows nothing of the medium.

use super::super::ManifoldError;
use super::super::laplacian::{cross, dot, subtract};
use super::orientation::outward;
use super::way::{NONE, Way};
use crate::mesh::TriMesh;

/// A fibre whose part in the surface is shorter than this part of it is no direction there.
const LEAST_IN_SURFACE: f64 = 1e-3;

/// One triangle in its own frame: first axis along the fibres, second a quarter turn on from it about the
/// outward normal.
#[derive(Clone, Debug)]
pub(super) struct Triangle {
    pub(super) corners: [u32; 3],
    /// Corners in the frame, mm.
    pub(super) points: [[f64; 2]; 3],
    /// Gradient of the linear function that is 1 at a corner and 0 at the others, 1/mm.
    pub(super) slopes: [[f64; 2]; 3],
    /// Twice the area, mm².
    pub(super) area: f64,
    /// The triangle across the side opposite each corner, or [`NONE`].
    pub(super) beyond: [u32; 3],
}

impl Triangle {
    /// Mean of values at the vertices over the corners.
    pub(super) fn mean(&self, values: &[f64]) -> f64 {
        self.corners.iter().map(|v| values[*v as usize]).sum::<f64>() / 3.0
    }
}

/// All triangles, and which of them meet at each vertex.
#[derive(Clone, Debug)]
pub(super) struct Geometry {
    pub(super) triangles: Vec<Triangle>,
    starts: Vec<u32>,
    fans: Vec<Blade>,
}

/// A triangle at a vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blade {
    pub(super) triangle: u32,
    /// Which of its corners the vertex is.
    pub(super) corner: u8,
    /// The vertices at its corners after this one.
    pub(super) others: [u32; 2],
}

impl Geometry {
    /// Lays `mesh` flat along `fibres` (one per triangle), or along a fixed direction.
    ///
    /// # Errors
    /// [`ManifoldError::FibreCount`] and [`ManifoldError::NoFibre`].
    pub(super) fn new(mesh: &TriMesh, fibres: Option<&[[f64; 3]]>) -> Result<Self, ManifoldError> {
        if let Some(fibres) = fibres.filter(|fibres| fibres.len() != mesh.n_triangles()) {
            return Err(ManifoldError::FibreCount {
                n_triangles: mesh.n_triangles(),
                got: fibres.len(),
            });
        }
        let beyond = neighbours(mesh);
        let normals = outward(mesh, &beyond);
        let lay = |index: usize| {
            let normal = normals[index];
            let along = match fibres {
                None => reference(normal),
                Some(fibres) => in_surface(fibres[index], normal, LEAST_IN_SURFACE)
                    .ok_or(ManifoldError::NoFibre { triangle: index, fibre: fibres[index] })?,
            };
            Ok(flat(mesh, index, along, normal, beyond[index]))
        };
        let triangles = (0..mesh.n_triangles()).map(lay).collect::<Result<_, ManifoldError>>()?;
        let (starts, fans) = fans(mesh);
        Ok(Self { triangles, starts, fans })
    }

    pub(super) fn n_vertices(&self) -> usize {
        self.starts.len() - 1
    }

    /// The vertices from which a way leads on; [`NONE`] for none.
    pub(super) fn parents(&self, way: Way) -> [u32; 2] {
        let corner =
            |triangle: u32, k: u8| self.triangles[triangle as usize].corners[k as usize % 3];
        match way {
            Way::Never | Way::Ray(_) => [NONE; 2],
            Way::Along { triangle, to, end } => [corner(triangle, to + 1 + end), NONE],
            Way::Across { triangle, to, .. } => [1, 2].map(|k| corner(triangle, to + k)),
        }
    }

    /// The triangles at a vertex.
    pub(super) fn fan(&self, vertex: u32) -> &[Blade] {
        let v = vertex as usize;
        &self.fans[self.starts[v] as usize..self.starts[v + 1] as usize]
    }
}

/// One triangle in the frame of `along` and `normal`, both units.
fn flat(
    mesh: &TriMesh,
    index: usize,
    along: [f64; 3],
    normal: [f64; 3],
    beyond: [u32; 3],
) -> Triangle {
    let corners = mesh.triangles()[index];
    let across = cross(normal, along);
    let at = corners.map(|v| mesh.vertices()[v as usize]);
    let points = at.map(|p| {
        let from_first = subtract(p, at[0]);
        [dot(from_first, along), dot(from_first, across)]
    });
    let [a, b, c] = points;
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let slope = |from: [f64; 2], to: [f64; 2]| [(from[1] - to[1]) / area, (to[0] - from[0]) / area];
    let slopes = [slope(b, c), slope(c, a), slope(a, b)];
    Triangle { corners, points, slopes, area: (b[0] * c[1] - b[1] * c[0]).abs(), beyond }
}

/// The direction of `vector` in the plane across the unit `normal`; none if no more than the part `least`
/// of it lies there.
fn in_surface(vector: [f64; 3], normal: [f64; 3], least: f64) -> Option<[f64; 3]> {
    let length = dot(vector, vector).sqrt();
    let out = dot(vector, normal);
    let inside: [f64; 3] = std::array::from_fn(|k| vector[k] - out * normal[k]);
    let left = dot(inside, inside).sqrt();
    let is_direction = left > least * length && left.is_finite();
    is_direction.then(|| inside.map(|x| x / left))
}

/// The direction of the third axis in the surface; of the first where that is (nearly) normal to it.
fn reference(normal: [f64; 3]) -> [f64; 3] {
    let third = in_surface([0.0, 0.0, 1.0], normal, LEAST_IN_SURFACE);
    let first = || in_surface([1.0, 0.0, 0.0], normal, 0.0);
    third.or_else(first).unwrap_or([0.0, 1.0, 0.0])
}

/// For every triangle the one across each side, the side opposite corner 0 first.
fn neighbours(mesh: &TriMesh) -> Vec<[u32; 3]> {
    let mut sides: Vec<([u32; 2], u32, usize)> = Vec::with_capacity(3 * mesh.n_triangles());
    for (index, corners) in (0..).zip(mesh.triangles()) {
        for side in 0..3 {
            let (a, b) = (corners[(side + 1) % 3], corners[(side + 2) % 3]);
            sides.push(([a.min(b), a.max(b)], index, side));
        }
    }
    sides.sort_unstable();
    let mut beyond = vec![[NONE; 3]; mesh.n_triangles()];
    for pair in sides.windows(2) {
        if let [(one, t, i), (two, u, j)] = *pair
            && one == two
        {
            beyond[t as usize][i] = u;
            beyond[u as usize][j] = t;
        }
    }
    beyond
}

/// Where each vertex's list of triangles starts, and the lists.
fn fans(mesh: &TriMesh) -> (Vec<u32>, Vec<Blade>) {
    let mut starts = vec![0_u32; mesh.n_vertices() + 1];
    for &v in mesh.triangles().iter().flatten() {
        starts[v as usize + 1] += 1;
    }
    for v in 0..mesh.n_vertices() {
        starts[v + 1] += starts[v];
    }
    let none = Blade { triangle: NONE, corner: 0, others: [NONE; 2] };
    let (mut next, mut fans) = (starts.clone(), vec![none; 3 * mesh.n_triangles()]);
    for (triangle, corners) in (0..).zip(mesh.triangles()) {
        for (k, &v) in corners.iter().enumerate() {
            let others = [1, 2].map(|i| corners[(k + i) % 3]);
            let blade = Blade { triangle, corner: k as u8, others };
            fans[next[v as usize] as usize] = blade;
            next[v as usize] += 1;
        }
    }
    (starts, fans)
}
