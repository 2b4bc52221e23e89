//! Operators over the whole surface: numbers of rows that depend on expressions at every vertex.

mod eikonal;
mod gradient;
mod path;

pub(super) use eikonal::Arrival;
pub(super) use gradient::Slope;
pub(super) use path::Along;

use crate::manifold::Front;

/// An operator: how its numbers follow from its operands, and how changes and adjoints do.
///
/// Operands are expressions of the model at the vertices of a triangulation, each (`n_vertices`).
pub(super) trait Operator: std::fmt::Debug + Send + Sync {
    /// Its numbers (one per row) for these operands; NaN refuses the draw.
    fn forward(&self, operands: &[&[f64]], kept: &mut Kept, out: &mut [f64]);

    /// The change of its numbers for a change of the operands, about the last forward pass with the same operands.
    fn push(&self, operands: &[&[f64]], kept: &Kept, changes: &[&[f64]], out: &mut [f64]);

    /// Adds the adjoints of the operands to `into`, for those of its numbers.
    fn pull(&self, operands: &[&[f64]], kept: &Kept, bars: &[f64], into: &mut [&mut [f64]]);

    /// The whole maps that a forward pass has made, each (`n_vertices`), or empty where it could not.
    fn maps(&self, _: &Kept) -> Vec<Vec<f64>> {
        vec![]
    }
}

/// What a forward pass leaves for the passes that follow it.
#[derive(Clone, Debug, Default)]
pub(super) struct Kept {
    /// Of each activation.
    fronts: Vec<Front>,
}
