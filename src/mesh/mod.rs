//! Triangle surfaces: validation, topology, files, repair and the procedural left atrium.
//!
//! Lengths are millimetres once a surface is in memory; a file's own unit is an explicit input.
//! This layer knows nothing of eigenfunctions, fields or physics.

mod atrium;
mod error;
mod format;
mod refine;
mod repair;
mod surface;
mod topology;
mod tri_mesh;
mod units;
mod vtk;

pub use atrium::{Atrium, REGION_NAMES, left_atrium};
pub use error::{MeshError, Place};
pub use format::{Format, write};
pub use refine::Refined;
pub use repair::{repair, repair_arrays};
pub use surface::{Surface, read};
pub use tri_mesh::TriMesh;
pub use units::Units;
pub use vtk::{Encoding, write_vtk, write_vtp};

use nalgebra::Vector3;

/// The point as a vector one can calculate with.
fn vector(point: [f64; 3]) -> Vector3<f64> {
    Vector3::from(point)
}

/// Twice the area of a triangle times its unit normal.
fn area_vector(corners: [Vector3<f64>; 3]) -> Vector3<f64> {
    (corners[1] - corners[0]).cross(&(corners[2] - corners[0]))
}
