//! Why a study cannot be imported.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::mesh::{MeshError, Place};
use crate::store::advice;
use crate::table::DataError;

/// Why a study cannot be imported.
#[derive(Debug, Error)]
pub enum ImportError {
    /// A file or folder cannot be read.
    #[error("cannot read {file}: {reason}\nhelp: {help}")]
    Read {
        /// The file.
        file: String,
        /// Why.
        reason: String,
        /// What to do.
        help: &'static str,
    },
    /// Nothing in it is known.
    #[error("{}: no study that eplat knows\n  found: {found}\nhelp: {help}", path.display())]
    Unknown {
        /// What was given.
        path: PathBuf,
        /// What is there.
        found: String,
        /// What to do.
        help: String,
    },
    /// A file is not what its format allows.
    #[error("{file}, {place}: expected {expected}, got {got}\nhelp: {help}")]
    Parse {
        /// The file.
        file: String,
        /// Where in it.
        place: Place,
        /// What the format asks for there.
        expected: String,
        /// What stands there.
        got: String,
        /// What to do.
        help: &'static str,
    },
    /// A file of a known format whose contents cannot be used.
    #[error("{file}: {what}\nhelp: {help}")]
    Unusable {
        /// The file.
        file: String,
        /// What is wrong with it.
        what: String,
        /// What to do.
        help: String,
    },
    /// There is more than one map to choose from, or none of the name given.
    #[error("{what}\n{}\nhelp: name one with --map NAME", maps.join("\n"))]
    Map {
        /// What is wrong with the choice.
        what: String,
        /// A line for each map.
        maps: Vec<String>,
    },
    /// A map's surface is not valid and cannot be mended.
    #[error("map {map}: {source}")]
    Surface {
        /// The map.
        map: String,
        /// What is wrong.
        source: MeshError,
    },
    /// A mesh file.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A table.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The output folder is there.
    #[error(
        "{} is already there\nhelp: name another folder with --out, or replace an earlier import with --force", path.display()
    )]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// The folder of an earlier import has something else in it, too.
    #[error(
        "{} is of no import, and would go with the folder\nhelp: move it away, or name another folder with --out", path.display()
    )]
    Foreign {
        /// What lies there.
        path: PathBuf,
    },
    /// The output folder cannot be written.
    #[error("cannot write {}: {source}\nhelp: {}", path.display(), advice(source))]
    Write {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

impl ImportError {
    /// A line that is not as its format asks.
    pub(super) fn line(file: &str, line: usize, expected: impl Into<String>, got: &str) -> Self {
        Self::Parse {
            file: file.into(),
            place: Place::Line(line),
            expected: expected.into(),
            got: format!("`{}`", shortened(got)),
            help: "the file is damaged or of another version; export it again",
        }
    }
}

/// At most 60 characters of a text.
pub(super) fn shortened(text: &str) -> String {
    let text = text.trim();
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.into(),
    }
}
