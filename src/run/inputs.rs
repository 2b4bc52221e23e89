//! Where a problem's surface and measurements come from.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use sha2::{Digest as _, Sha256};

use super::RunError;
use crate::experiment::Design;
use crate::mesh::{self, Reading, Surface};
use crate::report::{EMBEDDED_ATRIUM, SurfaceRecord};
use crate::table::Measurements;

/// Edge length of the embedded atrium, mm: about 5,000 vertices.
const ATRIUM_EDGE: f64 = 1.5;

/// What the model's text is called among the hashes of a run.
pub(super) const MODEL_ROLE: &str = "model";

/// Where a problem's surface and measurements come from. The default is the paper's synthetic
/// experiment on the embedded left atrium.
#[derive(Clone, Debug, Default)]
pub struct Inputs {
    /// The surface.
    pub mesh: MeshSource,
    /// Eigenpairs of the mesh from elsewhere, an NPZ file in the mesh's unit; else they are computed.
    pub basis: Option<PathBuf>,
    /// The measurements.
    pub data: DataSource,
    /// The model's file. The run's folder keeps its text, and a run goes on only with the same.
    pub model: Option<ModelText>,
    /// The command line that asked for the run, for its record; empty if there was none.
    pub command: String,
}

/// The text of a model's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModelText {
    /// The text.
    pub text: String,
    /// The file, an absolute path; absent for a text that has none.
    pub path: Option<PathBuf>,
}

/// What a problem's inputs are called, and what it takes to go back to them.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// The surface.
    pub mesh: String,
    /// The measurements.
    pub data: String,
    /// The command line; empty if there was none.
    pub command: String,
    /// The model's file, where it has one.
    pub model: Option<ModelText>,
    /// The table as it was given, CSV; absent where it was made.
    pub table: Option<Arc<[u8]>>,
    /// How to read or make the surface again; absent for one in memory.
    pub surface: Option<SurfaceRecord>,
    /// The file of eigenpairs from elsewhere, an absolute path.
    pub basis: Option<PathBuf>,
}

/// Where the surface comes from.
#[derive(Clone, Debug, Default)]
pub enum MeshSource {
    /// None is named: a model that has a field is on the embedded atrium, any other on no surface.
    #[default]
    Unnamed,
    /// The embedded procedural left atrium.
    Embedded {
        /// Length of its edges, mm, in [`Atrium::EDGE_RANGE`](crate::mesh::Atrium::EDGE_RANGE).
        edge: f64,
    },
    /// A mesh file.
    File {
        /// The file.
        path: PathBuf,
        /// How it is read; a unit is one by `into()`.
        reading: Reading,
        /// Whether every vertex is kept. Else a mesh of more than 100,000 is decimated to 20,000.
        whole: bool,
    },
    /// A surface in memory, mm.
    Surface(Box<Surface>),
}

impl MeshSource {
    /// The embedded procedural left atrium with edges of the usual length.
    pub const ATRIUM: Self = Self::Embedded { edge: ATRIUM_EDGE };
}

impl From<Surface> for MeshSource {
    fn from(surface: Surface) -> Self {
        Self::Surface(Box::new(surface))
    }
}

impl MeshSource {
    /// What it is called in records.
    pub fn name(&self) -> String {
        match self {
            Self::Unnamed | Self::Embedded { .. } => EMBEDDED_ATRIUM.into(),
            Self::File { path, .. } => path.display().to_string(),
            Self::Surface(_) => "a surface in memory".into(),
        }
    }

    /// What it takes to read or make it again, if it can be.
    fn record(&self) -> Result<Option<SurfaceRecord>, RunError> {
        Ok(match self {
            Self::Unnamed => Self::ATRIUM.record()?,
            Self::Embedded { edge } => Some(SurfaceRecord::Embedded { edge: *edge }),
            Self::File { path, reading, whole } => Some(SurfaceRecord::File {
                path: absolute(path)?,
                units: reading.units.map(|units| units.to_string()),
                piece: reading.piece,
                tolerance: reading.tolerance,
                whole: *whole,
            }),
            Self::Surface(_) => None,
        })
    }

    /// The surface of a record.
    pub(super) fn recorded(record: &SurfaceRecord) -> Result<Self, RunError> {
        Ok(match record {
            SurfaceRecord::Embedded { edge } => Self::Embedded { edge: *edge },
            SurfaceRecord::File { path, units, piece, tolerance, whole } => {
                let units = units.as_deref().map(str::parse).transpose()?;
                let reading = Reading { units, piece: *piece, tolerance: *tolerance, faults: None };
                Self::File { path: path.clone(), reading, whole: *whole }
            }
        })
    }
}

/// Where the measurements come from.
#[derive(Clone, Debug)]
pub enum DataSource {
    /// They are made on a known truth: the paper's experiment.
    Synthetic(Design),
    /// A CSV file.
    File(PathBuf),
    /// A table in memory.
    Table(Measurements),
}

impl Default for DataSource {
    fn default() -> Self {
        Self::Synthetic(Design::default())
    }
}

impl From<Measurements> for DataSource {
    fn from(table: Measurements) -> Self {
        Self::Table(table)
    }
}

impl From<&Path> for DataSource {
    fn from(path: &Path) -> Self {
        Self::File(path.to_owned())
    }
}

impl Inputs {
    /// What the surface and the measurements are called, and what it takes to go back to them.
    pub(super) fn origin(&self) -> Result<Origin, RunError> {
        let (data, table) = match &self.data {
            DataSource::Synthetic(_) => ("a synthetic experiment".into(), None),
            DataSource::File(path) => {
                let bytes = fs::read(path).map_err(RunError::read(path))?;
                (path.display().to_string(), Some(bytes))
            }
            DataSource::Table(table) => {
                ("a table in memory".into(), Some(table.to_csv().into_bytes()))
            }
        };
        let basis = self.basis.as_deref().map(absolute).transpose()?;
        Ok(Origin {
            mesh: self.mesh.name(),
            data,
            command: self.command.clone(),
            model: self.model.clone(),
            table: table.map(Arc::from),
            surface: self.mesh.record()?,
            basis,
        })
    }

    /// SHA-256 of the files, of a table in memory, and what was given, by role.
    pub(super) fn hashed(&self) -> Result<BTreeMap<String, String>, RunError> {
        let mut hashes = BTreeMap::new();
        if let MeshSource::File { path, reading, whole } = &self.mesh {
            hashes.insert("mesh".into(), hash_mesh(path)?);
            // the same file in another unit is another surface, and so are another piece and all vertices
            let choices = (reading.units, reading.piece, reading.tolerance, *whole);
            if choices != (None, None, None, false) {
                hashes.insert("mesh_reading".into(), hash(format!("{choices:?}").as_bytes()));
            }
        }
        if let MeshSource::Surface(surface) = &self.mesh {
            hashes.insert("mesh".into(), hash_surface(surface));
        }
        if let Some(path) = &self.basis {
            hashes.insert("basis".into(), hash_file(path)?);
        }
        match &self.data {
            DataSource::Synthetic(_) => None,
            DataSource::File(path) => hashes.insert("data".into(), hash_file(path)?),
            DataSource::Table(table) => {
                hashes.insert("data".into(), hash(table.to_csv().as_bytes()))
            }
        };
        let model = self.model.as_ref().map(|m| (MODEL_ROLE.to_owned(), hash(m.text.as_bytes())));
        hashes.extend(model);
        Ok(hashes)
    }
}

/// The path from the root, for records.
fn absolute(path: &Path) -> Result<PathBuf, RunError> {
    std::path::absolute(path).map_err(RunError::read(path))
}

/// SHA-256, hexadecimal.
pub fn hash(bytes: &[u8]) -> String {
    format!("{:x}", Sha256::digest(bytes))
}

/// SHA-256 of a file, hexadecimal.
///
/// # Errors
/// [`RunError::Read`].
pub fn hash_file(path: &Path) -> Result<String, RunError> {
    Ok(hash(&fs::read(path).map_err(RunError::read(path))?))
}

/// SHA-256 of a mesh, hexadecimal: of its file, or of its files one behind the other.
///
/// # Errors
/// [`RunError::Read`].
pub fn hash_mesh(path: &Path) -> Result<String, RunError> {
    let mut hasher = Sha256::new();
    for file in mesh::files(path) {
        hasher.update(fs::read(&file).map_err(RunError::read(&file))?);
    }
    Ok(format!("{:x}", hasher.finalize()))
}

/// SHA-256 of a surface in memory.
fn hash_surface(surface: &Surface) -> String {
    let mut hasher = Sha256::new();
    for x in surface.mesh.vertices().iter().flatten() {
        hasher.update(x.to_le_bytes());
    }
    for vertex in surface.mesh.triangles().iter().flatten() {
        hasher.update(vertex.to_le_bytes());
    }
    format!("{:x}", hasher.finalize())
}
