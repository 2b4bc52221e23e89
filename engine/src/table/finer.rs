//! The surface with its triangles cut, to correct arrival times that were computed on larger ones.

use std::sync::{Arc, OnceLock};

use super::ProbeError;
use crate::manifold::{Eikonal, Front, ManifoldError, Medium};
use crate::mesh::{Places, Refined, TriMesh, fibres_to_triangles, halfway};

/// Triangles are cut until the next cut would make more vertices.
const MOST: usize = 50_000;
/// About how many vertices a surface has for each one that it had before its triangles were cut.
const PER_CUT: usize = 4;

/// Where arrival times are off by less than on a triangulation between some vertices of the surface.
#[derive(Debug)]
pub struct Finer {
    /// The surface, and fibres at its vertices.
    mesh: TriMesh,
    fibres: Option<Vec<[f64; 3]>>,
    /// The surface's vertices that are the triangulation's.
    vertices: Vec<u32>,
    /// Where the surface's vertices are on the triangulation; `None` if they are the same.
    places: Option<Arc<Places>>,
    /// Made when arrivals are first asked for.
    cut: OnceLock<Cut>,
}

/// A finer triangulation, and the solver on it.
#[derive(Debug)]
struct Cut {
    surface: Refined,
    solver: Eikonal,
}

impl Finer {
    /// Of a surface with fibres at its vertices, some of which are a triangulation's.
    pub(crate) fn new(
        (mesh, fibres): (TriMesh, Option<Vec<[f64; 3]>>),
        vertices: Vec<u32>,
        places: Option<Arc<Places>>,
    ) -> Self {
        Self { mesh, fibres, vertices, places, cut: OnceLock::new() }
    }

    fn cut(&self) -> Result<&Cut, ProbeError> {
        if let Some(made) = self.cut.get() {
            return Ok(made);
        }
        let made = self.made()?;
        Ok(self.cut.get_or_init(|| made))
    }

    /// Cuts the triangles. Where a further cut would leave no surface, the last is taken.
    fn made(&self) -> Result<Cut, ProbeError> {
        let mut surface = Refined::new(self.mesh.clone(), 0)?;
        let mut times = 0;
        while PER_CUT * surface.mesh.n_vertices() <= MOST
            && let Ok(finer) = Refined::new(self.mesh.clone(), times + 1)
        {
            surface = finer;
            times += 1;
        }
        let parts = 4_usize.pow(times);
        let in_triangles = |fibres: &Vec<[f64; 3]>| {
            fibres_to_triangles(&surface.mesh, &surface.carry(fibres.clone(), halfway))
        };
        let fibres = self.fibres.as_ref().map(in_triangles);
        let of_surface = |error| match error {
            ManifoldError::NoFibre { triangle, fibre } => {
                ManifoldError::NoFibre { triangle: triangle / parts, fibre }
            }
            other => other,
        };
        let solver = Eikonal::new(&surface.mesh, fibres.as_deref()).map_err(of_surface)?;
        Ok(Cut { surface, solver })
    }

    /// Number of vertices of the finer triangulation.
    ///
    /// # Errors
    /// [`ManifoldError::NoFibre`], with the number of the surface's triangle.
    pub fn n_vertices(&self) -> Result<usize, ProbeError> {
        Ok(self.cut()?.surface.mesh.n_vertices())
    }

    /// First arrivals, ms (n_vertices of the triangulation), of each activation from its sources, which are (vertex, onset in ms).
    /// The medium is that at the triangulation's vertices; between them it is linear.
    ///
    /// # Errors
    /// Those of [`Finer::n_vertices`].
    pub fn arrivals(
        &self,
        medium: &Medium<'_>,
        activations: &[Vec<(u32, f64)>],
    ) -> Result<Vec<Vec<f64>>, ProbeError> {
        let Cut { surface, solver } = self.cut()?;
        let carried = |values: &[f64]| {
            let of_surface = match &self.places {
                Some(places) => places.carry(values),
                None => values.to_vec(),
            };
            surface.carry(of_surface, |a, b| 0.5 * (a + b))
        };
        let slowness = carried(medium.slowness);
        let [ratio, angle, thickness] =
            [medium.ratio, medium.angle, medium.thickness].map(|of| of.map(carried));
        let medium = Medium {
            slowness: &slowness,
            ratio: ratio.as_deref(),
            angle: angle.as_deref(),
            thickness: thickness.as_deref(),
        };
        // the surface's vertices come first among those of the cut one, and have its numbers
        let vertices = &self.vertices;
        let here = |(vertex, onset): &(u32, f64)| (vertices[*vertex as usize], *onset);
        let mut front = Front::default();
        let mut of_activation = |sources: &Vec<(u32, f64)>| {
            let sources: Vec<(u32, f64)> = sources.iter().map(here).collect();
            let arrival = solver.settled(&medium, &sources, &mut front);
            vertices.iter().map(|v| arrival[*v as usize]).collect()
        };
        Ok(activations.iter().map(&mut of_activation).collect())
    }
}
