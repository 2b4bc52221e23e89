//! VTK files, legacy (.vtk) and XML (.vtp, .vtu), read and written.
//!
//! Knows lists of points, triangles and arrays; what makes a surface valid is `TriMesh`'s business.

mod attributes;
mod cells;
mod legacy;
mod scanner;
mod stream;
mod types;
mod write;
mod xml;
mod xml_array;
mod xml_cells;

pub(super) use legacy::parse;
pub(super) use write::{legacy, vtp, vtu};
pub(super) use xml::parse_xml;
