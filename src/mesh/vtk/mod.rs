//! VTK files: the legacy format read and written, the XML format (.vtp) written.
//!
//! Knows lists of points, triangles and arrays; what makes a surface valid is `TriMesh`'s business.

mod attributes;
mod cells;
mod legacy;
mod scanner;
mod types;
mod write;

pub(super) use legacy::{Content, parse};
pub use write::{Encoding, write_vtk, write_vtp};
