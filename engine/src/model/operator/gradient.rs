//! How steep a quantity is: `gradient(EXPR)`.

use super::{Adjoints, Memo, Operands, Operator};
use crate::manifold::Gradient;

/// The length of the gradient of its one operand at each row.
#[derive(Debug)]
pub(in crate::model) struct Slope {
    pub(in crate::model) gradient: Gradient,
    /// The vertex of each row.
    pub(in crate::model) rows: Vec<u32>,
}

impl Operator for Slope {
    fn forward(&self, of: &Operands<'_>, _: &mut Memo, out: &mut [f64]) {
        for (out, vertex) in out.iter_mut().zip(&self.rows) {
            *out = self.gradient.length(*vertex as usize, of.everywhere[0]);
        }
    }

    /// Exact but for the curvature of the length of a vector, which is left out.
    fn push(&self, of: &Operands<'_>, _: &Memo, changes: &Operands<'_>, out: &mut [f64]) {
        for (out, vertex) in out.iter_mut().zip(&self.rows) {
            *out = self.gradient.push(*vertex as usize, of.everywhere[0], changes.everywhere[0]);
        }
    }

    fn pull(&self, of: &Operands<'_>, _: &Memo, bars: &[f64], into: &mut Adjoints<'_>) {
        for (bar, vertex) in bars.iter().zip(&self.rows) {
            self.gradient.pull(*vertex as usize, of.everywhere[0], *bar, into.everywhere[0]);
        }
    }
}
