//! The surface below a table's rows, as operators over the whole surface need it.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use super::ProbeError;
use super::finer::Finer;
use crate::manifold::{Eikonal, Gradient, Paths};
use crate::mesh::{Places, Surface, TriMesh};

/// How fine a triangulation is: at how many vertices of the surface, besides those of sources and rows; at more where fewer would
/// fold the surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fineness {
    /// 2,000, for any operator.
    Any,
    /// 1,000, for arrival times alone: these are corrected ([`Finer`]).
    Arrivals,
}

impl Fineness {
    fn n_vertices(self) -> usize {
        match self {
            Self::Any => 2000,
            Self::Arrivals => 1000,
        }
    }
}

/// A surface, and where on it rows are and activation starts.
#[derive(Debug)]
pub struct Ground {
    mesh: TriMesh,
    /// Of each triangle.
    fibres: Option<Vec<[f64; 3]>>,
    /// Of each vertex.
    vertex_fibres: Option<Vec<[f64; 3]>>,
    /// The vertex of each row.
    rows: Vec<u32>,
    /// Columns with vertices at which activation starts, of each row that has one; the first is `source`, if there is any.
    sources: Vec<(String, Vec<Option<u32>>)>,
    /// Of each [`Fineness`], made when an operator first asks for it.
    triangulations: [OnceLock<Arc<Triangulation>>; 2],
}

/// A triangulation between vertices of the surface.
#[derive(Debug)]
pub struct Triangulation {
    /// It.
    pub mesh: TriMesh,
    /// The vertex of the surface that each of its own is, ascending.
    pub vertices: Vec<u32>,
    /// Where the surface's are on it; `None` if they are the same.
    pub places: Option<Arc<Places>>,
    /// Columns with its vertices at which activation starts, for each row that has one (rows); the first is `source`, if
    /// there is any.
    pub sources: Vec<(String, Vec<Option<u32>>)>,
    /// Its vertex at which each row is (rows).
    pub at: Vec<u32>,
    /// Arrival times on it.
    pub eikonal: Arc<Eikonal>,
    /// What these are corrected by.
    pub finer: Arc<Finer>,
}

impl Triangulation {
    /// Its vertices at which activation starts, for each row that has one, by a column.
    pub fn source(&self, column: &str) -> Option<&[Option<u32>]> {
        let own = self.sources.iter().find(|(name, _)| name == column);
        own.map(|(_, of_rows)| &of_rows[..])
    }
}

impl Ground {
    pub(super) fn new(
        surface: &Surface,
        rows: &[u32],
        sources: Vec<(String, Vec<Option<u32>>)>,
    ) -> Self {
        let fibres = surface.any_fibres().filter(|_| !sources.is_empty());
        Self {
            mesh: surface.mesh.clone(),
            vertex_fibres: fibres.as_ref().and_then(|(name, _)| surface.fibres(name)),
            fibres: fibres.map(|(_, vectors)| vectors),
            rows: rows.to_vec(),
            sources,
            triangulations: Default::default(),
        }
    }

    /// Whether the table says where activation starts.
    pub fn has_sources(&self) -> bool {
        !self.sources.is_empty()
    }

    /// Whether the surface has fibres.
    pub fn has_fibres(&self) -> bool {
        self.fibres.is_some()
    }

    /// The gradient on the surface itself.
    pub fn gradient(&self) -> Gradient {
        Gradient::new(&self.mesh)
    }

    /// The triangulation on which operators are computed.
    ///
    /// # Errors
    /// What a mesh, and the solver of arrival times, refuse.
    pub fn triangulation(&self, fineness: Fineness) -> Result<&Arc<Triangulation>, ProbeError> {
        let kept = &self.triangulations[usize::from(fineness == Fineness::Arrivals)];
        if let Some(made) = kept.get() {
            return Ok(made);
        }
        let made = self.triangulated(fineness.n_vertices())?.into();
        Ok(kept.get_or_init(|| made))
    }

    fn triangulated(&self, n_vertices: usize) -> Result<Triangulation, ProbeError> {
        let n = self.mesh.n_vertices();
        let sources = self.sources.iter().flat_map(|(_, of_rows)| of_rows).flatten();
        let mut stay: Vec<u32> = sources.chain(&self.rows).copied().collect();
        stay.sort_unstable();
        stay.dedup();
        let (mesh, vertices, fibres, places) = if n <= n_vertices + stay.len() {
            (self.mesh.clone(), (0..n as u32).collect(), self.fibres.clone(), None)
        } else {
            // rows and sources come on top: many of them would leave too few vertices to choose
            let coarse = self.mesh.coarsened(n_vertices + stay.len(), &stay)?;
            let both = self.vertex_fibres.as_ref().zip(self.fibres.as_ref());
            let fibres = both.map(|(vertices, triangles)| coarse.mean_fibres(vertices, triangles));
            (coarse.mesh, coarse.vertices, fibres, Some(coarse.places.into()))
        };
        let eikonal = Eikonal::new(&mesh, fibres.as_deref())?.into();
        let mut number = vec![0; n];
        for (new, old) in (0..).zip(&vertices) {
            number[*old as usize] = new;
        }
        let new = |v: &u32| number[*v as usize];
        let at = self.rows.iter().map(new).collect();
        let of_rows = |rows: &[Option<u32>]| rows.iter().map(|v| v.as_ref().map(new)).collect();
        let sources =
            self.sources.iter().map(|(name, rows)| (name.clone(), of_rows(rows))).collect();
        let of_surface = (self.mesh.clone(), self.vertex_fibres.clone());
        let finer = Finer::new(of_surface, vertices.clone(), places.clone()).into();
        Ok(Triangulation { mesh, vertices, places, sources, at, eikonal, finer })
    }

    /// For each of these rows, how much the value at each vertex of the triangulation adds to the integral along the
    /// geodesic from the row's source to the row, mm. The geodesic is that of the surface itself.
    ///
    /// # Errors
    /// Those of [`Paths::new`].
    pub fn path_weights(
        &self,
        on: &Triangulation,
        rows: &[usize],
    ) -> Result<Vec<Vec<(u32, f64)>>, ProbeError> {
        let mut of_source: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (i, row) in rows.iter().enumerate() {
            if let Some(source) = self.sources.first().and_then(|(_, of_rows)| of_rows[*row]) {
                of_source.entry(source).or_default().push(i);
            }
        }
        let mut all = vec![vec![]; rows.len()];
        for (source, own) in of_source {
            let paths = Paths::new(&self.mesh, source)?;
            for i in own {
                all[i] = carried(&paths.weights(self.rows[rows[i]]), on.places.as_deref());
            }
        }
        Ok(all)
    }
}

/// Weights at the vertices of the surface as weights at those of the triangulation.
fn carried(weights: &[f64], places: Option<&Places>) -> Vec<(u32, f64)> {
    let mut sums: BTreeMap<u32, f64> = BTreeMap::new();
    for (vertex, weight) in (0u32..).zip(weights).filter(|(_, weight)| **weight != 0.0) {
        match places {
            None => drop(sums.insert(vertex, *weight)),
            Some(places) => places
                .on(vertex as usize)
                .for_each(|(v, share)| *sums.entry(v).or_default() += share * weight),
        }
    }
    sums.into_iter().collect()
}
