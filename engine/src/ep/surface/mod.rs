//! Paced tissue on a triangle mesh: activation, recovery and voltage of a whole atrium.
//!
//! The monodomain equation with the modified Mitchell–Schaeffer cell at every vertex, P1 elements with
//! consistent mass, no-flux boundary, with or without fibres; the same split step as the strip's, but that the
//! gate turns by degrees (`lanes.rs`).
//!
//! # Source
//! Coveney et al. 2022, Methods, "Electrophysiology model"; solver: see `solver.rs`.

mod assembly;
mod fibres;
mod lanes;
mod operators;
mod pacing;
mod record;
mod simulation;
mod solver;
#[cfg(test)]
mod tests;
mod waves;

pub use fibres::{FibreError, Fibres};
pub use pacing::{Pacing, SurfaceError};
pub use record::BeatMap;
pub use simulation::{Simulation, State};
pub use waves::Waves;

use super::cell::Tissue;
use crate::mesh::TriMesh;
use nalgebra::Vector3;

/// What is paced.
#[derive(Debug, Clone, Copy)]
pub struct Substrate<'a> {
    /// The surface, mm.
    pub mesh: &'a TriMesh,
    /// The tissue at each vertex (n_vertices); with fibres, its diffusivity is that along them.
    pub tissue: &'a [Tissue],
    /// Directions of faster conduction; conduction is isotropic without them.
    pub fibres: Option<&'a Fibres>,
}

impl Substrate<'_> {
    /// Fibres at the corners of a triangle, and D across over D along.
    fn fibres_at(&self, corners: [u32; 3]) -> Option<([Vector3<f64>; 3], f64)> {
        let at = |f: &Fibres| corners.map(|v| Vector3::from(f.directions()[v as usize]));
        self.fibres.map(|fibres| (at(fibres), fibres.across()))
    }
}

fn by_vertex(vertex: &[u32], values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut out = vec![f64::NAN; vertex.len()];
    for (v, x) in vertex.iter().zip(values) {
        out[*v as usize] = x;
    }
    out
}
