//! VTK files, legacy (.vtk) and XML (.vtp), read and written.
//!
//! Knows lists of points, triangles and arrays; what makes a surface valid is `TriMesh`'s business.

mod attributes;
mod cells;
mod legacy;
mod scanner;
mod types;
mod write;
mod xml;

pub(super) use legacy::{Content, parse};
pub use write::{Encoding, write_vtk, write_vtp};
pub(super) use xml::parse_xml;
