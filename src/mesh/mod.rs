//! Triangle surfaces: validation, topology, files, repair and the procedural left atrium.
//!
//! Lengths are millimetres.  This layer knows nothing of eigenfunctions, fields or physics.

mod tri_mesh;

pub use tri_mesh::{MeshError, TriMesh};
