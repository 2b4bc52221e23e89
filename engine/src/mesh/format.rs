//! Which kind of file a mesh is in.

use super::bytes::read_bytes;
use super::content::Content;
use super::{MeshError, carp, npz, obj, ply, stl, vtk};
use std::path::{Path, PathBuf};

const EXTENSIONS: &str = ".vtp, .vtu, .vtk, .ply, .stl, .obj, .pts (openCARP) or .npz";

/// A kind of file, told by the extension of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// VTK's XML `PolyData`, .vtp.
    Vtp,
    /// VTK's XML `UnstructuredGrid`, .vtu.
    Vtu,
    /// Legacy VTK, .vtk.
    Vtk,
    /// Stanford's polygon format, .ply.
    Ply,
    /// Stereolithography, .stl.
    Stl,
    /// Wavefront, .obj.
    Obj,
    /// openCARP's three files, .pts, .elem and .lon.
    Carp,
    /// `NumPy` arrays, .npz.
    Npz,
}

impl Format {
    /// The format of the file `path`.
    ///
    /// # Errors
    /// [`MeshError::Extension`] for another extension.
    pub fn of(path: &Path) -> Result<Self, MeshError> {
        Self::named(path).ok_or_else(|| MeshError::Extension {
            path: path.into(),
            action: "write",
            supported: EXTENSIONS,
            help: "give the output file one of these extensions",
        })
    }

    fn named(path: &Path) -> Option<Self> {
        let extension = path.extension().and_then(|e| e.to_str())?.to_ascii_lowercase();
        Some(match extension.as_str() {
            "vtp" => Self::Vtp,
            "vtu" => Self::Vtu,
            "vtk" => Self::Vtk,
            "ply" => Self::Ply,
            "stl" => Self::Stl,
            "obj" => Self::Obj,
            "npz" => Self::Npz,
            "pts" | "elem" | "lon" => Self::Carp,
            _ => return None,
        })
    }

    /// The format of a file that is there: one without a known extension may be the base name of
    /// openCARP's files.
    fn to_read(path: &Path) -> Result<Self, MeshError> {
        let is_base = || !path.is_file() && carp::files(path).iter().any(|file| file.exists());
        Self::named(path).or_else(|| is_base().then_some(Self::Carp)).ok_or_else(|| {
            MeshError::Extension {
                path: path.into(),
                action: "read",
                supported: EXTENSIONS,
                help: "save the mesh as .vtp from ParaView or PyVista (pyvista.read(F).save('mesh.vtp'))",
            }
        })
    }
}

/// The files that a mesh named `path` is read from: openCARP's mesh is up to three.
pub fn files(path: &Path) -> Vec<PathBuf> {
    match Format::to_read(path) {
        Ok(Format::Carp) => carp::files(path).into_iter().filter(|file| file.exists()).collect(),
        _ => vec![path.to_owned()],
    }
}

/// Everything in the file, in its own unit and not yet validated.
pub(super) fn read_content(path: &Path) -> Result<Content, MeshError> {
    let format = Format::to_read(path);
    if matches!(format, Ok(Format::Carp)) {
        return carp::read(path);
    }
    let bytes = read_bytes(path)?;
    let parse = match format? {
        Format::Vtp | Format::Vtu => vtk::parse_xml,
        Format::Vtk => vtk::parse,
        Format::Ply => ply::parse,
        Format::Stl => stl::parse,
        Format::Obj => obj::parse,
        Format::Npz => npz::parse,
        Format::Carp => return carp::read(path),
    };
    parse(path, &bytes).map_err(|error| match error {
        MeshError::IndexOutOfRange { .. } => {
            MeshError::Invalid { path: path.into(), source: error.into(), picture: String::new() }
        }
        other => other,
    })
}
