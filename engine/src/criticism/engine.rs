//! The engine: a model with what criticism adds to it.
//!
//! ```text
//! scalars of a row = constant + J x + τ a z_site + Σ_terms s Z β
//! ```
//! - `x` are the model's linear unknowns ([`Split`]).
//! - `z_site ~ N(0, 1)` is a random effect that a site's rows share; τ is its sd, and `a` is 1 for
//!   the scalar that it acts on, else 0.
//! - β ~ N(0, 1) are the coefficients of the terms that are tried.

use std::sync::Arc;

use nalgebra::DVector;

use crate::model::{Model, Noise, RowId, Split};
use crate::num::vector::dot;

/// An effect in the form in which it is tried: `sd Z β` on the named quantities, β ~ N(0, 1). A
/// term that acts on nothing makes scatter: it multiplies the further error of a row by `exp(Z γ)`,
/// with γ in [`Outer::scatter`].
#[derive(Clone, Debug)]
pub struct TriedTerm {
    /// Fields and `let`s that it acts on.
    pub on: Vec<String>,
    /// Design, row-major (rows of the table, n).
    pub design: Vec<f64>,
    /// Number of coefficients.
    pub n: usize,
    /// What the design is multiplied by. `None` for the random effect of a unit, whose sd is one of
    /// the outer values ([`Outer::ln_unit`]).
    pub sd: Option<f64>,
}

/// The outer values of a fit: everything that is not integrated over.
#[derive(Clone, Debug, PartialEq)]
pub struct Outer {
    /// The model's other unknowns, unconstrained.
    pub other: Vec<f64>,
    /// ln sd of the random effect of sites.
    pub ln_site: f64,
    /// ln sd of the further error of rows.
    pub ln_noise: f64,
    /// ln sd of the random effect of units (recordings, sessions), if there is one.
    pub ln_unit: Option<f64>,
    /// Share and sd of outlying rows.
    pub outliers: Option<(f64, f64)>,
    /// The coefficients of each active term that makes scatter, in the order of the active terms.
    pub scatter: Vec<Vec<f64>>,
}

impl TriedTerm {
    /// Whether it makes scatter, and moves nothing.
    pub fn is_scatter(&self) -> bool {
        self.on.is_empty() && self.n > 0
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
    /// Which of its scalars, counted from `first`, is its observable. Site effects act on this one.
    pub observable: usize,
}

/// A model laid out for Laplace fits. Copies are cheap, because they share the model and the
/// designs.
#[derive(Clone, Debug)]
pub struct Engine {
    /// The model, with offsets for everything that is tried.
    pub model: Arc<Model>,
    /// Its linear unknowns and the others.
    pub split: Split,
    /// Rows, in the model's order.
    pub rows: Vec<RowAt>,
    /// Rows of each site.
    pub sites: Vec<Vec<usize>>,
    /// What can be tried.
    pub terms: Vec<Arc<TriedTerm>>,
    /// The measurement of each row, as cells.
    pub measured: Vec<Vec<f64>>,
    pub(super) n_locals: usize,
}

impl Engine {
    /// Lays `model` out. `observable[o]` is what site effects act on in the rows of `observe`
    /// number o. `site_of` gives the site of each row of the table. Rows of the table in `unused`
    /// are left aside.
    pub fn new(
        model: Model,
        observable: &[String],
        site_of: &[usize],
        unused: &[usize],
        terms: Vec<TriedTerm>,
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
        let measured = rows.iter().map(|row| model.measured_row(row.id)).collect();
        let terms = terms.into_iter().map(Arc::new).collect();
        Self { model: Arc::new(model), split, rows, sites, terms, measured, n_locals: first }
    }

    /// The same engine with other measurements. So simulated data need no new layout.
    #[must_use]
    pub fn measuring(&self, measured: Vec<Vec<f64>>) -> Self {
        Self { measured, ..self.clone() }
    }

    /// Row of the table behind a row.
    pub fn table_row(&self, row: usize) -> usize {
        self.model.table_row(self.rows[row].id)
    }

    /// What was measured in a row: its cell, or the middle of its bracket. NaN if the bracket is
    /// open.
    pub fn middle(&self, row: usize) -> f64 {
        let cells = &self.measured[row];
        let middle = cells.iter().sum::<f64>() / cells.len() as f64;
        if middle.is_finite() { middle } else { f64::NAN }
    }

    /// The further errors of each row, beyond its likelihood, with the terms `active`.
    pub fn noise(&self, outer: &Outer, active: &[usize]) -> Vec<Noise> {
        let terms = active.iter().map(|a| &*self.terms[*a]).filter(|term| term.is_scatter());
        let scatter: Vec<(&TriedTerm, &Vec<f64>)> = terms.zip(&outer.scatter).collect();
        let outliers = outer.outliers.map(|(share, sd)| (share, sd * sd));
        let one = |row: usize| {
            let ln: f64 = scatter.iter().map(|(t, s)| dot::<1>(self.design(t, row), s)).sum();
            Noise { variance: (2.0 * (outer.ln_noise + ln)).exp(), outliers }
        };
        (0..self.rows.len()).map(one).collect()
    }

    /// How a row depends on a term's coefficients. The term's sd is not multiplied in.
    pub fn design<'e>(&self, term: &'e TriedTerm, row: usize) -> &'e [f64] {
        &term.design[self.table_row(row) * term.n..][..term.n]
    }

    /// Puts the linear and the other unknowns together to all unknowns of the model.
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
}
