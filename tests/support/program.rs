//! Runs the built program in a folder of its own, and finds the reference data.
#![allow(dead_code, clippy::unwrap_used, reason = "tests; each uses a part of it")]

#[path = "skipped.rs"]
pub(crate) mod skipped;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

/// A temporary folder that commands run in; paths in their messages stay relative.
pub(crate) struct Workplace(TempDir);

impl Workplace {
    pub(crate) fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file.
    pub(crate) fn file(&self, name: &str, bytes: impl AsRef<[u8]>) -> &Self {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
        self
    }

    /// Puts the model file that ships into the folder, as `erp.rs`.
    pub(crate) fn with_erp(self) -> Self {
        self.file("erp.rs", include_str!("../../models/erp.rs"));
        self
    }

    pub(crate) fn read(&self, name: &str) -> String {
        let path = self.path(name);
        std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    }

    /// Names of everything in the folder, sorted.
    pub(crate) fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<String> =
            entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// `eplat ARGUMENTS` in the folder, split at blanks.
    pub(crate) fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_eplat"));
        let cache = concat!(env!("CARGO_TARGET_TMPDIR"), "/cache");
        command
            .args(arguments.split_whitespace())
            .current_dir(self.0.path())
            .env("EPLAT_CACHE", cache);
        command
    }

    pub(crate) fn eplat(&self, arguments: &str) -> Output {
        self.command(arguments).output().unwrap()
    }
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// A Python on which `test` runs without an error: `$EPLAT_PYTHON`, or a usual one. None is said, as that `what` was not
/// found.
pub(crate) fn python(test: &str, what: &str) -> Option<PathBuf> {
    let named = std::env::var_os("EPLAT_PYTHON").map(PathBuf::from);
    let usual = ["python3.13", "python3.12", "python3"].map(PathBuf::from);
    let fits = |python: &PathBuf| {
        Command::new(python).args(["-c", test]).output().is_ok_and(|output| output.status.success())
    };
    let found = named.into_iter().chain(usual).find(fits);
    if found.is_none() {
        skipped::skipped(&format!("no Python with {what} found (EPLAT_PYTHON)"));
    }
    found
}

/// A file of the reference data: `$EPLAT_SHARED`, or `../shared` beside the checkout.
pub(crate) fn shared(file: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let folder = std::env::var_os("EPLAT_SHARED").map_or_else(beside, PathBuf::from);
    let path = folder.join("data").join(file);
    if path.exists() {
        return Some(path);
    }
    skipped::skipped(&format!("reference data not found ({file})"));
    None
}
