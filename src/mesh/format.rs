//! Which kind of file a surface is written to.

use std::path::Path;

use super::{Encoding, MeshError, Surface, TriMesh, write_vtk, write_vtp};

/// A kind of file, told by the extension of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// XML, .vtp.
    Vtp,
    /// Legacy VTK, .vtk.
    Vtk,
}

impl Format {
    /// The format of the file `path`.
    ///
    /// # Errors
    /// [`MeshError::Extension`] for another extension.
    pub fn of(path: &Path) -> Result<Self, MeshError> {
        match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("vtp") => Ok(Self::Vtp),
            Some("vtk") => Ok(Self::Vtk),
            _ => Err(MeshError::Extension {
                path: path.into(),
                action: "write",
                supported: ".vtp or .vtk",
                help: "give the output file one of these extensions",
            }),
        }
    }
}

/// Writes `mesh` and its `point_data` (name, one value per vertex) in the format of the file's extension;
/// `encoding` matters to .vtk alone.
///
/// # Errors
/// Those of [`Format::of`], [`write_vtp`] and [`write_vtk`].
pub fn write(
    path: &Path,
    mesh: &TriMesh,
    point_data: &[(&str, &[f64])],
    encoding: Encoding,
) -> Result<(), MeshError> {
    match Format::of(path)? {
        Format::Vtp => write_vtp(path, mesh, point_data),
        Format::Vtk => write_vtk(path, mesh, point_data, encoding),
    }
}

impl Surface {
    /// Writes mesh and point data, as [`write`] does.
    ///
    /// # Errors
    /// Those of [`write`].
    pub fn write(&self, path: &Path, encoding: Encoding) -> Result<(), MeshError> {
        let data: Vec<(&str, &[f64])> =
            self.point_data.iter().map(|(name, values)| (name.as_str(), &values[..])).collect();
        write(path, &self.mesh, &data, encoding)
    }
}
