//! A validated triangle surface and its geometry.

use super::{MeshError, area_vector, topology, vector};
use nalgebra::Vector3;

/// A triangle surface in millimetres, validated once at construction and trusted afterwards.
///
/// Every edge has one or two triangles, every vertex at least one, and every triangle three
/// different vertices and an area.  Several pieces, boundaries and differing orientations are allowed.
#[derive(Clone, Debug, PartialEq)]
pub struct TriMesh {
    vertices: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// Validates and takes `vertices` (mm) and `triangles` (vertex indices).
    ///
    /// # Errors
    /// [`MeshError`] with the vertex, triangle or edge at fault: `Empty`, `NotFinite`,
    /// `IndexOutOfRange`, `RepeatedVertex`, `NoArea`, `NonManifoldEdge`, `UnusedVertex`.
    pub fn new(vertices: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        validate(&vertices, &triangles)?;
        let mut used = vec![false; vertices.len()];
        for &v in triangles.iter().flatten() {
            used[v as usize] = true;
        }
        match used.iter().position(|used| !used) {
            Some(vertex) => Err(MeshError::UnusedVertex { vertex }),
            None => Ok(Self { vertices, triangles }),
        }
    }

    /// Vertex coordinates, mm.
    pub fn vertices(&self) -> &[[f64; 3]] {
        &self.vertices
    }

    /// Triangles as vertex indices.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Number of vertices.
    pub fn n_vertices(&self) -> usize {
        self.vertices.len()
    }

    /// Number of triangles.
    pub fn n_triangles(&self) -> usize {
        self.triangles.len()
    }

    /// Area of triangle `index`, mm².
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn triangle_area(&self, index: usize) -> f64 {
        0.5 * area_vector(self.triangles[index].map(|v| vector(self.vertices[v as usize]))).norm()
    }

    /// Area of the surface, mm².
    pub fn area(&self) -> f64 {
        (0..self.n_triangles()).map(|t| self.triangle_area(t)).sum()
    }

    /// Smallest and largest coordinates, mm.
    pub fn bounding_box(&self) -> [[f64; 3]; 2] {
        let empty = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        self.vertices.iter().fold(empty, |[low, high], p| {
            [std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k]))]
        })
    }

    /// Mean length of the edges, each counted once, mm.
    pub fn mean_edge_length(&self) -> f64 {
        let sides = topology::sides(&self.triangles);
        let (mut sum, mut n_edges) = (0.0, 0_u32);
        for edge in topology::edges(&sides) {
            let [a, b] = edge[0].ends.map(|v| vector(self.vertices[v as usize]));
            sum += (b - a).norm();
            n_edges += 1;
        }
        sum / f64::from(n_edges)
    }

    /// Smallest angle of any triangle, degrees.
    pub fn min_angle(&self) -> f64 {
        let mut smallest = f64::INFINITY;
        for t in &self.triangles {
            let p = t.map(|v| vector(self.vertices[v as usize]));
            for corner in 0..3 {
                let u = p[(corner + 1) % 3] - p[corner];
                let w = p[(corner + 2) % 3] - p[corner];
                smallest = smallest.min(u.cross(&w).norm().atan2(u.dot(&w)));
            }
        }
        smallest.to_degrees()
    }

    /// The openings: closed chains of edges that have one triangle only, as vertices in order.
    ///
    /// Each starts at its smallest vertex and sets out the way its triangle runs; they are ordered
    /// by that vertex.
    pub fn boundary_loops(&self) -> Vec<Vec<u32>> {
        topology::boundary_loops(&self.triangles)
    }

    /// Number of connected pieces.
    pub fn n_components(&self) -> usize {
        let pieces = topology::pieces(self.n_vertices(), &self.triangles);
        pieces.iter().max().map_or(0, |&last| last as usize + 1)
    }

    /// Vertices − edges + triangles: 2 for a sphere, one less for every opening.
    pub fn euler_characteristic(&self) -> i64 {
        let n_edges = topology::edges(&topology::sides(&self.triangles)).count();
        self.n_vertices() as i64 - n_edges as i64 + self.n_triangles() as i64
    }
}

/// Everything [`TriMesh::new`] asks for, except that unused vertices may be there.
pub(super) fn validate(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<(), MeshError> {
    if triangles.is_empty() {
        return Err(MeshError::Empty);
    }
    check_finite(vertices)?;
    for (triangle, &[a, b, c]) in triangles.iter().enumerate() {
        check_range([a, b, c].map(i64::from), triangle, vertices.len())?;
        if let Some(vertex) = repeated([a, b, c]) {
            return Err(MeshError::RepeatedVertex { triangle, vertex });
        }
        let corners = [a, b, c].map(|v| vector(vertices[v as usize]));
        if is_flat(corners) {
            return Err(MeshError::NoArea { triangle });
        }
    }
    let sides = topology::sides(triangles);
    let mut bad = topology::edges(&sides).filter(|edge| edge.len() > 2);
    match bad.next() {
        None => Ok(()),
        Some(edge) => Err(MeshError::NonManifoldEdge {
            edge: edge[0].ends,
            at: edge[0].ends.map(|v| vertices[v as usize]),
            triangles: edge.iter().map(|side| side.triangle).collect(),
            n_edges: 1 + bad.count(),
        }),
    }
}

/// Whether a triangle's height is lost in rounding beside its longest edge: its angles, and with
/// them every operator on the mesh, would be noise.
pub(super) fn is_flat([a, b, c]: [Vector3<f64>; 3]) -> bool {
    let longest = [b - a, c - b, a - c].iter().map(Vector3::norm_squared).fold(0.0, f64::max);
    area_vector([a, b, c]).norm() <= 1e-14 * longest
}

/// The largest coordinate, mm: areas and their squares are far from overflowing.
const LARGEST: f64 = 1e12;

/// Refuses coordinates that are NaN, infinite or beyond all measure.
pub(super) fn check_finite(vertices: &[[f64; 3]]) -> Result<(), MeshError> {
    let is_wrong = |p: &[f64; 3]| p.iter().any(|x| !(x.abs() <= LARGEST));
    let Some(vertex) = vertices.iter().position(is_wrong) else { return Ok(()) };
    let position = vertices[vertex];
    Err(if position.iter().all(|x| x.is_finite()) {
        MeshError::TooFar { vertex, position, most: LARGEST }
    } else {
        MeshError::NotFinite { vertex, position }
    })
}

/// The vertex that `triangle` has more than once.
pub(super) fn repeated([a, b, c]: [u32; 3]) -> Option<u32> {
    if a == b || a == c {
        Some(a)
    } else if b == c {
        Some(b)
    } else {
        None
    }
}

/// Refuses a triangle with a vertex that does not exist.
pub(super) fn check_range(
    corners: [i64; 3],
    triangle: usize,
    n_vertices: usize,
) -> Result<(), MeshError> {
    let exists = |index: i64| usize::try_from(index).is_ok_and(|i| i < n_vertices);
    match corners.into_iter().find(|&index| !exists(index)) {
        None => Ok(()),
        Some(index) => Err(MeshError::IndexOutOfRange { triangle, index, n_vertices }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [[f64; 3]; 4] =
        [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

    fn error(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> String {
        TriMesh::new(vertices.to_vec(), triangles.to_vec()).unwrap_err().to_string()
    }

    /// `n` × `m` squares, each cut in two; columns and rows may be glued to a torus or an annulus.
    fn grid(n: u32, m: u32, glue_columns: bool, glue_rows: bool) -> TriMesh {
        let columns = if glue_columns { n } else { n + 1 };
        let rows = if glue_rows { m } else { m + 1 };
        let id = |i: u32, j: u32| (j % rows) * columns + i % columns;
        let mut triangles = Vec::new();
        for (i, j) in (0..m).flat_map(|j| (0..n).map(move |i| (i, j))) {
            let [a, b, c, d] = [id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        let vertices = (0..columns * rows).map(|v| [f64::from(v), f64::from(v * v), 0.0]).collect();
        TriMesh::new(vertices, triangles).unwrap()
    }

    #[test]
    fn square_has_the_geometry_one_calculates_by_hand() {
        let mesh = TriMesh::new(SQUARE.to_vec(), vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        assert!((mesh.area() - 2.0).abs() < 1e-15);
        assert!((mesh.triangle_area(1) - 1.0).abs() < 1e-15);
        assert!((mesh.min_angle() - 0.5f64.atan().to_degrees()).abs() < 1e-12);
        assert!((mesh.mean_edge_length() - (6.0 + 5.0f64.sqrt()) / 5.0).abs() < 1e-15);
        assert_eq!(mesh.bounding_box(), [[0.0; 3], [2.0, 1.0, 0.0]]);
    }

    #[test]
    fn topology_of_disc_annulus_and_torus() {
        for (columns, rows, euler, n_loops) in
            [(false, false, 1, 1), (true, false, 0, 2), (true, true, 0, 0)]
        {
            let mesh = grid(4, 5, columns, rows);
            assert_eq!(mesh.euler_characteristic(), euler);
            assert_eq!(mesh.boundary_loops().len(), n_loops);
            assert_eq!(mesh.n_components(), 1);
        }
        let annulus = grid(4, 5, true, false);
        assert_eq!(annulus.boundary_loops(), [[0, 1, 2, 3], [20, 23, 22, 21]]);
    }

    #[test]
    fn two_pieces_are_counted() {
        let mut vertices = SQUARE.to_vec();
        vertices.extend(SQUARE.map(|[x, y, _]| [x, y, 1.0]));
        let mesh =
            TriMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]).unwrap();
        assert_eq!((mesh.n_components(), mesh.boundary_loops().len()), (2, 2));
    }

    #[test]
    fn every_fault_is_named() {
        let mut nan = SQUARE;
        nan[2][1] = f64::NAN;
        let mut fan = SQUARE.to_vec();
        fan.push([0.5, 0.5, 1.0]);
        let texts = [
            error(&SQUARE, &[]),
            error(&nan, &[[0, 1, 2], [0, 2, 3]]),
            error(&SQUARE, &[[0, 1, 2], [0, 2, 4]]),
            error(&SQUARE, &[[0, 1, 2], [3, 2, 3]]),
            error(&[[0.0; 3], [0.1; 3], [0.3; 3]], &[[0, 1, 2]]),
            error(&SQUARE, &[[0, 1, 2]]),
            error(&fan, &[[0, 1, 2], [0, 2, 3], [4, 2, 0]]),
        ];
        insta::assert_snapshot!(texts.join("\n\n"), @r"
        the mesh has no triangles
        help: a surface of at least one triangle is needed; point clouds are not read

        vertex 2 is at (2, NaN, 0), expected three finite numbers
        help: export the mesh again, or delete the vertex in the program that wrote it

        triangle 1 names vertex 4, expected 0 to 3 (the mesh has 4 vertices)
        help: vertex numbers start at 0; was the mesh exported with numbers that start at 1?

        triangle 1 has vertex 3 more than once, expected three different vertices
        help: `eplat mesh repair IN OUT` drops such triangles

        triangle 0 has no area: its corners lie on one line
        help: `eplat mesh repair IN OUT` joins corners that coincide; otherwise flip or remove the triangle in a mesh editor

        vertex 3 belongs to no triangle
        help: drop unused vertices before making a TriMesh; `eplat::mesh::read` does

        the edge between vertices 0 and 2, at (1.0, 0.5, 0.0), belongs to 3 triangles ([0, 1, 2]), expected 1 or 2
        help: a surface may not branch: delete the surplus triangles there in a mesh editor
        ");
    }
}
