//! Modes of the surface at the places of a table's rows, and along the paths to them: what the forms
//! `surface` and `path` of an effect are made of.

use std::sync::Arc;

use super::columns::is_further_source;
use super::{DataError, Ground, Placement, SOURCE, Table};
use crate::manifold::{Basis, ManifoldError, integrate_along_paths};
use crate::mesh::{MeshError, Surface};

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
    /// The surface below; `None` only where nothing was probed.
    ground: Option<Arc<Ground>>,
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
            let ground = Some(Ground::new(surface, vertices, vec![]).into());
            return Ok(Self { frequency, at, ground, ..Self::default() });
        }
        let sources = Placement::by_column(table, SOURCE, surface)?;
        let further = table.columns().iter().filter(|name| is_further_source(name));
        let own = sources.iter().copied().map(Some).collect();
        let mut all = vec![(SOURCE.to_owned(), own)];
        for name in further {
            all.push((name.clone(), Placement::by_column_if_filled(table, name, surface)?));
        }
        let ground = Some(Ground::new(surface, vertices, all).into());
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
        Ok(Self { frequency, at, along, length, ground })
    }

    /// The surface below the rows.
    pub(super) fn ground(&self) -> Option<&Ground> {
        self.ground.as_deref()
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
