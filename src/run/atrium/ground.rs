//! The surface that is simulated, with the fields on it and perhaps the draws of them.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use sha2::{Digest as _, Sha256};

use super::AtriumError;
use crate::mesh::{self, Reading, Surface};
use crate::report::{EMBEDDED_ATRIUM, FieldDraws, RunRecord};
use crate::store::Identity;

/// Edges of the embedded atrium, mm: short enough for a front.
const EDGE: f64 = 0.4;

/// A surface with parameter fields as point data.
#[derive(Clone, Debug)]
pub struct Ground {
    /// The surface, before it is refined.
    pub surface: Surface,
    /// Draws of whole fields of a posterior, on the same vertices.
    pub draws: Option<FieldDraws<'static>>,
    /// Whether the fields are of a posterior, which may leave a parameter's range; those of a user's may not.
    pub is_fitted: bool,
    /// Whether it is the embedded atrium, or was for the run that it is of.
    pub is_embedded: bool,
    /// Hashes of the files that were read, by what they are: part of what a checkpoint is known by.
    pub hashes: Identity,
}

impl Ground {
    /// The embedded left atrium with edges of 0.4 mm. It has no parameter fields.
    pub fn embedded() -> Self {
        Self { is_embedded: true, ..Self::of(Surface::left_atrium(EDGE)) }
    }

    /// A surface that is in memory.
    pub fn of(surface: Surface) -> Self {
        let hashes = BTreeMap::new();
        Self { surface, draws: None, is_fitted: false, is_embedded: false, hashes }
    }

    /// The surface in a file; `reading` may be the unit of its coordinates.
    ///
    /// # Errors
    /// [`AtriumError::Mesh`], [`AtriumError::Io`].
    pub fn read(file: &Path, reading: impl Into<Reading>) -> Result<Self, AtriumError> {
        let surface = mesh::read(file, reading)?;
        Self::of(surface).with_hash("hash of the surface", file)
    }

    /// Reads the surface that a run left in its output folder.
    ///
    /// # Errors
    /// Those of [`Ground::read`]; [`AtriumError::Run`] for a file that is not the run's.
    pub fn of_run(run: &Path, reading: impl FnOnce(&Path) -> Reading) -> Result<Self, AtriumError> {
        let file = RunRecord::file_of(run, "fields.vtp")?;
        let record = RunRecord::read(&run.join("run.json")).ok();
        let mesh = record.and_then(|record| record.provenance.mesh);
        let is_embedded = mesh.as_deref() == Some(EMBEDDED_ATRIUM);
        Ok(Self { is_fitted: true, is_embedded, ..Self::read(&file, reading(&file))? })
    }

    /// Adds the draws of fields that a run left in its output folder.
    ///
    /// # Errors
    /// [`AtriumError::Run`], [`AtriumError::Io`].
    pub fn with_draws_of(self, run: &Path) -> Result<Self, AtriumError> {
        let file = RunRecord::file_of(run, FieldDraws::FILE)?;
        let draws = Some(FieldDraws::read(&file)?);
        Self { draws, ..self }.with_hash("hash of the draws", &file)
    }

    /// Adds the SHA-256 of a file to what a checkpoint is known by.
    ///
    /// # Errors
    /// [`AtriumError::Io`].
    pub fn with_hash(mut self, name: &str, file: &Path) -> Result<Self, AtriumError> {
        let bytes = fs::read(file).map_err(AtriumError::io("read", file))?;
        self.hashes.insert(name.to_owned(), format!("{:x}", Sha256::digest(&bytes)));
        Ok(self)
    }

    /// Names of the data.
    pub(super) fn names(&self) -> Vec<String> {
        self.surface.names()
    }
}
