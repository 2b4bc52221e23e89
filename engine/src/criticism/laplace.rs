//! The Laplace approximation of a model with what criticism adds to it.
//!
//! ```text
//! p(y | τ, σ, other) ≈ p(y, x̂, ẑ, β̂) (2π)^(d/2) det(−∇²)^(−½)
//! ```
//! σ is the sd of a further normal error of every row ([`Noise`](crate::model::Noise)). A random
//! effect of a site touches only the rows of that site. So these effects are eliminated one by one,
//! and the matrix that is factored has the size of (x, β).

use nalgebra::{DMatrix, DVector};

use super::engine::{Engine, Outer, TriedTerm};
use super::fit::LaplaceFit;
use super::newton::{Newton, Point};
use super::system::{Linear, System};
use crate::model::{RowId, Tape};

impl Engine {
    /// The scalars as a linear map at these other unknowns, terms included. The model's part is
    /// taken from `last` if that was made at the same unknowns.
    fn linear(
        &self,
        t: &mut Tape,
        outer: &Outer,
        active: &[usize],
        x: &DVector<f64>,
        last: Option<&LaplaceFit>,
    ) -> Linear {
        let other = &outer.other;
        let own = last.filter(|fit| fit.outer.other == *other).map(|fit| &fit.linear);
        let (n_linear, n) = (self.split.linear.len(), x.len());
        let mut j = DMatrix::zeros(n, self.n_locals);
        let mut of_model = j.rows_mut(0, n_linear);
        let constant = if let Some(own) = own {
            of_model.copy_from(&own.j.rows(0, n_linear));
            own.constant.clone()
        } else {
            let ids: Vec<RowId> = self.rows.iter().map(|r| r.id).collect();
            let mut u = self.unknowns(other, &DVector::zeros(n));
            let (mut constant, mut moved) = (vec![], vec![]);
            self.model.locals_at(t, &u, &ids, &mut constant);
            for (k, at) in self.split.linear.iter().enumerate() {
                u[*at] = 1.0;
                self.model.locals_at(t, &u, &ids, &mut moved);
                u[*at] = 0.0;
                for (l, (m, c)) in moved.iter().zip(&constant).enumerate() {
                    of_model[(k, l)] = m - c;
                }
            }
            constant
        };
        let mut first = n_linear;
        for a in active {
            self.add_term(&self.terms[*a], outer, first, &mut j);
            first += self.terms[*a].n;
        }
        let is_used = |l: &usize| j.column(*l).iter().any(|j| *j != 0.0);
        let used = (0..self.n_locals).filter(is_used).collect();
        Linear { constant, used, j, prior: self.prior_curvature(other, x) }
    }

    /// Writes how scalars depend on a term's coefficients, the first of which is unknown number `first`.
    fn add_term(&self, term: &TriedTerm, outer: &Outer, first: usize, j: &mut DMatrix<f64>) {
        let sd = term.sd.or(outer.ln_unit.map(f64::exp)).unwrap_or_default();
        for (r, row) in self.rows.iter().enumerate() {
            let z = self.design(term, r);
            for local in term.on.iter().filter_map(|on| self.model.local_of(row.id, on)) {
                for (k, z) in z.iter().enumerate() {
                    j[(first + k, row.first + local)] += sd * z;
                }
            }
        }
    }

    /// The Laplace approximation at `outer` with the terms `active`. The climb to the mode begins
    /// at `start`, which may be a mode with fewer terms. `None` if there is no mode.
    pub fn fit(
        &self,
        outer: &Outer,
        active: &[usize],
        start: Option<&LaplaceFit>,
    ) -> Option<LaplaceFit> {
        self.fit_without(&[], outer, active, start)
    }

    /// As [`Engine::fit`], but the rows whose number is in `hidden` (ascending) are not seen.
    pub fn fit_without(
        &self,
        hidden: &[usize],
        outer: &Outer,
        active: &[usize],
        start: Option<&LaplaceFit>,
    ) -> Option<LaplaceFit> {
        let mut t = self.model.tape();
        let n_linear = self.split.linear.len();
        let n = n_linear + active.iter().map(|a| self.terms[*a].n).sum::<usize>();
        let (mut x, mut z) = (DVector::zeros(n), vec![0.0; self.sites.len()]);
        if let Some(fit) = start {
            let n = fit.x.len().min(n);
            x.rows_mut(0, n).copy_from(&fit.x.rows(0, n));
            z.clone_from(&fit.z);
        } else {
            let initial = self.model.initial();
            for (k, at) in self.split.linear.iter().enumerate() {
                x[k] = initial[*at];
            }
        }
        let linear = self.linear(&mut t, outer, active, &x, start);
        let noise = self.noise(outer, active);
        let newton = Newton { engine: self, outer, linear: &linear, noise: &noise, hidden };
        let (point, system) = newton.climb(&mut t, x, z)?;
        let fit = self.finish(outer, active, linear, point, system);
        Some(LaplaceFit { noise, ..fit })
    }

    fn finish(
        &self,
        outer: &Outer,
        active: &[usize],
        linear: Linear,
        point: Point,
        system: System,
    ) -> LaplaceFit {
        let ln_det = 2.0 * system.factor.l_dirty().diagonal().map(f64::ln).sum()
            + system.precision.iter().map(|p| p.ln()).sum::<f64>();
        // the terms' coefficients and the sites' effects are standard normal: their constants cancel
        let n_linear = self.split.linear.len() as f64;
        let ln_evidence = point.value + 0.5 * n_linear * std::f64::consts::TAU.ln() - 0.5 * ln_det;
        LaplaceFit {
            outer: outer.clone(),
            active: active.to_vec(),
            noise: vec![],
            x: point.x,
            z: point.z,
            ln_evidence,
            locals: point.locals,
            linear,
            system,
            curvatures: point.curvatures,
        }
    }

    /// Minus the Hessian of the prior in the linear unknowns. Coefficients of GP terms are standard normal.
    pub(super) fn prior_curvature(&self, other: &[f64], x: &DVector<f64>) -> DMatrix<f64> {
        let n = self.split.linear.len();
        let free: Vec<usize> = (0..n).filter(|k| !self.split.is_eta[*k]).collect();
        let at: Vec<usize> = free.iter().map(|k| self.split.linear[*k]).collect();
        let columns = self.model.prior_hessian(&self.unknowns(other, x), &at);
        let mut curvature = DMatrix::identity(n, n);
        for (column, k) in columns.iter().zip(&free) {
            for (l, at) in free.iter().zip(&at) {
                curvature[(*l, *k)] = -column[*at];
            }
        }
        curvature
    }
}

#[cfg(test)]
#[path = "laplace_tests.rs"]
mod tests;
