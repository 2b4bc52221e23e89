//! Integrals along paths: `path(EXPR; row.source)`.

use super::{Adjoints, Memo, Operands, Operator};

/// The integral of its one operand along the geodesic from each row's source to the row.
#[derive(Debug)]
pub(in crate::model) struct Along {
    /// Of each row: vertices, and what the operand there adds, mm.
    pub(in crate::model) weights: Vec<Vec<(u32, f64)>>,
}

impl Along {
    fn integrals(&self, of: &[f64], out: &mut [f64]) {
        for (out, weights) in out.iter_mut().zip(&self.weights) {
            *out = weights.iter().map(|(vertex, weight)| weight * of[*vertex as usize]).sum();
        }
    }
}

impl Operator for Along {
    fn forward(&self, of: &Operands<'_>, _: &mut Memo, out: &mut [f64]) {
        self.integrals(of.everywhere[0], out);
    }

    fn push(&self, _: &Operands<'_>, _: &Memo, changes: &Operands<'_>, out: &mut [f64]) {
        self.integrals(changes.everywhere[0], out);
    }

    fn pull(&self, _: &Operands<'_>, _: &Memo, bars: &[f64], into: &mut Adjoints<'_>) {
        for (bar, weights) in bars.iter().zip(&self.weights) {
            for (vertex, weight) in weights {
                into.everywhere[0][*vertex as usize] += bar * weight;
            }
        }
    }
}
