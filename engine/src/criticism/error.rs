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
    /// Arrival times over the whole surface, in which measurements are not linear.
    #[error(
        "let {name}: what is missing from a model of `eikonal` cannot be searched for: the search needs measurements that are linear in the fields\nhelp: search with `models/lat.rs`, whose activation runs along straight paths, and compare the models with `eplat compare`"
    )]
    Arrivals {
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
