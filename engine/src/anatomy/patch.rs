//! A part of a surface with two coordinates.

use super::AnatomyError;
use crate::mesh::TriMesh;
use std::collections::BTreeMap;

/// A part of a surface with two coordinates.
#[derive(Clone, Debug)]
pub(super) struct Patch {
    /// It alone.
    pub(super) mesh: TriMesh,
    /// Its triangles' numbers in the whole.
    pub(super) triangles: Vec<u32>,
    /// Its vertices' numbers in the whole (n_vertices).
    pub(super) vertices: Vec<u32>,
    /// Both coordinates (n_vertices each).
    pub(super) at: [Vec<f64>; 2],
}

impl Patch {
    /// These triangles, with both coordinates 0.
    pub(super) fn new(whole: &TriMesh, triangles: Vec<u32>) -> Result<Self, AnatomyError> {
        let mut own: BTreeMap<u32, u32> = BTreeMap::new();
        let mut vertices = vec![];
        let mut number = |v: u32| {
            *own.entry(v).or_insert_with(|| {
                vertices.push(v);
                vertices.len() as u32 - 1
            })
        };
        let corners = triangles.iter().map(|t| whole.triangles()[*t as usize].map(&mut number));
        let corners: Vec<[u32; 3]> = corners.collect();
        let points = vertices.iter().map(|v| whole.vertices()[*v as usize]).collect();
        let at = [(); 2].map(|()| vec![0.0; vertices.len()]);
        Ok(Self { mesh: TriMesh::new(points, corners)?, triangles, vertices, at })
    }

    /// Both coordinates by the vertex of the whole.
    pub(super) fn by_vertex(&self) -> BTreeMap<u32, [f64; 2]> {
        (0..)
            .zip(&self.vertices)
            .map(|(i, v): (usize, _)| (*v, self.at.each_ref().map(|of| of[i])))
            .collect()
    }
}
