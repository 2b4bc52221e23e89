//! Operators over the whole surface: numbers of rows that depend on expressions at every vertex.

mod eikonal;
mod gradient;
mod path;

pub(super) use eikonal::{Arrival, Source};
pub(super) use gradient::Slope;
pub(super) use path::Along;

use crate::manifold::Front;

/// What an operator depends on, or the change of it.
#[derive(Debug)]
pub(super) struct Operands<'a> {
    /// Expressions of the model at the vertices of a triangulation, each (`n_vertices`).
    pub(super) everywhere: Vec<&'a [f64]>,
    /// Single numbers.
    pub(super) numbers: Vec<f64>,
}

/// The adjoints of what an operator depends on.
#[derive(Debug)]
pub(super) struct Bars<'a> {
    /// Of the expressions, each (`n_vertices`).
    pub(super) everywhere: Vec<&'a mut [f64]>,
    /// Of the single numbers.
    pub(super) numbers: Vec<f64>,
}

/// An operator: how its numbers follow from its operands, and how changes and adjoints do.
pub(super) trait Operator: std::fmt::Debug + Send + Sync {
    /// Its numbers (one per row) for these operands; NaN refuses the draw.
    fn forward(&self, of: &Operands<'_>, kept: &mut Kept, out: &mut [f64]);

    /// The change of its numbers for a change of the operands, about the last forward pass with the same operands.
    fn push(&self, of: &Operands<'_>, kept: &Kept, changes: &Operands<'_>, out: &mut [f64]);

    /// Adds the adjoints of the operands to `into`, for those of its numbers.
    fn pull(&self, of: &Operands<'_>, kept: &Kept, bars: &[f64], into: &mut Bars<'_>);

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
