//! A model with what criticism adds to it, and its Laplace approximation.
//!
//! ```text
//! scalars of a row = constant + J x + τ a z_site + Σ_terms s Z β
//! p(y | τ, σ, other) ≈ p(y, x̂, ẑ, β̂) (2π)^(d/2) det(−∇²)^(−½)
//! ```
//! `x` are the model's linear unknowns ([`Split`]), `z_site ~ N(0, 1)` a random effect shared by a
//! site's rows with sd τ, β ~ N(0, 1) the coefficients of the terms that are tried, and σ the sd of
//! a further normal error of every row ([`Noise`]). Random effects touch only their own site, so
//! that they are eliminated one by one: the matrix that is factored has the size of (x, β).

use nalgebra::{DMatrix, DVector};

use super::fit::{Fit, Linear};
use super::newton::{Newton, Point, System};
use crate::model::{Model, Noise, RowId, Split, Tape};

/// An effect in its tried form: `sd Z β` on the named quantities, β ~ N(0, 1).
#[derive(Clone, Debug)]
pub struct Term {
    /// Fields and `let`s that it acts on.
    pub on: Vec<String>,
    /// Design, row-major (rows of the table, n).
    pub design: Vec<f64>,
    /// Number of coefficients.
    pub n: usize,
    /// What the design is multiplied by; `None` for the random effect of a unit, whose sd is one of the
    /// outer values ([`Outer::ln_unit`]).
    pub sd: Option<f64>,
}

/// Everything of a fit that is not integrated out.
#[derive(Clone, Debug, PartialEq)]
pub struct Outer {
    /// The model's other unknowns, unconstrained.
    pub other: Vec<f64>,
    /// ln sd of the random effect of sites.
    pub ln_site: f64,
    /// ln sd of the further error of rows.
    pub ln_noise: f64,
    /// ln sd of the random effect of units (recordings, sessions), where they have one.
    pub ln_unit: Option<f64>,
    /// Share and sd of outlying rows.
    pub outliers: Option<(f64, f64)>,
}

impl Outer {
    pub(super) fn noise(&self) -> Noise {
        Noise {
            variance: (2.0 * self.ln_noise).exp(),
            outliers: self.outliers.map(|(share, sd)| (share, sd * sd)),
        }
    }
}

/// A row's place in the engine.
#[derive(Clone, Copy, Debug)]
pub struct RowAt {
    /// The row in the model.
    pub id: RowId,
    /// Its site.
    pub site: usize,
    /// Its first scalar.
    pub first: usize,
    /// Number of scalars.
    pub n: usize,
    /// The scalar, from `first` on, that is its observable: what site effects act on.
    pub observable: usize,
}

/// A model laid out for Laplace fits.
#[derive(Debug)]
pub struct Engine {
    /// The model, with offsets for everything that is tried.
    pub model: Model,
    /// Its linear unknowns and the others.
    pub split: Split,
    /// Rows, in the model's order.
    pub rows: Vec<RowAt>,
    /// Rows of each site.
    pub sites: Vec<Vec<usize>>,
    /// What can be tried.
    pub terms: Vec<Term>,
    n_locals: usize,
}

impl Engine {
    /// Lays `model` out; `observable[o]` is what site effects act on in the rows of `observe` number o,
    /// `site_of` gives the site of each row of the table, of which those in `unused` are left aside.
    pub fn new(
        model: Model,
        observable: &[String],
        site_of: &[usize],
        unused: &[usize],
        terms: Vec<Term>,
    ) -> Self {
        let split = model.split();
        let mut rows = vec![];
        let mut first = 0;
        let is_used = |id: &RowId| !unused.contains(&model.table_row(*id));
        for id in model.row_ids().into_iter().filter(is_used) {
            let n = model.n_locals(id);
            let on = model.local_of(id, &observable[id.observe]).unwrap_or(0);
            rows.push(RowAt { id, site: site_of[model.table_row(id)], first, n, observable: on });
            first += n;
        }
        let n_sites = site_of.iter().max().map_or(0, |s| s + 1);
        let mut sites = vec![vec![]; n_sites];
        for (r, row) in rows.iter().enumerate() {
            sites[row.site].push(r);
        }
        Self { model, split, rows, sites, terms, n_locals: first }
    }

    /// The scalars as a linear map at these other unknowns, terms included; the model's part is taken from
    /// `last` if that was made at the same.
    fn linear(
        &self,
        t: &mut Tape,
        outer: &Outer,
        active: &[usize],
        x: &DVector<f64>,
        last: Option<&Fit>,
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
        Linear { constant, used, j, prior: self.prior_curvature(t, other, x) }
    }

    /// Writes how scalars depend on a term's coefficients, the first of which is unknown number `first`.
    fn add_term(&self, term: &Term, outer: &Outer, first: usize, j: &mut DMatrix<f64>) {
        let sd = term.sd.or(outer.ln_unit.map(f64::exp)).unwrap_or_default();
        for row in &self.rows {
            let z = &term.design[self.model.table_row(row.id) * term.n..][..term.n];
            for local in term.on.iter().filter_map(|on| self.model.local_of(row.id, on)) {
                for (k, z) in z.iter().enumerate() {
                    j[(first + k, row.first + local)] += sd * z;
                }
            }
        }
    }

    /// All unknowns of the model from the two kinds.
    pub fn unknowns(&self, other: &[f64], x: &DVector<f64>) -> Vec<f64> {
        let mut u = vec![0.0; other.len() + self.split.linear.len()];
        for (at, value) in self.split.other.iter().zip(other) {
            u[*at] = *value;
        }
        for (at, value) in self.split.linear.iter().zip(x.iter()) {
            u[*at] = *value;
        }
        u
    }

    /// The Laplace approximation at `outer` with the terms `active`, climbing from `start` (a mode with
    /// fewer terms will do); `None` where there is no mode.
    pub fn fit(&self, outer: &Outer, active: &[usize], start: Option<&Fit>) -> Option<Fit> {
        self.fit_without(&[], outer, active, start)
    }

    /// As [`Engine::fit`], rows whose number is in `hidden` (ascending) unseen.
    pub fn fit_without(
        &self,
        hidden: &[usize],
        outer: &Outer,
        active: &[usize],
        start: Option<&Fit>,
    ) -> Option<Fit> {
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
        let newton = Newton { engine: self, outer, linear: &linear, hidden };
        let (point, system) = newton.climb(&mut t, x, z)?;
        Some(self.finish(outer, active, linear, point, system))
    }

    fn finish(
        &self,
        outer: &Outer,
        active: &[usize],
        linear: Linear,
        point: Point,
        system: System,
    ) -> Fit {
        let ln_det = 2.0 * system.factor.l_dirty().diagonal().map(f64::ln).sum()
            + system.precision.iter().map(|p| p.ln()).sum::<f64>();
        // the terms' coefficients and the sites' effects are standard normal: their constants cancel
        let n_linear = self.split.linear.len() as f64;
        let ln_evidence = point.value + 0.5 * n_linear * std::f64::consts::TAU.ln() - 0.5 * ln_det;
        Fit {
            outer: outer.clone(),
            active: active.to_vec(),
            x: point.x,
            z: point.z,
            ln_evidence,
            locals: point.locals,
            linear,
            factor: system.factor,
            precision: system.precision,
            coupling: system.coupling,
            curvatures: point.curvatures,
        }
    }

    /// Minus the Hessian of the prior in the linear unknowns that are not standard normal.
    fn prior_curvature(&self, t: &mut Tape, other: &[f64], x: &DVector<f64>) -> DMatrix<f64> {
        const STEP: f64 = 1e-4;
        let n = self.split.linear.len();
        let mut curvature = DMatrix::zeros(n, n);
        let mut u = self.unknowns(other, x);
        let mut ends = [vec![0.0; u.len()], vec![0.0; u.len()]];
        for (k, at) in self.split.linear.iter().enumerate() {
            if self.split.is_eta[k] {
                curvature[(k, k)] = 1.0;
                continue;
            }
            let centre = u[*at];
            for (end, sign) in ends.iter_mut().zip([-1.0, 1.0]) {
                u[*at] = centre + sign * STEP;
                self.model.ln_prior(t, &u, end);
            }
            u[*at] = centre;
            for (i, other) in self.split.linear.iter().enumerate() {
                curvature[(i, k)] = (ends[0][*other] - ends[1][*other]) / (2.0 * STEP);
            }
        }
        0.5 * (&curvature + curvature.transpose())
    }
}

#[cfg(test)]
#[path = "engine_tests.rs"]
mod tests;
