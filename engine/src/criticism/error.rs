//! Why a model cannot be criticised.

use thiserror::Error;

use crate::model::ModelError;

/// Why a model cannot be criticised.
#[derive(Debug, Error)]
pub enum CriticismError {
    /// The model does not fit its data.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// An `observe` that depends on parameters alone, so that there is nothing an effect could act
    /// on.
    #[error(
        "observe {observe}: its likelihood mentions no field and no `let`, so that there is nothing an effect could act on\nhelp: name what is predicted, `let mean(row) = …;`, and mention `mean(row)` in the likelihood"
    )]
    NoObservable {
        /// The statement.
        observe: String,
    },
    /// An operator over the whole surface, in whose fields measurements need not be linear.
    #[error(
        "let {name}: what is missing from a model that measures `eikonal`, `path` or `gradient` cannot be searched for: the search needs measurements that depend on fields at their own place alone\nhelp: search with `models/lat.rs`, whose activation runs along straight paths, and compare the models with `eplat compare`"
    )]
    Everywhere {
        /// The `let`.
        name: String,
    },
    /// No mode.
    #[error(
        "the base model has no Laplace fit: its log density has no maximum near its start\nhelp: check it with `eplat run --optimize` first"
    )]
    NoFit,
    /// The caller said to stop.
    #[error("stopped")]
    Cancelled,
}
