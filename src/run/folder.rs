//! A folder for results, tried before anything slow is done.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::RunError;
use crate::report::RunRecord;
use crate::store::write_file;

/// An output folder that can be written to; it is made when there are results.
#[derive(Clone, Debug)]
pub struct OutputFolder(PathBuf);

impl OutputFolder {
    /// Tries the folder, or the nearest one above it that exists.
    ///
    /// # Errors
    /// [`RunError::Unwritable`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RunError> {
        let path = path.as_ref();
        let existing = path.ancestors().find(|p| p.exists()).unwrap_or(Path::new("."));
        tempfile::tempfile_in(existing).map_err(RunError::unwritable(path))?;
        Ok(Self(path.to_owned()))
    }

    /// Refuses a folder with a finished run of another model than `model`: writing would replace it.
    ///
    /// # Errors
    /// [`RunError::Occupied`].
    pub fn refuse_another(&self, model: &str) -> Result<(), RunError> {
        let record = self.file("run.json");
        if !record.exists() {
            return Ok(());
        }
        let holds = match RunRecord::read(&record) {
            Ok(record) if record.model == model => return Ok(()),
            Ok(record) => format!("a finished run of the model {}", record.model),
            Err(_) => "a run.json that is not of this version of eplat".to_owned(),
        };
        let (folder, model) = (self.0.clone(), model.to_owned());
        Err(RunError::Occupied { folder, holds, model })
    }

    /// Makes the folder, once there is something to put in it.
    ///
    /// # Errors
    /// [`RunError::Unwritable`].
    pub fn make(&self) -> Result<(), RunError> {
        fs::create_dir_all(&self.0).map_err(RunError::unwritable(&self.0))
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// The path of a file in it.
    pub fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Makes the folder and writes a file in it, whole or not at all.
    ///
    /// # Errors
    /// [`RunError::Unwritable`], [`RunError::Write`].
    pub fn save(&self, name: &str, text: &str) -> Result<(), RunError> {
        self.make()?;
        let path = self.file(name);
        write_file(&path, |file| file.write_all(text.as_bytes())).map_err(RunError::write(&path))
    }

    /// Where it holds an unfinished run.
    pub fn checkpoint(&self) -> PathBuf {
        self.file("checkpoint")
    }
}
