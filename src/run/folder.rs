//! A folder for results: tried before anything slow is done, written to by one process, and never with files of
//! two runs.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::RunError;
use crate::mesh::MeshError;
use crate::report::{ReportError, RunRecord};
use crate::store::{
    Checkpoint, FolderLock, LockError, TEMPORARY, is_name, seals, unchanged, write_file,
    write_file_durably,
};

/// What a folder may hold: a record, which is written last, and the files that belong to it.
const KINDS: [(&str, &[&str]); 2] = [
    (
        "run.json",
        &[
            "summary.csv",
            "summary.json",
            "draws.csv",
            "posterior.zarr",
            "loo.csv",
            "fields.vtp",
            "fields_full.vtp",
            "field_draws.npz",
            "model.rs",
            "measurements.csv",
            "unknowns.npz",
            "rows.csv",
            "report.html",
        ],
    ),
    ("map.json", &["map.csv", "fields.vtp"]),
];

/// Names files while they take the place of others: where it is, these are of two runs.
const REPLACING: &str = ".eplat-replacing";

/// An output folder that can be written to, and to which no other process writes. One that was made for nothing
/// goes again.
#[derive(Clone, Debug)]
pub struct OutputFolder {
    path: PathBuf,
    _lock: Arc<FolderLock>,
}

impl OutputFolder {
    /// Makes the folder or takes the one that is there, and removes what a killed process left half-written.
    ///
    /// # Errors
    /// [`RunError::Unwritable`]; [`RunError::InUse`] where another process, or another `OutputFolder`, writes to it.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RunError> {
        let path = path.as_ref();
        let existing = path.ancestors().find(|p| p.exists()).unwrap_or(Path::new("."));
        tempfile::tempfile_in(existing).map_err(RunError::unwritable(path))?;
        let lock = FolderLock::take(path).map_err(|error| match error {
            LockError::Held(process) => RunError::in_use(path, process),
            LockError::Io(error) => RunError::unwritable(path)(error),
        })?;
        let folder = Self { path: path.to_owned(), _lock: Arc::new(lock) };
        folder.remove_half().map_err(RunError::unwritable(path))?;
        Ok(folder)
    }

    /// Removes the files of which some may be of one run and some of another.
    fn remove_half(&self) -> std::io::Result<()> {
        let marker = self.file(REPLACING);
        if !marker.exists() {
            return Ok(());
        }
        let names = fs::read_to_string(&marker)?;
        names.lines().filter(|name| is_name(name)).try_for_each(|name| remove(&self.file(name)))?;
        fs::remove_file(marker)
    }

    /// Refuses a folder with files that a run of `model` would replace: those of a finished run of another model,
    /// and files that are of no run.
    ///
    /// # Errors
    /// [`RunError::Occupied`], [`RunError::Foreign`].
    pub fn refuse_another(&self, model: &str) -> Result<(), RunError> {
        let record = self.file("run.json");
        if !self.holds_results() {
            return self.refuse_foreign(known());
        }
        // a Zarr folder of ours has this file
        if self.file("posterior.zarr").exists() && !self.file("posterior.zarr/zarr.json").exists() {
            return self.refuse_foreign(["posterior.zarr"].into_iter());
        }
        if !record.exists() {
            return Ok(());
        }
        let holds = match RunRecord::read(&record) {
            Ok(record) if record.model == model => return Ok(()),
            Ok(record) => format!("a finished run of the model {}", record.model),
            Err(_) => "a run.json that is not of this version of eplat".to_owned(),
        };
        let (folder, model) = (self.path.clone(), model.to_owned());
        Err(RunError::Occupied { folder, holds, model })
    }

    /// Refuses a folder with the chains of an interrupted run, before anything slow is done.
    ///
    /// # Errors
    /// [`RunError::Checkpoint`].
    pub fn refuse_interrupted(&self) -> Result<(), RunError> {
        Ok(Checkpoint::require_free(&self.checkpoint())?)
    }

    /// Refuses a folder in which a file has one of these names.
    ///
    /// # Errors
    /// [`RunError::Foreign`].
    pub fn refuse_foreign<'n>(
        &self,
        mut names: impl Iterator<Item = &'n str>,
    ) -> Result<(), RunError> {
        match names.find(|name| self.file(name).exists()) {
            Some(name) => Err(RunError::Foreign { path: self.file(name) }),
            None => Ok(()),
        }
    }

    /// Whether there is a record of eplat's.
    fn holds_results(&self) -> bool {
        let is_record = |name: &str| {
            let value = fs::read(self.file(name)).ok();
            let value = value.and_then(|v| serde_json::from_slice::<Value>(&v).ok());
            value.is_some_and(|value| value.get("model").is_some())
        };
        KINDS.iter().any(|(record, _)| is_record(record))
    }

    /// A folder for new files, from which [`OutputFolder::publish`] moves them. Dropped before that, it leaves what
    /// was there untouched.
    ///
    /// # Errors
    /// [`RunError::Unwritable`].
    pub fn begin(&self) -> Result<NewFiles, RunError> {
        self.make()?;
        let folder = tempfile::Builder::new().prefix(TEMPORARY).tempdir_in(&self.path);
        Ok(NewFiles(folder.map_err(RunError::unwritable(&self.path))?))
    }

    /// Puts the files of these names, the record last, in the place of all that earlier runs left. A process that
    /// is killed meanwhile leaves no record, and the next one removes what else it left.
    ///
    /// # Errors
    /// [`RunError::Write`].
    pub(super) fn replace(&self, new: &NewFiles, names: &[&str]) -> Result<(), RunError> {
        self.swap(new, names, || self.clear(), known())
    }

    /// Puts files and folders of these names, the record last, in the place of earlier ones.
    ///
    /// # Errors
    /// [`RunError::Write`].
    pub(super) fn put(&self, new: &NewFiles, names: &[&str]) -> Result<(), RunError> {
        let earlier: Vec<&str> = names.iter().rev().copied().collect();
        self.swap(new, names, || self.remove(&earlier), names.iter().copied())
    }

    /// Writes `record`, with the hashes of what is new and of the files that are `kept` beside it, and puts all in
    /// the place of earlier ones and of the files that are to be `gone`. A process that is killed meanwhile leaves no
    /// record, and the next one removes what else it left.
    ///
    /// # Errors
    /// [`RunError::Write`], [`RunError::Read`].
    pub fn publish(
        &self,
        new: &NewFiles,
        (name, mut record): (&str, Value),
        kept: &[String],
        gone: &[String],
    ) -> Result<(), RunError> {
        let mut names = new.names().map_err(RunError::read(new.0.path()))?;
        let mut files = seals(&self.path, kept).map_err(RunError::read(&self.path))?;
        files.extend(seals(new.0.path(), &names).map_err(RunError::read(new.0.path()))?);
        record["files"] = json!(files);
        let path = new.file(name);
        write_file(&path, |file| writeln!(file, "{record:#}"))
            .map_err(|error| new.named(self, RunError::write(&path)(error)))?;
        names.push(name.to_owned());
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let earlier: Vec<&str> =
            names.iter().rev().copied().chain(gone.iter().map(String::as_str)).collect();
        let all = earlier.iter().copied().chain(kept.iter().map(String::as_str));
        self.swap(new, &names, || self.remove(&earlier), all)
    }

    /// Makes `room`, the earlier record first, and puts files and folders of these names there, the record last. A
    /// process that is killed meanwhile leaves no record, and the next one removes `all` that is there.
    fn swap<'n>(
        &self,
        new: &NewFiles,
        names: &[&str],
        room: impl FnOnce() -> Result<(), RunError>,
        all: impl Iterator<Item = &'n str>,
    ) -> Result<(), RunError> {
        let marker = self.file(REPLACING);
        let all: Vec<&str> = all.collect();
        write_file_durably(&marker, |file| writeln!(file, "{}", all.join("\n")))
            .map_err(RunError::write(&marker))?;
        room()?;
        for name in names {
            let path = self.file(name);
            fs::rename(new.file(name), &path).map_err(RunError::write(&path))?;
        }
        fs::remove_file(&marker).map_err(RunError::write(&marker))
    }

    /// Removes the results of a run.
    ///
    /// # Errors
    /// [`RunError::Write`].
    pub fn clear(&self) -> Result<(), RunError> {
        // without a record nobody reads the others
        let records = KINDS.iter().map(|(record, _)| *record);
        self.remove(&records.chain(known()).collect::<Vec<_>>())
    }

    /// Removes files and folders of these names, where they are there.
    ///
    /// # Errors
    /// [`RunError::Write`].
    pub fn remove(&self, names: &[&str]) -> Result<(), RunError> {
        names
            .iter()
            .map(|name| self.file(name))
            .try_for_each(|path| remove(&path).map_err(RunError::write(&path)))
    }

    /// Makes the folder, if it has gone.
    ///
    /// # Errors
    /// [`RunError::Unwritable`].
    pub fn make(&self) -> Result<(), RunError> {
        fs::create_dir_all(&self.path).map_err(RunError::unwritable(&self.path))
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The path of a file in it.
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
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

    /// Writes `record`, with the hashes of these files and folders beside it: the last thing that a command does.
    ///
    /// # Errors
    /// Those of [`OutputFolder::save`]; [`RunError::Read`].
    pub fn save_record<N: AsRef<str>>(
        &self,
        name: &str,
        mut record: Value,
        files: impl IntoIterator<Item = N>,
    ) -> Result<(), RunError> {
        record["files"] = json!(seals(&self.path, files).map_err(RunError::read(&self.path))?);
        self.save(name, &format!("{record:#}\n"))
    }

    /// The record of this name, null where there is none, and the files that it names, as far as nobody has changed
    /// them since.
    pub fn earlier(&self, name: &str) -> (Value, Vec<String>) {
        let text = fs::read_to_string(self.file(name)).unwrap_or_default();
        let record: Value = serde_json::from_str(&text).unwrap_or_default();
        let files = serde_json::from_value(record["files"].clone()).unwrap_or_default();
        let files = unchanged(&self.path, &files);
        (record, files)
    }

    /// Where it holds an unfinished run.
    pub fn checkpoint(&self) -> PathBuf {
        self.file("checkpoint")
    }
}

/// Files that have not taken their place yet.
#[derive(Debug)]
pub struct NewFiles(TempDir);

impl NewFiles {
    /// The folder that they are in meanwhile.
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// Their names, in order.
    fn names(&self) -> std::io::Result<Vec<String>> {
        let entries = fs::read_dir(self.0.path())?;
        let mut names = entries
            .map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()))
            .collect::<std::io::Result<Vec<String>>>()?;
        names.sort();
        Ok(names)
    }

    /// The path of a file among them.
    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The hashes of those of these names.
    ///
    /// # Errors
    /// [`RunError::Read`].
    pub(super) fn seals(&self, names: &[&str]) -> Result<BTreeMap<String, String>, RunError> {
        seals(self.0.path(), names).map_err(RunError::read(self.0.path()))
    }

    /// The error by the name that a file was to have in `out`, in place of the one that it has meanwhile.
    pub fn named(&self, out: &OutputFolder, mut error: RunError) -> RunError {
        if let RunError::Write { path, .. }
        | RunError::Report(ReportError::Write { path, .. })
        | RunError::Mesh(MeshError::Write { path, .. }) = &mut error
            && let Ok(name) = path.strip_prefix(self.0.path())
        {
            *path = out.path().join(name);
        }
        error
    }
}

/// The names of all files that runs leave.
fn known() -> impl Iterator<Item = &'static str> {
    KINDS.iter().flat_map(|(record, files)| files.iter().copied().chain([*record]))
}

/// Removes a file or a folder, if it is there.
fn remove(path: &Path) -> std::io::Result<()> {
    match fs::symlink_metadata(path) {
        Ok(found) if found.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    const NAMES: [&str; 3] = ["a", "b", "record"];

    /// A file that is not there when it is to take its place stands for a kill at that moment.
    #[test]
    fn whoever_dies_while_files_are_replaced_leaves_no_record_and_the_next_one_removes_the_rest() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("out");
        let there = |name: &&str| path.join(name).exists();
        for (i, missing) in NAMES.into_iter().enumerate() {
            let out = OutputFolder::open(&path).unwrap();
            let made = |without: Option<&str>| {
                let new = out.begin().unwrap();
                let names = NAMES.iter().filter(|name| Some(**name) != without);
                names.for_each(|name| fs::write(new.file(name), name).unwrap());
                out.put(&new, &NAMES)
            };
            made(None).unwrap();
            assert!(NAMES.iter().all(there) && !out.file(REPLACING).exists());
            assert!(made(Some(missing)).is_err());
            assert_eq!(NAMES.into_iter().filter(there).collect::<Vec<_>>(), NAMES[..i]);
            drop(out);
            fs::write(path.join("notes.txt"), "mine").unwrap();
            drop(OutputFolder::open(&path).unwrap());
            let left: Vec<_> =
                fs::read_dir(&path).unwrap().map(|e| e.unwrap().file_name()).collect();
            assert_eq!(left, ["notes.txt"], "{missing}");
        }
    }
}
