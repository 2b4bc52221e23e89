//! Why a loop cannot be closed.

use thiserror::Error;

use crate::criticism::CriticismError;
use crate::manifold::ManifoldError;
use crate::model::ModelError;
use crate::report::ReportError;
use crate::run::RunError;
use crate::table::{DataError, ProbeError};

/// Fewer sites than this cannot be criticised.
pub(super) const LEAST_SITES: usize = 10;
/// Fewer searches on simulated data than this cannot show a share of at most 5 %.
pub(super) const LEAST_NULLS: usize = 19;

/// Why a loop cannot be closed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LoopError {
    /// Too few searches on simulated data to claim anything.
    #[error(
        "--nulls {nulls}: a claim must beat 95 % of the searches on simulated data, which fewer than {LEAST_NULLS} cannot show\nhelp: leave it out (99), or give at least {LEAST_NULLS}"
    )]
    TooFewNulls {
        /// How many were asked for.
        nulls: usize,
    },
    /// A model without measurements.
    #[error(
        "the model {model} observes nothing, so that there are no residuals to explain\nhelp: add an `observe` statement"
    )]
    NothingObserved {
        /// The model.
        model: &'static str,
    },
    /// Too few sites.
    #[error(
        "{file}: {n} sites; at least {LEAST_SITES} are needed to tell an effect from chance\nhelp: measure at more sites; rows of one site share what the column `site`, or else `vertex`, holds"
    )]
    TooFewSites {
        /// The table.
        file: String,
        /// How many there are.
        n: usize,
    },
    /// A site is both held out and trained on.
    #[error(
        "{file}, line {line}: {column} {site} is also in {train}: it would be predicted from itself\nhelp: hold out whole sites"
    )]
    NotApart {
        /// The held-out table.
        file: String,
        /// Where the site stands in it.
        line: u64,
        /// The column that names sites.
        column: &'static str,
        /// The site.
        site: String,
        /// The table that is trained on.
        train: String,
    },
    /// The effect that was found cannot be written into the model's text.
    #[error("{name}.rs with what was found: {mistake}")]
    ModelText {
        /// Name of the file, without its ending.
        name: String,
        /// What is wrong with the text, or with the effect as a statement.
        mistake: String,
    },
    /// No thread can be started.
    #[error("cannot start threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// It was stopped on request.
    #[error("interrupted")]
    Stopped,
    /// The search.
    #[error(transparent)]
    Criticism(CriticismError),
    /// One of the fits failed, or a file cannot be written.
    #[error(transparent)]
    Run(Box<RunError>),
    /// The held-out table.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The modes at its rows.
    #[error(transparent)]
    Probe(#[from] ProbeError),
    /// The model does not fit a table.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Further eigenfunctions of the surface.
    #[error(transparent)]
    Manifold(#[from] ManifoldError),
    /// The page.
    #[error(transparent)]
    Report(#[from] ReportError),
}

impl From<CriticismError> for LoopError {
    fn from(error: CriticismError) -> Self {
        match error {
            CriticismError::Cancelled => Self::Stopped,
            other => Self::Criticism(other),
        }
    }
}

impl From<RunError> for LoopError {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Stopped => Self::Stopped,
            other => Self::Run(Box::new(other)),
        }
    }
}
