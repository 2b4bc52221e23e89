//! A model as equations: what `eplat show` prints and the report's first page holds.

use super::model::Model;

/// The model as equations, with parameters, units and supports.
pub fn equations(model: &Model) -> String {
    model.source.clone()
}
