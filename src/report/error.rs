//! What can go wrong when a run is written or read.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::store::advice;

/// What can go wrong when a run is written or read.
#[derive(Debug, Error)]
pub enum ReportError {
    /// The file or folder cannot be written.
    #[error(
        "cannot write {}: {source}\nhelp: {}",
        path.display(),
        advice(source)
    )]
    Write {
        /// What was to be written.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The file cannot be read.
    #[error("cannot read {}: {source}\nhelp: name the --out folder of a finished run", path.display())]
    Read {
        /// What was to be read.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The file is there but is not what this version of eplat writes.
    #[error("{}: {reason}\nhelp: the file was edited or comes from another version; repeat the run", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What the parser found, with line and column.
        reason: String,
    },
    /// A file in a run's folder is not the one that the run left.
    #[error(
        "{} is not the file that this run left: its SHA-256 is not the one in {}\nhelp: put the run's own file back, or repeat the run",
        path.display(), record.display()
    )]
    NotOfRun {
        /// The file.
        path: PathBuf,
        /// The record that names it.
        record: PathBuf,
    },
    /// The place for a Zarr folder holds something that eplat did not write.
    #[error("{} exists and is not a Zarr folder\nhelp: move it away or choose another --out folder", path.display())]
    Occupied {
        /// The place.
        path: PathBuf,
    },
    /// A variable holds another number of values than its dimensions say.
    #[error(
        "variable {variable}: its dimensions {dims:?} need {expected} values, got {got}\n\
         help: give one value per cell, row-major"
    )]
    Shape {
        /// The variable.
        variable: String,
        /// Its dimensions, outermost first.
        dims: Vec<(String, usize)>,
        /// Product of the lengths.
        expected: usize,
        /// Values given.
        got: usize,
    },
    /// A dimension has two lengths within one group,.
    #[error(
        "group {group}: dimension {dim} has length {expected} but also {got}\n\
         help: give the two different names"
    )]
    Dimension {
        /// The group.
        group: String,
        /// The dimension.
        dim: String,
        /// Length seen first.
        expected: usize,
        /// Length seen later, or number of labels.
        got: usize,
    },
    /// A name that cannot be one folder of its own.
    #[error(
        "group {group}: the name {name:?} is empty, hidden, not one folder, or used twice\n\
         help: names are unique within a group, without / and without a leading dot or underscores"
    )]
    Name {
        /// The group.
        group: String,
        /// The name.
        name: String,
    },
    /// A variable that is no table of draws was to be written to `draws.csv`.
    #[error(
        "variable {variable} has dimensions {dims:?}\nhelp: draws need the dimensions chain and draw first, \
         of the same lengths for every variable"
    )]
    NotDraws {
        /// The variable.
        variable: String,
        /// Its dimensions, outermost first.
        dims: Vec<(String, usize)>,
    },
    /// A drawing has what this program cannot turn into pixels.
    #[error(
        "picture {picture}: {what} cannot be painted\nhelp: this is a mistake of eplat; please report it"
    )]
    Drawing {
        /// Name of the picture.
        picture: String,
        /// What of it.
        what: String,
    },
    /// Point data whose length is not the number of vertices.
    #[error(
        "point data {name}: expected {expected} values, got {got}\nhelp: give one value per vertex"
    )]
    PointData {
        /// The array.
        name: String,
        /// Number of vertices.
        expected: usize,
        /// Values given.
        got: usize,
    },
}

impl ReportError {
    /// For `map_err` on writing `path`.
    pub(super) fn write(path: &Path) -> impl FnOnce(io::Error) -> Self + use<'_> {
        move |source| Self::Write { path: path.to_owned(), source }
    }

    /// For `map_err` on reading `path`.
    pub(super) fn read(path: &Path) -> impl FnOnce(io::Error) -> Self + use<'_> {
        move |source| Self::Read { path: path.to_owned(), source }
    }
}
