//! Integrals along paths: `path(EXPR; row.source)`.

use super::{Kept, Operator};

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
    fn forward(&self, operands: &[&[f64]], _: &mut Kept, out: &mut [f64]) {
        self.integrals(operands[0], out);
    }

    fn push(&self, _: &[&[f64]], _: &Kept, changes: &[&[f64]], out: &mut [f64]) {
        self.integrals(changes[0], out);
    }

    fn pull(&self, _: &[&[f64]], _: &Kept, bars: &[f64], into: &mut [&mut [f64]]) {
        for (bar, weights) in bars.iter().zip(&self.weights) {
            for (vertex, weight) in weights {
                into[0][*vertex as usize] += bar * weight;
            }
        }
    }
}
