//! One connected surface in millimetres, with the numbers on it and where it comes from.

use super::{Array, Data, TriMesh, Units, carry, data};
use std::collections::BTreeMap;
use std::sync::Arc;

/// One connected surface.
#[derive(Clone, Debug)]
pub struct Surface {
    /// One piece, without unused vertices, mm.
    pub mesh: TriMesh,
    /// For each vertex of `mesh` its index in the file; of joined vertices the first.
    pub source_vertex: Vec<u32>,
    /// Number of vertices in the file.
    pub n_source_vertices: usize,
    /// Vertex counts of the pieces that were dropped, largest first; unused vertices do not count.
    pub dropped: Vec<usize>,
    /// Arrays with a row for each vertex of `mesh`.
    pub point_data: Data,
    /// Arrays with a row for each triangle of `mesh`.
    pub cell_data: Data,
    /// The unit of the file's coordinates.
    pub units: Units,
    /// Where its coordinates point.
    pub axes: Axes,
    /// Sentences for the user: what was mended or dropped, the unit, size and area, and a doubt about the
    /// unit.
    pub notes: Vec<String>,
    /// For each vertex of the file the one of `mesh`; [`DROPPED`] if there is none.
    pub(super) vertex_of: Vec<u32>,
    /// The surface that this one was decimated from.
    pub(super) fine: Option<Arc<Fine>>,
}

/// Where the coordinates of a surface point in the body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axes {
    /// x to the patient's left, y to the back, z to the head.
    Patient,
    /// Not known: no format of meshes tells it.
    #[default]
    Unknown,
}

/// A surface before it lost vertices, and where these are on what is left.
#[derive(Clone, Debug)]
pub struct Fine {
    /// The surface with all its vertices.
    pub surface: Surface,
    /// Where they are on the coarse surface.
    pub(super) places: Places,
    /// Mean and largest distance of a vertex from the coarse surface, mm.
    pub distances: [f64; 2],
}

impl Fine {
    /// Values at the vertices of the coarse surface at those of the fine one: linear in each triangle; a
    /// label (see [`Surface::scalar`]) is that of the nearest corner.
    pub fn carry(&self, coarse: &[f64]) -> Vec<f64> {
        if carry::are_labels(&coarse.to_vec().into()) {
            return self.places.0.iter().map(|place| coarse[heaviest(place) as usize]).collect();
        }
        self.places.carry(coarse)
    }
}

/// Where the vertices of a surface are on a coarser one: for each three vertices of this, and their weights.
#[derive(Clone, Debug)]
pub struct Places(pub(super) Vec<OnTriangle>);

impl Places {
    /// Values at the vertices of the coarse surface at those of the fine one: linear in each triangle.
    pub fn carry(&self, coarse: &[f64]) -> Vec<f64> {
        (0..self.0.len()).map(|vertex| self.at(vertex, coarse)).collect()
    }

    /// The same at one vertex.
    pub fn at(&self, vertex: usize, coarse: &[f64]) -> f64 {
        self.on(vertex).map(|(v, w)| w * coarse[v as usize]).sum()
    }

    /// The vertices of the coarse surface on which values at a vertex depend, and their weights.
    pub fn on(&self, vertex: usize) -> impl Iterator<Item = (u32, f64)> {
        let (corners, weights) = self.0[vertex];
        corners.into_iter().zip(weights).filter(|(_, w)| *w > 0.0)
    }
}

/// The corner that is nearest to a place, as far as weights tell.
pub(super) fn heaviest((corners, weights): &OnTriangle) -> u32 {
    let most = (0..3).max_by(|a, b| weights[*a].total_cmp(&weights[*b]));
    corners[most.unwrap_or(0)]
}

/// A place on a triangle: its corners and their weights.
pub(super) type OnTriangle = ([u32; 3], [f64; 3]);

/// What fibres are usually called.
const FIBRES: [&str; 4] = ["fibre", "fibres", "fiber", "fibers"];

/// Stands for a vertex that was dropped.
pub(super) const DROPPED: u32 = u32::MAX;

impl Surface {
    /// A surface that is in no file, all of whose vertices are kept; scalars by name
    /// (n_vertices).
    pub fn new(mesh: TriMesh, scalars: BTreeMap<String, Vec<f64>>) -> Self {
        let n = mesh.n_vertices();
        let all: Vec<u32> = (0..n as u32).collect();
        Self {
            mesh,
            source_vertex: all.clone(),
            n_source_vertices: n,
            dropped: vec![],
            point_data: scalars.into_iter().map(|(name, values)| (name, values.into())).collect(),
            cell_data: Data::new(),
            units: Units::Mm,
            axes: Axes::Unknown,
            notes: vec![],
            vertex_of: all,
            fine: None,
        }
    }

    /// The procedural left atrium with edges of about `edge` mm and its regions as point data.
    ///
    /// # Panics
    /// As [`left_atrium`](super::left_atrium).
    pub fn left_atrium(edge: f64) -> Self {
        let atrium = super::left_atrium(edge);
        let region = atrium.region.iter().map(|region| f64::from(*region)).collect();
        let surface = Self::new(atrium.mesh, BTreeMap::from([("region".into(), region)]));
        Self { axes: Axes::Patient, ..surface }
    }

    /// The vertex of `mesh` that is at the place of vertex `source` of the file; `None` if it was dropped.
    pub fn vertex_of_source(&self, source: usize) -> Option<u32> {
        self.vertex_of.get(source).copied().filter(|vertex| *vertex != DROPPED)
    }

    /// The surface that this one was decimated from.
    pub fn fine(&self) -> Option<&Fine> {
        self.fine.as_deref()
    }

    /// Every scalar of the point data (n_vertices); an array of several components gives `name_0`,
    /// `name_1`, ….
    pub fn scalars(&self) -> BTreeMap<String, Vec<f64>> {
        data::columns(&self.point_data)
    }

    /// Names of all that [`Surface::scalar`] finds.
    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = [&self.point_data, &self.cell_data]
            .into_iter()
            .flat_map(|data| data.iter().flat_map(|(name, array)| array.names(name)))
            .collect();
        names.sort();
        names.dedup();
        names
    }

    /// The scalar `name` at the vertices: of the point data, else of the cell data, whose values are
    /// carried over by area. Whole numbers of few kinds are labels: the label with most area wins.
    pub fn scalar(&self, name: &str) -> Option<Vec<f64>> {
        let column = |data: &Data| {
            data.iter().find_map(|(array_name, array)| {
                let k = array.names(array_name).iter().position(|n| n == name)?;
                Some(Array::from(array.column(k)))
            })
        };
        let at_vertices = column(&self.point_data)
            .or_else(|| Some(carry::to_vertices(&self.mesh, &column(&self.cell_data)?)))?;
        Some(at_vertices.values().to_vec())
    }

    /// The fibres `name` at the vertices: of the point data as they are, else the mean axis of the triangles
    /// around, whose vectors have no sign; 0 where none is known.
    pub fn fibres(&self, name: &str) -> Option<Vec<[f64; 3]>> {
        vectors(&self.point_data, name).or_else(|| {
            let cells = vectors(&self.cell_data, name)?;
            Some(carry::fibres_to_vertices(&self.mesh, &cells))
        })
    }

    /// The fibres in the triangles, under any of the names that they usually have, and this name.
    pub fn any_fibres(&self) -> Option<(&'static str, Vec<[f64; 3]>)> {
        FIBRES.iter().find_map(|name| Some((*name, self.triangle_fibres(name)?)))
    }

    /// The fibres `name` in the triangles: of the cell data, else the mean axis of the three corners.
    pub fn triangle_fibres(&self, name: &str) -> Option<Vec<[f64; 3]>> {
        vectors(&self.cell_data, name).or_else(|| {
            let vertices = vectors(&self.point_data, name)?;
            Some(carry::fibres_to_triangles(&self.mesh, &vertices))
        })
    }
}

/// The vectors `name`, or those whose parts are `name_0` to `name_2`.
fn vectors(data: &Data, name: &str) -> Option<Vec<[f64; 3]>> {
    if let Some(array) = data.get(name) {
        return array.vectors().map(<[_]>::to_vec);
    }
    let part = |k: usize| data.get(&format!("{name}_{k}"))?.scalars();
    let (x, y, z) = (part(0)?, part(1)?, part(2)?);
    part(3).is_none().then(|| (0..x.len()).map(|i| [x[i], y[i], z[i]]).collect())
}
