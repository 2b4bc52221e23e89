//! What a mesh file is written from: a surface, or triangles that are none.

use super::{Data, MeshError, Surface, TriMesh};

/// An array to be written: `values.len() / width` rows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows<'a> {
    pub(super) name: &'a str,
    pub(super) width: usize,
    pub(super) values: &'a [f64],
}

/// Triangles in mm with their numbers.
#[derive(Clone, Debug)]
pub(super) struct Geometry<'a> {
    pub(super) vertices: &'a [[f64; 3]],
    pub(super) triangles: &'a [[u32; 3]],
    /// One row per vertex.
    pub(super) point_data: Vec<Rows<'a>>,
    /// One row per triangle.
    pub(super) cell_data: Vec<Rows<'a>>,
}

impl<'a> Geometry<'a> {
    /// `mesh` with scalars (name, one value per vertex).
    ///
    /// # Errors
    /// `DataLength`.
    pub(super) fn new(
        mesh: &'a TriMesh,
        point_data: &[(&'a str, &'a [f64])],
    ) -> Result<Self, MeshError> {
        let scalars = point_data.iter().map(|&(name, values)| Rows { name, width: 1, values });
        let point_data = scalars.collect();
        let (vertices, triangles) = (mesh.vertices(), mesh.triangles());
        Self { vertices, triangles, point_data, cell_data: vec![] }.checked()
    }

    /// A surface with all its arrays.
    ///
    /// # Errors
    /// `DataLength`.
    pub(super) fn of(surface: &'a Surface) -> Result<Self, MeshError> {
        Self {
            vertices: surface.mesh.vertices(),
            triangles: surface.mesh.triangles(),
            point_data: rows(&surface.point_data),
            cell_data: rows(&surface.cell_data),
        }
        .checked()
    }

    fn checked(self) -> Result<Self, MeshError> {
        let of_points = self.point_data.iter().map(|rows| (rows, self.vertices.len()));
        let of_cells = self.cell_data.iter().map(|rows| (rows, self.triangles.len()));
        let wrong = of_points.chain(of_cells).find(|(r, n)| r.values.len() != r.width * n);
        match wrong {
            None => Ok(self),
            Some((rows, n)) => Err(MeshError::DataLength {
                name: rows.name.into(),
                expected: rows.width * n,
                got: rows.values.len(),
            }),
        }
    }
}

/// The arrays, ready to be written.
pub(super) fn rows(data: &Data) -> Vec<Rows<'_>> {
    data.iter()
        .map(|(name, array)| Rows { name, width: array.width(), values: array.values() })
        .collect()
}
