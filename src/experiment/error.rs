//! Why there can be no experiment.

use thiserror::Error;

use crate::manifold::ManifoldError;
use crate::model::ModelError;
use crate::table::DataError;

/// Why there can be no experiment.
#[derive(Debug, Error)]
pub enum ExperimentError {
    /// A field whose range is not declared.
    #[error(
        "no synthetic experiment: field {field} declares no range\nhelp: give measurements (--data FILE.csv), or a range in the model file: `field {field}(x) [unit] in 1.0..30.0 = …`"
    )]
    NoRange {
        /// The field.
        field: String,
    },
    /// A model without fields, or one that reads columns.
    #[error("no synthetic experiment: {why}\nhelp: give measurements (--data FILE.csv)")]
    NotSynthetic {
        /// What it needs.
        why: String,
    },
    /// No vertex is physical.
    #[error(
        "no synthetic experiment: no vertex of the ground truth is physical\nhelp: widen the ranges of the derived quantities in the model file"
    )]
    NothingPhysical,
    /// Sites cannot be placed.
    #[error(transparent)]
    Sites(#[from] ManifoldError),
    /// The model does not fit.
    #[error(transparent)]
    Model(Box<ModelError>),
    /// The table cannot be made.
    #[error(transparent)]
    Data(#[from] DataError),
}

impl From<ModelError> for ExperimentError {
    fn from(error: ModelError) -> Self {
        Self::Model(Box::new(error))
    }
}
