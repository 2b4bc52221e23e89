//! Linear predictors and effects: `Z β` per row.

use super::tape::{Op, Tape};
use crate::num::vector::{axpy, dot};

/// `out += Z β` (an effect on offsets) or `out = Z β` (a linear predictor).
#[derive(Debug)]
pub(super) struct Linear {
    /// First coefficient in `v`.
    pub(super) beta: usize,
    /// Number of coefficients.
    pub(super) n: usize,
    /// Design, row-major (rows, n).
    pub(super) z: Vec<f64>,
    /// First value of each block of `rows` values that it goes to.
    pub(super) out: Vec<usize>,
    pub(super) rows: usize,
    pub(super) add: bool,
}

impl Op for Linear {
    fn forward(&self, t: &mut Tape) {
        for i in 0..self.rows {
            let y = dot::<8>(&t.v[self.beta..][..self.n], &self.z[i * self.n..][..self.n]);
            for out in &self.out {
                t.v[out + i] = if self.add { t.v[out + i] + y } else { y };
            }
        }
    }

    fn backward(&self, t: &mut Tape) {
        for i in 0..self.rows {
            let bar: f64 = self.out.iter().map(|out| t.g[out + i]).sum();
            axpy(bar, &self.z[i * self.n..][..self.n], &mut t.g[self.beta..][..self.n]);
        }
    }
}
