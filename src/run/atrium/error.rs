//! Why an atrium cannot be simulated.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::ep::cell::OutOfRange;
use crate::ep::surface::{FibreError, SurfaceError};
use crate::manifold::ManifoldError;
use crate::mesh::MeshError;
use crate::report::ReportError;
use crate::store::{CheckpointError, advice};

/// Why an atrium cannot be simulated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AtriumError {
    /// The surface lacks point data that a setting names.
    #[error("{what}; it has: {}\nhelp: {help}", listed(.found))]
    NoPointData {
        /// Which setting asks for what.
        what: String,
        /// Names that there are.
        found: Vec<String>,
        /// What to give instead.
        help: String,
    },
    /// No vertex to be paced has the value asked for.
    #[error(
        "--pace-region {name}={value}: no vertex has this value; the lowest are {lowest:?}\n\
         help: give one that occurs"
    )]
    NoRegion {
        /// Name of the point data.
        name: String,
        /// The value asked for.
        value: f64,
        /// The lowest values that occur.
        lowest: Vec<f64>,
    },
    /// A vertex to be paced that the surface does not have.
    #[error(
        "--pace {vertex} is no vertex of the surface, which has {n_vertices}\nhelp: vertices are counted from 0"
    )]
    NoVertex {
        /// The vertex asked for.
        vertex: usize,
        /// Vertices in the surface's file.
        n_vertices: usize,
    },
    /// Triangles are cut into more than there is memory for.
    #[error(
        "--refine {times}: about {n_vertices} vertices, which take {:.1} GB of memory; {:.1} GB are free\n\
         help: give a smaller number, 0.3 mm between vertices is enough", *bytes as f64 / 1e9, *free as f64 / 1e9
    )]
    Memory {
        /// How often each triangle is cut into four.
        times: u32,
        /// Vertices that this makes.
        n_vertices: u128,
        /// Bytes that these take.
        bytes: u128,
        /// Bytes that are free.
        free: u64,
    },
    /// Snapshots closer together than time steps.
    #[error("--snapshots {0} is shorter than a time step\nhelp: give ms, for instance 5")]
    Snapshots(f64),
    /// Parameters outside of the cell's valid ranges.
    #[error("vertex {vertex}: {source}")]
    Parameters {
        /// The vertex, of the refined mesh.
        vertex: usize,
        /// The parameter and its range.
        source: OutOfRange,
    },
    /// The folder to write is there.
    #[error(
        "--out {}: it exists\nhelp: name another folder, or remove this one", folder.display()
    )]
    Occupied {
        /// The folder.
        folder: PathBuf,
    },
    /// A field where openCARP needs one number.
    #[error(
        "--{name} is a field, but openCARP takes a conductivity for each region\nhelp: give a number"
    )]
    OneNumber {
        /// The option.
        name: &'static str,
    },
    /// The simulation to compare with is of another mesh.
    #[error(
        "--compare {}: it is of another mesh: {there} vertices there, {here} here\n\
         help: simulate both on the same surface with the same --refine", file.display()
    )]
    OtherMesh {
        /// Its beat.vtp.
        file: PathBuf,
        /// Vertices there.
        there: usize,
        /// Vertices here.
        here: usize,
    },
    /// What is to be compared with is no simulation.
    #[error(
        "--compare {}: it has no map {name}\nhelp: give the beat.vtp of a simulation", file.display()
    )]
    NoMap {
        /// The file.
        file: PathBuf,
        /// The map that it lacks.
        name: &'static str,
    },
    /// S1S2 that makes no sense.
    #[error("{what}\nhelp: {help}")]
    S1S2 {
        /// What is wrong.
        what: String,
        /// What to give instead.
        help: &'static str,
    },
    /// Parts of tasks that cannot be put together.
    #[error("the tasks in {} are not all there, or not of one plan: {what}\nhelp: {help}", folder.display())]
    Merge {
        /// The folder of the tasks.
        folder: PathBuf,
        /// What is wrong.
        what: String,
        /// What to do.
        help: &'static str,
    },
    /// A task's part that could not be kept, and so was for nothing.
    #[error(
        "the task's part could not be kept in {}: {reason}\nhelp: give the command again once the folder can be written to",
        folder.display()
    )]
    PartNotKept {
        /// Where.
        folder: PathBuf,
        /// Why.
        reason: String,
    },
    /// Threads that cannot be started.
    #[error("cannot start a thread: {0}\nhelp: RAYON_NUM_THREADS=1 asks for fewer")]
    Threads(io::Error),
    /// Sites that cannot be spread over the surface.
    #[error("--sites: {0}")]
    Sites(#[from] ManifoldError),
    /// Fewer draws than asked for, none at all, or draws on another mesh.
    #[error(
        "--draws {asked}: the run kept {kept} draws at {n_vertices} vertices; its fields.vtp has {expected}\n\
         help: ask for fewer draws, or repeat the run"
    )]
    Draws {
        /// Draws asked for.
        asked: usize,
        /// Draws that were kept.
        kept: usize,
        /// Vertices of the draws.
        n_vertices: usize,
        /// Vertices of the surface.
        expected: usize,
    },
    /// No parameter comes from a field that was drawn.
    #[error(
        "--draws {asked}: no parameter is the mean of a field that was drawn; these were: {}\n\
         help: give one as {}_mean", drawn.join(", "), drawn.first().map_or("NAME", String::as_str)
    )]
    NothingDrawn {
        /// Draws asked for.
        asked: usize,
        /// Fields that were drawn.
        drawn: Vec<String>,
    },
    /// The folder holds another simulation.
    #[error(
        "the simulation in {} is complete, and another one: {}\n\
         help: leave out --resume to replace it, or name another folder with --out",
        folder.display(), differences.join("; ")
    )]
    Other {
        /// The folder.
        folder: PathBuf,
        /// Name, value there, value here.
        differences: Vec<String>,
    },
    /// A file in the output folder that no simulation left has the name of one that a simulation leaves.
    #[error(
        "{} is of no simulation of eplat, and would be replaced\nhelp: move it away, or name another folder with --out DIR",
        path.display()
    )]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// A file or folder that cannot be read or written.
    #[error("cannot {action} {}: {source}\nhelp: {}", path.display(), advice(source))]
    Io {
        /// `read`, `write` or `remove`.
        action: &'static str,
        /// What.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// A simulation that diverges, or pacing that makes no sense.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// Fibres that are no directions on the surface.
    #[error(transparent)]
    Fibres(#[from] FibreError),
    /// A surface that cannot be read or written.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A file of a run that cannot be read, or is not the run's.
    #[error(transparent)]
    Run(#[from] ReportError),
    /// An interrupted simulation that cannot be gone on with.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A record that cannot be read.
    #[error(transparent)]
    Record(#[from] serde_json::Error),
}

impl AtriumError {
    /// That `action` failed on `path`.
    pub(crate) fn io(action: &'static str, path: &Path) -> impl Fn(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| Self::Io { action, path: path.clone(), source }
    }
}

fn listed(names: &[String]) -> String {
    if names.is_empty() { "none".into() } else { names.join(", ") }
}
