//! Triangle surfaces: validation, topology, files, mending and the procedural left atrium.
//!
//! Lengths are millimetres once a surface is in memory; a file's own unit is given, told by the file, or
//! guessed from the size, and said. This layer knows nothing of eigenfunctions, fields or physics.

mod atrium;
mod bytes;
mod carp;
mod carry;
mod connectivity;
mod content;
mod data;
mod decimate;
mod error;
mod faults;
mod flat;
mod format;
mod geometry;
mod join;
mod mend;
mod names;
mod nearest;
mod npz;
mod obj;
mod orient;
mod pieces;
mod ply;
mod quadric;
mod read;
mod refine;
mod size;
mod stl;
mod surface;
mod text;
mod topology;
mod tri_mesh;
mod units;
mod vtk;
mod write;

pub use atrium::{Atrium, REGION_NAMES, left_atrium};
pub use bytes::Encoding;
pub use carry::continue_fibres;
pub(crate) use carry::fibres_to_triangles;
pub use data::{Array, Data};
pub use decimate::Coarse;
pub use error::{MeshError, Piece, Place};
pub use format::{Format, files};
pub use read::{Reading, mended, read, repair};
pub use refine::{Refined, halfway};
pub use surface::{Axes, Fine, Places, Surface};
pub use tri_mesh::TriMesh;
pub use units::Units;
pub use write::{write_vtk, write_vtp};

use nalgebra::Vector3;

/// The point as a vector one can calculate with.
fn vector(point: [f64; 3]) -> Vector3<f64> {
    Vector3::from(point)
}

/// Twice the area of a triangle times its unit normal.
fn area_vector(corners: [Vector3<f64>; 3]) -> Vector3<f64> {
    (corners[1] - corners[0]).cross(&(corners[2] - corners[0]))
}
