//! Rows of a place, told by weighted values there.

use rand::Rng;

use super::particles::{pick, sums};
use crate::num::vector::{axpy, exp_of_less};

/// A row at one point of the outer unknowns.
#[derive(Clone, Debug)]
pub struct RowWithout {
    /// ln of the density that is predicted of it from the other rows.
    pub ln_density: f64,
    /// ln of the weight that makes points those of the posterior without the row, but for a constant.
    pub ln_weight: f64,
    /// Values of the blocks at its place, drawn given the other rows.
    pub theta: Vec<f64>,
}

/// Values of a place `(n, n_blocks)`, and ln of their weights by all rows at other places.
pub(super) struct Values {
    pub(super) theta: Vec<f64>,
    pub(super) ln_weights: Vec<f64>,
}

impl Values {
    /// The rows, by ln of the likelihood of each, `(row, n)`. The weight of a row is the mean weight of the values by all
    /// other rows.
    pub(super) fn rows(&self, lns: &[Vec<f64>], rng: &mut impl Rng) -> Vec<RowWithout> {
        let n = self.ln_weights.len();
        let n_blocks = self.theta.len() / n;
        let mut weights = vec![];
        let row = |own: usize| {
            let mut ln = self.ln_weights.clone();
            let others = lns.iter().enumerate().filter(|(other, _)| *other != own);
            others.for_each(|(_, lns)| axpy(1.0, lns, &mut ln));
            let most_without = exp_of_less(&ln, &mut weights);
            let sums = sums(&weights);
            let without = sums[n - 1];
            let chosen = pick(&sums, rng);
            axpy(1.0, &lns[own], &mut ln);
            let most_with = exp_of_less(&ln, &mut weights);
            let with: f64 = weights.iter().sum();
            RowWithout {
                ln_density: most_with - most_without + (with / without).ln(),
                ln_weight: most_without + (without / n as f64).ln(),
                theta: self.theta[chosen * n_blocks..][..n_blocks].to_vec(),
            }
        };
        (0..lns.len()).map(row).collect()
    }
}
