//! Why a study cannot be done.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::experiment::ExperimentError;
use crate::infer::InferError;
use crate::manifold::ManifoldError;
use crate::mesh::MeshError;
use crate::model::ModelError;
use crate::report::ReportError;
use crate::run::RunError;
use crate::run::atrium::AtriumError;
use crate::store::advice;

/// Why a study cannot be done.
#[derive(Debug, Error)]
pub enum StudyError {
    /// A truth that cannot be made or measured.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// Sites cannot be placed.
    #[error(transparent)]
    Sites(#[from] ManifoldError),
    /// The model does not fit.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A calibration cannot begin.
    #[error(transparent)]
    Infer(#[from] InferError),
    /// A plan that cannot be read, or says nothing that can be done.
    #[error("{}: {why}", path.display())]
    Plan {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        why: String,
    },
    /// Results that are of another plan, not complete or not readable.
    #[error("{}: {why}", path.display())]
    Results {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// A setting of an experiment that is to be a positive number.
    #[error("--{name}: expected a positive number, got {value}")]
    NotPositive {
        /// The setting.
        name: &'static str,
        /// What it is.
        value: f64,
    },
    /// A surface that was to bring the true fields does not.
    #[error(
        "--truth {}: expected point data {field}_true or {field}, found {}\n\
         help: give a surface with a value of {fields} at every vertex",
        file.display(), if found.is_empty() { "none".to_owned() } else { found.join(", ") }
    )]
    NoTruth {
        /// The surface's file.
        file: PathBuf,
        /// The field that is missing.
        field: &'static str,
        /// Point data that there are.
        found: Vec<String>,
        /// All fields that are needed, in words.
        fields: String,
    },
    /// The folder holds another experiment.
    #[error(
        "the experiment in {} is another one: {}\nhelp: name another folder with --out, or remove this one",
        folder.display(), differences.join("; ")
    )]
    AnotherExperiment {
        /// The folder.
        folder: PathBuf,
        /// Name, value there, value here.
        differences: Vec<String>,
    },
    /// A file that cannot be written.
    #[error("cannot write {}: {source}\nhelp: {}", path.display(), advice(source))]
    Write {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// Threads that the system does not give.
    #[error("no threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// A calibration.
    #[error(transparent)]
    Run(Box<RunError>),
    /// A simulation of the atrium.
    #[error(transparent)]
    Atrium(#[from] AtriumError),
    /// A surface that cannot be read, or maps that cannot be written.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Results that cannot be read or drawn.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// A record that cannot be read.
    #[error(transparent)]
    Record(#[from] serde_json::Error),
}

impl From<RunError> for StudyError {
    fn from(error: RunError) -> Self {
        Self::Run(Box::new(error))
    }
}

impl StudyError {
    /// For `map_err` on writing `path`.
    pub(super) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| Self::Write { path, source }
    }
}
