//! A Laplace fit, and what it says of rows that it had not seen.

use nalgebra::{DMatrix, DVector};

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::engine::{Engine, Outer, TriedTerm};
use super::system::{Linear, System};
use crate::model::{Curvature, Noise};

/// A Laplace fit.
#[derive(Clone, Debug)]
pub struct LaplaceFit {
    /// The outer values at which it was made.
    pub outer: Outer,
    /// The terms in it.
    pub active: Vec<usize>,
    /// The mode: of the linear unknowns, then of the coefficients of the terms.
    pub x: DVector<f64>,
    /// The mode of the sites' random effects, in units of their sd.
    pub z: Vec<f64>,
    /// Log evidence, up to a constant that depends on the data alone.
    pub ln_evidence: f64,
    /// Scalars of all rows at the mode.
    pub locals: Vec<f64>,
    /// The further errors of each row, beyond its likelihood.
    pub noise: Vec<Noise>,
    pub(super) linear: Linear,
    /// Minus the Hessian at the mode.
    pub(super) system: System,
    pub(super) curvatures: Vec<Curvature>,
}

/// Mean and covariance of the scalars of a site's rows, given everything but these rows.
#[derive(Clone, Debug)]
pub struct Cavity {
    /// The rows.
    pub rows: Vec<usize>,
    /// Mean of their scalars, one row after the other.
    pub mean: DVector<f64>,
    /// Covariance.
    pub covariance: DMatrix<f64>,
}

impl LaplaceFit {
    /// Mean and covariance of the coefficients of all active terms, in the order of `active`. A
    /// priori these are standard normal. A term's effect is its sd times its design times its
    /// coefficients.
    pub fn coefficients(&self, engine: &Engine) -> (DVector<f64>, DMatrix<f64>) {
        let (first, n) = (engine.split.linear.len(), self.x.len());
        let mut unit = DMatrix::zeros(n, n - first);
        for k in first..n {
            unit[(k, k - first)] = 1.0;
        }
        let covariance = self.system.factor.solve(&unit).rows(first, n - first).into_owned();
        (self.x.rows(first, n - first).into_owned(), covariance)
    }

    /// The random effect of units, which comes first among the terms, if there is one.
    pub(super) fn unit_term<'e>(&self, engine: &'e Engine) -> Option<&'e TriedTerm> {
        self.active.first().map(|a| &*engine.terms[*a]).filter(|term| term.sd.is_none())
    }

    /// The further errors of a row.
    pub(super) fn error(&self, row: usize, rng: &mut dyn Rng) -> f64 {
        let noise = self.noise[row];
        let mut variance = noise.variance;
        if let Some((share, wide)) = noise.outliers
            && rng.random::<f64>() < share
        {
            variance += wide;
        }
        variance.sqrt() * rng.sample::<f64, _>(StandardNormal)
    }

    /// How a scalar depends on the linear unknowns and the terms' coefficients.
    pub(super) fn design_row(&self, local: usize) -> &[f64] {
        self.linear.row(local)
    }

    /// The cavity of these rows, all of one site: their scalars, given everything but these rows.
    pub fn cavity(&self, engine: &Engine, rows: &[usize]) -> Option<Cavity> {
        let site = engine.rows[*rows.first()?].site;
        let tau = self.outer.ln_site.exp();
        let total: usize = rows.iter().map(|r| engine.rows[*r].n).sum();
        let n = self.x.len();
        let mut g = DMatrix::zeros(total, n);
        let mut a = DVector::zeros(total);
        let mut k = DMatrix::zeros(total, total);
        let (mut mean, mut slope) = (DVector::zeros(total), DVector::zeros(total));
        let mut at = 0;
        for r in rows {
            let row = &engine.rows[*r];
            let c = &self.curvatures[*r];
            for l in 0..row.n {
                for (to, j) in g.row_mut(at + l).iter_mut().zip(self.linear.row(row.first + l)) {
                    *to = *j;
                }
                mean[at + l] = self.locals[row.first + l];
                slope[at + l] = c.gradient[l];
                for m in 0..row.n {
                    k[(at + l, at + m)] = -c.hessian[l * row.n + m];
                }
            }
            a[at + row.observable] = 1.0;
            at += row.n;
        }
        let (d, b) = (self.system.precision[site], &self.system.coupling[site]);
        g.ger(-tau / d, &a, b, 1.0);
        let mut v = &g * self.system.factor.solve(&g.transpose());
        v.ger(tau * tau / d, &a, &a, 1.0);
        let covariance = (DMatrix::identity(total, total) - &v * k).lu().solve(&v)?;
        let covariance = 0.5 * (&covariance + covariance.transpose());
        let mean = mean - &covariance * slope;
        Some(Cavity { rows: rows.to_vec(), mean, covariance })
    }
}
