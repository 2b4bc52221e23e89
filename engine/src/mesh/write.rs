//! Writes surfaces, each in the format of its file's extension.
//!
//! A file appears under its name only when it is whole.

use super::bytes::{Encoding, write_whole};
use super::format::Format;
use super::geometry::{Geometry, rows};
use super::{MeshError, Surface, TriMesh, carp, npz, obj, ply, stl, vtk};
use std::path::Path;

/// Writes `mesh` and its `point_data` (name, one value per vertex; NaN allowed) as XML .vtp.
///
/// # Errors
/// `DataLength` for an array of another length, `Write` if the file cannot be written.
pub fn write_vtp(
    path: &Path,
    mesh: &TriMesh,
    point_data: &[(&str, &[f64])],
) -> Result<(), MeshError> {
    write_whole(path, &vtk::vtp(&Geometry::new(mesh, point_data)?))
}

/// Writes `mesh` and its `point_data` (name, one value per vertex; NaN allowed) as legacy VTK 3.0.
///
/// # Errors
/// `DataLength` for an array of another length, `Write` if the file cannot be written.
pub fn write_vtk(
    path: &Path,
    mesh: &TriMesh,
    point_data: &[(&str, &[f64])],
    encoding: Encoding,
) -> Result<(), MeshError> {
    write_whole(path, &vtk::legacy(&Geometry::new(mesh, point_data)?, encoding))
}

impl Surface {
    /// Writes the mesh as .vtp with `point_data` (name, one value per vertex) in place of its own, and with
    /// its cell data.
    ///
    /// # Errors
    /// `DataLength`, `Write`.
    pub fn write_maps(&self, path: &Path, point_data: &[(&str, &[f64])]) -> Result<(), MeshError> {
        let cell_data = rows(&self.cell_data);
        let geometry = Geometry { cell_data, ..Geometry::new(&self.mesh, point_data)? };
        write_whole(path, &vtk::vtp(&geometry))
    }

    /// Writes the mesh and the data that the format of the file's extension holds; `encoding` matters
    /// to .vtk, .ply and .stl. Gives the names of the arrays that the format has no place for.
    ///
    /// # Errors
    /// `Extension`, `DataLength`, `Write`.
    pub fn write(&self, path: &Path, encoding: Encoding) -> Result<Vec<String>, MeshError> {
        let format = Format::of(path)?;
        let geometry = Geometry::of(self)?;
        match format {
            Format::Vtp => write_whole(path, &vtk::vtp(&geometry))?,
            Format::Vtu => write_whole(path, &vtk::vtu(&geometry))?,
            Format::Vtk => write_whole(path, &vtk::legacy(&geometry, encoding))?,
            Format::Ply => write_whole(path, &ply::written(&geometry, encoding))?,
            Format::Stl => write_whole(path, &stl::written(&geometry, encoding))?,
            Format::Obj => write_whole(path, &obj::written(&geometry))?,
            Format::Npz => npz::write(path, &geometry)?,
            Format::Carp => return carp::write(path, self),
        }
        let has_data = !matches!(format, Format::Stl | Format::Obj);
        let all = self.point_data.keys().chain(self.cell_data.keys()).cloned();
        Ok(if has_data { vec![] } else { all.collect() })
    }
}
