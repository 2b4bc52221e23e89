//! Why there is no fit, or no file of it.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::compare::CompareError;
use super::warm_start::WarmStartError;
use crate::experiment::ExperimentError;
use crate::infer::{ChainError, InferError};
use crate::manifold::ManifoldError;
use crate::mesh::MeshError;
use crate::model::{ExceedanceError, ModelError};
use crate::report::ReportError;
use crate::store::{CheckpointError, advice};
use crate::table::{DataError, ProbeError};

/// Why there is no fit, or no file of it.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RunError {
    /// A model without a field observes something, and there is no table.
    #[error(
        "the model {model} observes {observe}: measurements are needed\nhelp: give them with --data FILE.csv"
    )]
    NoMeasurements {
        /// The model.
        model: &'static str,
        /// The first statement that reads measurements.
        observe: &'static str,
    },
    /// The model has no field, and only a model with one makes sense here.
    #[error("the model has no field: where it is measured makes no difference")]
    NoField,
    /// A protocol that the model does not observe.
    #[error("--minutes {name}: the model observes {}", known.join(", "))]
    NoProtocol {
        /// The protocol.
        name: String,
        /// What the model observes.
        known: Vec<String>,
    },
    /// What is to be mapped is no event on the maps of the model.
    #[error("--exceed {0}")]
    Exceedance(#[from] ExceedanceError),
    /// The log density does not exist at the starting point.
    #[error(
        "at the starting point (priors at typical values, fields in the middle of their ranges) {place}\nhelp: look there for an error of a measurement that is not above 0, and for a logarithm, root or quotient that leaves its domain; give the fields a range"
    )]
    NoStart {
        /// The measurement or unknown at which it fails, in words.
        place: String,
    },
    /// A file that cannot be read.
    #[error(
        "cannot read {}: {source}\nhelp: check the path; it is relative to the folder you are in",
        path.display()
    )]
    Read {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// A file that cannot be written.
    #[error("cannot write {}: {source}\nhelp: {}", path.display(), advice(source))]
    Write {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// Draws that went to the disk, and cannot be read back or added to.
    #[error(
        "draws on the disk of the output folder cannot be written or read: {source}\nhelp: {}",
        advice(source)
    )]
    Draws {
        /// The cause.
        source: io::Error,
    },
    /// The output folder cannot be written to.
    #[error(
        "cannot write to the output folder {}: {source}\nhelp: name another with --out DIR",
        folder.display()
    )]
    Unwritable {
        /// The folder.
        folder: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// There is no such folder of a run.
    #[error(
        "no folder {}\nhelp: name the --out folder of a finished run; the default is out/NAME after the model file's name",
        folder.display()
    )]
    NoRun {
        /// The folder.
        folder: PathBuf,
    },
    /// The run in the folder is complete and is not the one that was to go on.
    #[error(
        "the run in {} is complete, and another one: {}\nhelp: leave out --resume to replace it, or name another folder with --out",
        folder.display(),
        differences.join("; ")
    )]
    AnotherRun {
        /// The folder.
        folder: PathBuf,
        /// Name, value there, value here.
        differences: Vec<String>,
    },
    /// The output folder holds results that are not of the model that is run.
    #[error(
        "{} holds {holds}; one of {model} would replace it\nhelp: name another folder with --out, or give --force",
        folder.display()
    )]
    Occupied {
        /// The folder.
        folder: PathBuf,
        /// What it holds, in words.
        holds: String,
        /// The model that is run.
        model: String,
    },
    /// Another process writes to the output folder.
    #[error(
        "{} is in use: {by} writes to it\nhelp: wait until it has ended, or name another folder with --out DIR",
        folder.display()
    )]
    InUse {
        /// The folder.
        folder: PathBuf,
        /// The process, in words.
        by: String,
    },
    /// A file in the output folder that no run left has the name of one that a run leaves.
    #[error(
        "{} is of no run of eplat, and would be replaced\nhelp: name another folder with --out DIR, or move it away; `run` and `loop` replace it with --force",
        path.display()
    )]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// What is asked for needs more memory than there is.
    #[error(
        "{what} take {:.1} GB of memory; {:.1} GB are free\nhelp: {help}",
        *bytes as f64 / 1e9, *free as f64 / 1e9
    )]
    Memory {
        /// What, in words.
        what: String,
        /// Bytes that it takes.
        bytes: u128,
        /// Bytes that are free.
        free: u64,
        /// What to do.
        help: &'static str,
    },
    /// The folder of a finished run does not hold what it takes to go back to it.
    #[error(
        "{} does not hold the {what}\nhelp: {remedy}",
        folder.display()
    )]
    NotKept {
        /// The folder.
        folder: PathBuf,
        /// What is not there.
        what: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// The inputs are not those of the finished run.
    #[error(
        "the run in {} was made from other inputs: {}\nhelp: give them as they were, or repeat the run",
        folder.display(),
        differences.join("; ")
    )]
    OtherInputs {
        /// The folder.
        folder: PathBuf,
        /// Name, value there, value here.
        differences: Vec<String>,
    },
    /// No chain came through.
    #[error("every chain failed; the first:\n{}", failures.first().map_or(String::new(), ToString::to_string))]
    EveryChainFailed {
        /// One for each chain.
        failures: Vec<ChainError>,
    },
    /// The log density has no maximum at the point that was found.
    #[error("{}", with_name(source, unknown))]
    NotConcave {
        /// The unknown that moves most along the worst direction, by its name.
        unknown: String,
        /// The cause, which knows the unknown's number.
        source: InferError,
    },
    /// It was stopped on request.
    #[error("interrupted")]
    Stopped,
    /// The earlier run cannot be started from.
    #[error(transparent)]
    WarmStart(#[from] WarmStartError),
    /// The two runs cannot be compared.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// The surface.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Its eigenfunctions, or sites on it.
    #[error(transparent)]
    Manifold(#[from] ManifoldError),
    /// The table.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The modes at the table's rows.
    #[error(transparent)]
    Probe(#[from] ProbeError),
    /// The model does not fit the data.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// There can be no synthetic experiment, or no further measurement.
    #[error(transparent)]
    Experiment(Box<ExperimentError>),
    /// The sampler's settings or starting points.
    #[error(transparent)]
    Infer(#[from] InferError),
    /// The kept run.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A file of results.
    #[error(transparent)]
    Report(#[from] ReportError),
}

impl From<ExperimentError> for RunError {
    fn from(error: ExperimentError) -> Self {
        Self::Experiment(Box::new(error))
    }
}

impl RunError {
    /// For `map_err` on reading `path`.
    pub(super) fn read(path: &Path) -> impl FnOnce(io::Error) -> Self + use<'_> {
        move |source| Self::Read { path: path.to_owned(), source }
    }

    /// For `map_err` on writing `path`.
    pub(super) fn write(path: &Path) -> impl FnOnce(io::Error) -> Self + use<'_> {
        move |source| Self::Write { path: path.to_owned(), source }
    }

    pub(crate) fn draws(source: io::Error) -> Self {
        Self::Draws { source }
    }

    /// The folder is written to by the process of this number.
    pub(super) fn in_use(folder: &Path, process: Option<u32>) -> Self {
        let by = match process {
            Some(process) => format!("another eplat (process {process})"),
            None => "another eplat".to_owned(),
        };
        Self::InUse { folder: folder.to_owned(), by }
    }

    /// For `map_err` on writing to `folder`.
    pub(super) fn unwritable(folder: &Path) -> impl FnOnce(io::Error) -> Self + use<'_> {
        move |source| Self::Unwritable { folder: folder.to_owned(), source }
    }
}

/// The error with the unknown's name in place of its number.
fn with_name(error: &InferError, name: &str) -> String {
    let text = error.to_string();
    match error {
        InferError::NotConcave { unknown, .. } => text.replace(&format!("unknown {unknown}"), name),
        _ => text,
    }
}
