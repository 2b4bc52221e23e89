//! Modes of the surface at the places of a table's rows, and along the paths to them: what the forms
//! `surface` and `path` of an effect are made of.

use std::sync::Arc;

use super::{DataError, Placement, SOURCE, Table};
use crate::manifold::{Basis, Eikonal, ManifoldError, integrate_along_paths};
use crate::mesh::{MeshError, Places, Surface};

/// Most modes of a field that is tried as an effect.
pub const FIELD_MODES: usize = 64;

/// Modes at rows.
#[derive(Clone, Debug, Default)]
pub struct Probes {
    /// √λ of each mode, mm⁻¹.
    frequency: Vec<f64>,
    /// φ at each row's vertex, (rows, modes), mm⁻¹.
    at: Vec<f64>,
    /// ∫ φ ds along the path to each row's vertex, (rows, modes); empty without a column `source`.
    along: Vec<f64>,
    /// Lengths of these paths, mm.
    length: Vec<f64>,
    /// Activation from the sources of the rows.
    waves: Option<Waves>,
}

/// How many vertices of the surface activation is computed at, those of sources and rows among them; more where these
/// are more, or fewer would fold the surface.
const WAVE_VERTICES: usize = 2000;

/// Activation of the surface from the column `source`.
#[derive(Clone, Debug)]
pub struct Waves {
    /// A triangulation between vertices of the surface, prepared for arrival times.
    pub solver: Arc<Eikonal>,
    /// The vertex of the surface that each of the solver's is, ascending.
    pub vertices: Vec<u32>,
    /// Where the surface's are on that triangulation; `None` if they are the same.
    pub places: Option<Arc<Places>>,
    /// The solver's vertex at which activation starts, for each row (rows).
    pub source: Vec<u32>,
    /// The solver's vertex at which each row is (rows).
    pub at: Vec<u32>,
    /// Whether the surface has fibres, or directions of the solver's own.
    pub has_fibres: bool,
}

impl Probes {
    /// Of the rows of a placed table, along paths too if it has a column `source`.
    ///
    /// # Errors
    /// A source that is no vertex of the surface.
    pub(super) fn new(
        table: &Table,
        placement: &Placement,
        surface: &Surface,
        basis: &Basis,
    ) -> Result<Self, ProbeError> {
        let frequency: Vec<f64> = basis.eigenvalues.iter().map(|l| l.max(0.0).sqrt()).collect();
        let vertices = placement.of_rows();
        let at = vertices.iter().flat_map(|v| basis.at(*v as usize).iter().copied()).collect();
        if !table.has(SOURCE) {
            return Ok(Self { frequency, at, ..Self::default() });
        }
        let sources = Placement::by_column(table, SOURCE, surface)?;
        let n = basis.n_modes();
        // the modes and 1, whose integral is the length
        let with_one: Vec<f64> = (0..basis.n_vertices())
            .flat_map(|v| basis.at(v).iter().copied().chain([1.0]))
            .collect();
        let mut along = vec![0.0; vertices.len() * n];
        let mut length = vec![0.0; vertices.len()];
        let mut distinct = sources.clone();
        distinct.sort_unstable();
        distinct.dedup();
        for source in distinct {
            let integral = integrate_along_paths(&surface.mesh, source, &with_one, n + 1)?;
            for (row, vertex) in
                vertices.iter().enumerate().filter(|(row, _)| sources[*row] == source)
            {
                let own = &integral[*vertex as usize * (n + 1)..][..=n];
                along[row * n..][..n].copy_from_slice(&own[..n]);
                length[row] = own[n];
            }
        }
        let waves = Some(Waves::new(&sources, vertices, surface)?);
        Ok(Self { frequency, at, along, length, waves })
    }

    /// Activation from the sources of the rows; none without a column `source`.
    pub(super) fn waves(&self) -> Option<&Waves> {
        self.waves.as_ref()
    }

    /// Lengths of the paths, mm; none without a column `source`.
    pub(super) fn lengths(&self) -> &[f64] {
        &self.length
    }

    /// Number of modes.
    pub fn n_modes(&self) -> usize {
        self.frequency.len()
    }

    /// √λ of the last mode of `n`, mm⁻¹.
    pub fn frequency(&self, n: usize) -> f64 {
        self.frequency.iter().take(n).copied().fold(0.0, f64::max)
    }

    /// Mean length of the paths, mm, if there are any.
    pub fn mean_length(&self) -> Option<f64> {
        (!self.length.is_empty())
            .then(|| self.length.iter().sum::<f64>() / self.length.len() as f64)
    }

    /// √λ of each mode, mm⁻¹.
    pub fn frequencies(&self) -> &[f64] {
        &self.frequency
    }

    /// The modes, row-major (rows, modes): φ at each row's place in mm⁻¹ or, `along` the paths, ∫ φ ds.
    pub fn modes(&self, along: bool) -> &[f64] {
        if along { &self.along } else { &self.at }
    }
}

impl Waves {
    /// From the `sources` to the vertices `of_rows` (each of the surface, one per row), all of which are the solver's.
    fn new(sources: &[u32], of_rows: &[u32], surface: &Surface) -> Result<Self, ProbeError> {
        let fibres = surface.any_fibres().map(|(_, vectors)| vectors);
        let has_fibres = fibres.is_some();
        let n = surface.mesh.n_vertices();
        let (solver, vertices, places) = if n <= WAVE_VERTICES {
            (Eikonal::new(&surface.mesh, fibres.as_deref())?, (0..n as u32).collect(), None)
        } else {
            let coarse = surface.mesh.coarsened(WAVE_VERTICES, &[sources, of_rows].concat())?;
            let of = |of: Vec<[f64; 3]>| coarse.triangles.iter().map(|t| of[*t as usize]).collect();
            let fibres: Option<Vec<_>> = fibres.map(of);
            let solver = Eikonal::new(&coarse.mesh, fibres.as_deref())?;
            (solver, coarse.vertices, Some(coarse.places.into()))
        };
        let mut number = vec![0; n];
        for (new, old) in (0..).zip(&vertices) {
            number[*old as usize] = new;
        }
        let [source, at] =
            [sources, of_rows].map(|of| of.iter().map(|v| number[*v as usize]).collect());
        Ok(Self { solver: solver.into(), vertices, places, source, at, has_fibres })
    }
}

/// Why modes cannot be had at rows.
#[derive(Debug, thiserror::Error)]
pub enum ProbeError {
    /// A cell of the table.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The surface.
    #[error(transparent)]
    Manifold(#[from] ManifoldError),
    /// Its triangulation.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}
