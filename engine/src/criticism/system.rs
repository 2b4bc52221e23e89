//! The linear system of a Laplace fit: how scalars depend on what is integrated over, and the
//! Hessian in that.
//!
//! A random effect of a site touches only the rows of that site, so these effects are eliminated
//! one by one.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::engine::{Engine, RowAt};

/// The scalars of all rows as a linear map, and the curvature of the prior.
#[derive(Clone, Debug)]
pub(super) struct Linear {
    pub(super) constant: Vec<f64>,
    /// J transposed, (unknowns, scalars): the row of J of a scalar is a column here.
    pub(super) j: DMatrix<f64>,
    /// Scalars that any unknown moves, ascending.
    pub(super) used: Vec<usize>,
    /// Minus the Hessian of the prior in the model's linear unknowns.
    pub(super) prior: DMatrix<f64>,
}

impl Linear {
    /// Number of unknowns.
    pub(super) fn n(&self) -> usize {
        self.j.nrows()
    }

    /// The scalars of a row that depend on what is integrated over. A noise, for instance, does
    /// not.
    pub(super) fn moved(&self, row: &RowAt) -> Vec<usize> {
        let is_moved = |l: usize| self.row(row.first + l).iter().any(|j| *j != 0.0);
        (0..row.n).filter(|l| *l == row.observable || is_moved(*l)).collect()
    }

    /// How a scalar depends on the unknowns.
    pub(super) fn row(&self, local: usize) -> &[f64] {
        &self.j.as_slice()[local * self.n()..][..self.n()]
    }
}

/// Minus the Hessian, after the sites' effects were eliminated.
#[derive(Clone, Debug)]
pub(super) struct System {
    pub(super) factor: Cholesky<f64, Dyn>,
    /// Precision of each site's effect, and its coupling to x.
    pub(super) precision: Vec<f64>,
    pub(super) coupling: Vec<DVector<f64>>,
}

impl System {
    /// The system, from the Hessian of each row's log likelihood in its scalars, `(n, n)`.
    pub(super) fn new<'h>(
        engine: &Engine,
        linear: &Linear,
        tau: f64,
        hessians: impl Iterator<Item = &'h [f64]>,
    ) -> Option<Self> {
        let n = linear.n();
        let mut precision = vec![1.0; engine.sites.len()];
        let mut coupling = vec![DVector::zeros(n); engine.sites.len()];
        // K J: minus each row's Hessian times its rows of J
        let j = linear.j.select_columns(&linear.used);
        let mut kj = DMatrix::zeros(n, j.ncols());
        let mut first = 0;
        for (row, own) in engine.rows.iter().zip(hessians) {
            let is_own = |l: &&usize| **l < row.first + row.n;
            let end = first + linear.used[first..].iter().take_while(is_own).count();
            let hessian = |l: usize, b: usize| own[l * row.n + linear.used[b] - row.first];
            for a in first..end {
                let mut own = kj.column_mut(a);
                for b in first..end {
                    own.axpy(-hessian(linear.used[a] - row.first, b), &j.column(b), 1.0);
                }
            }
            let l = row.observable;
            precision[row.site] -= tau * tau * own[l * row.n + l];
            for b in first..end {
                coupling[row.site].axpy(-tau * hessian(l, b), &j.column(b), 1.0);
            }
            first = end;
        }
        let mut s = &j * kj.transpose();
        let n_prior = linear.prior.nrows();
        let mut own = s.view_mut((0, 0), (n_prior, n_prior));
        own += &linear.prior;
        for k in n_prior..n {
            s[(k, k)] += 1.0;
        }
        for (b, d) in coupling.iter().zip(&precision) {
            s.ger(-1.0 / d, b, b, 1.0);
        }
        let factor = Cholesky::new(s)?;
        Some(Self { factor, precision, coupling })
    }

    /// Solves for the unknowns and the sites' effects.
    pub(super) fn solve(
        &self,
        mut right: DVector<f64>,
        of_sites: &[f64],
    ) -> (DVector<f64>, Vec<f64>) {
        for ((b, d), g) in self.coupling.iter().zip(&self.precision).zip(of_sites) {
            right.axpy(-g / d, b, 1.0);
        }
        let x = self.factor.solve(&right);
        let sites = self.coupling.iter().zip(&self.precision).zip(of_sites);
        let sites = sites.map(|((b, d), g)| (g - b.dot(&x)) / d).collect();
        (x, sites)
    }
}
