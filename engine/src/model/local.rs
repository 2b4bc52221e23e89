//! A model as criticism sees it. Each row depends on a few scalars, and these are linear in every
//! unknown that is Gaussian.
//!
//! ```text
//! scalars of a row = constant + J x,   x: unknowns on the whole line (coefficients, means, …)
//! ```
//! The constant and J depend only on the other unknowns, which have a bounded support: amplitudes,
//! lengthscales, noise.

use super::laid_out::{FieldEntry, Model, PriorEntry};
use super::reported::{Kind, Parameter, Position};
use super::rows::{Curvature, Noise};
use super::tape::Tape;
use crate::dist::Support;
use crate::infer::LogDensity as _;
use rand::Rng;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// The unknowns in which a row's scalars are linear, and the others.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Split {
    /// Unknowns on the whole line: coefficients of GP terms, means, coefficients of effects.
    pub linear: Vec<usize>,
    /// How many of these, from which position on, are standard normal coefficients of GP terms.
    pub is_eta: Vec<bool>,
    /// The others: positive, bounded or constrained.
    pub other: Vec<usize>,
}

/// A row: number `row` of number `observe`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowId {
    /// The `observe` statement.
    pub observe: usize,
    /// The row among its own.
    pub row: usize,
}

/// Is called for a row at a draw, with the number of the row, its scalars, and a source of random
/// numbers.
pub type Visit<'a> = dyn FnMut(usize, &[f64], &mut dyn Rng) + 'a;

impl Model {
    /// Tells linear unknowns from others.
    pub fn split(&self) -> Split {
        let mut kind: BTreeMap<usize, bool> = BTreeMap::new();
        for p in &self.parameters {
            if let Position::Eta { u, first, .. } = p.position {
                kind.extend((u..u + p.len - first).map(|u| (u, true)));
            }
        }
        let declared = self.parameters.iter().filter(|p| p.kind != Kind::Eta);
        let scales = self.scales();
        for (p, entry) in declared.zip(&self.prior_entries) {
            let is_scale = scales.iter().any(|v| (entry.v..entry.v + entry.len).contains(v));
            if p.support == Support::Real && !is_scale {
                kind.extend(entry.u.clone().map(|u| (u, false)));
            }
        }
        let other = (0..self.dim()).filter(|u| !kind.contains_key(u)).collect();
        let (linear, is_eta) = kind.into_iter().unzip();
        Split { linear, is_eta, other }
    }

    /// Whether the curvature of the prior in the linear unknowns depends on the others.
    pub fn curvature_varies(&self, split: &Split) -> bool {
        let is_linear = |entry: &PriorEntry| split.linear.binary_search(&entry.u.start).is_ok();
        let depends = |entry: &PriorEntry| is_linear(entry) && !entry.mentions.is_empty();
        self.prior_entries.iter().any(depends) || !self.densities.is_empty()
    }

    /// Values that the coefficients of GP terms are multiplied by.
    fn scales(&self) -> Vec<usize> {
        let terms = self.fields.iter().flat_map(|f| &f.op.terms);
        terms.flat_map(|t| [t.amplitude.mentions(), t.spectrum.mentions()].concat()).collect()
    }

    /// All rows, in order.
    pub fn row_ids(&self) -> Vec<RowId> {
        let rows = |(observe, o): (usize, &super::Observe)| {
            (0..o.rows.len()).map(move |row| RowId { observe, row })
        };
        self.observes.iter().enumerate().flat_map(rows).collect()
    }

    /// Visits these rows at draws of `fitted`, the same model on other rows. `visit` gets the
    /// number of the row among `ids`, its scalars, and a source of random numbers. Unknowns that
    /// `fitted` lacks, such as the coefficient or the field of a new label, are drawn from their
    /// prior: see [`Model::draw_unknown`].
    pub fn at_draws(
        &self,
        fitted: &Self,
        draws: &[Vec<f64>],
        ids: &[RowId],
        rng: &mut dyn Rng,
        visit: &mut Visit<'_>,
    ) {
        let from = self.unknowns_in(fitted);
        let known: Vec<bool> = from.iter().map(Option::is_some).collect();
        let (mut tape, mut locals) = (self.tape(), vec![]);
        for draw in draws {
            let mut u: Vec<f64> = from.iter().map(|from| from.map_or(0.0, |i| draw[i])).collect();
            self.draw_unknown(&mut tape, &mut u, &known, rng);
            self.locals_at(&mut tape, &u, ids, &mut locals);
            let mut rest = locals.as_slice();
            for (row, id) in ids.iter().enumerate() {
                let (own, others) = rest.split_at(self.n_locals(*id));
                rest = others;
                visit(row, own, rng);
            }
        }
    }

    /// For each unknown, the unknown of `fitted` with the same name, if there is one. `fitted` is
    /// the same model on the first of these rows. Two unknowns may have the same name, such as the
    /// empty cells in line 7 of two files; then it is the first.
    pub(super) fn unknowns_in(&self, fitted: &Self) -> Vec<Option<usize>> {
        let names = fitted.unknown_names().into_iter().enumerate();
        let mut names: BTreeMap<String, usize> = names.map(|(i, name)| (name, i)).collect();
        self.unknown_names().iter().map(|name| names.remove(name)).collect()
    }

    /// Row of the table behind a row.
    pub fn table_row(&self, id: RowId) -> usize {
        self.observes[id.observe].rows[id.row]
    }

    /// Number of scalars of a row.
    pub fn n_locals(&self, id: RowId) -> usize {
        self.observes[id.observe].op.locals(id.row).len()
    }

    /// Which of a row's scalars an offset on `target` is added to, if any.
    pub fn local_of(&self, id: RowId, target: &str) -> Option<usize> {
        let observe = &self.observes[id.observe];
        let find = |((of, on), at): (&(&str, Cow<'_, str>), &usize)| {
            (*of == observe.name && on == target).then_some(at + id.row)
        };
        let at = self.hooks.iter().find_map(find)?;
        observe.op.locals(id.row).iter().position(|(value, offset)| *value == at || *offset == at)
    }

    /// The scalars of every row at these unknowns, offsets zero.
    pub fn locals_at(&self, t: &mut Tape, u: &[f64], ids: &[RowId], out: &mut Vec<f64>) {
        self.forward(t, u);
        out.clear();
        for id in ids {
            let places = self.observes[id.observe].op.locals(id.row);
            out.extend(places.iter().map(|(value, offset)| t.v[*value] + t.v[*offset]));
        }
    }

    /// Log density of the unknowns without the measurements, and its gradient.
    pub fn ln_prior(&self, t: &mut Tape, u: &[f64], gradient: &mut [f64]) -> f64 {
        self.forward(t, u);
        self.backward_without_rows(t);
        gradient.copy_from_slice(&t.gu);
        t.lp
    }

    /// Log likelihood of a row at these scalars, if `cells` had been measured. It comes with the
    /// gradient and the Hessian in the scalars numbered `of`; in the others they are zero.
    pub fn row_curvature(
        &self,
        id: RowId,
        cells: &[f64],
        locals: &[f64],
        of: &[usize],
        noise: &Noise,
    ) -> Curvature {
        self.observes[id.observe].op.curvature(id.row, cells, locals, of, noise)
    }

    /// As [`Model::row_curvature`], but in every scalar and, as the last one, in the variance of
    /// `noise`.
    pub fn row_whole_curvature(
        &self,
        id: RowId,
        cells: &[f64],
        locals: &[f64],
        noise: &Noise,
    ) -> Curvature {
        self.observes[id.observe].op.whole_curvature(id.row, cells, locals, noise)
    }

    /// The gradient of the second derivative of a row's log likelihood along `direction` of its
    /// scalars, `(n)`. It is in every scalar and, as the last one, in the variance of `noise`.
    pub fn row_bend(
        &self,
        id: RowId,
        cells: &[f64],
        locals: &[f64],
        direction: &[f64],
        noise: &Noise,
    ) -> Vec<f64> {
        self.observes[id.observe].op.bend(id.row, cells, locals, direction, noise)
    }

    /// Log likelihood of a row at these scalars, if `cells` had been measured.
    pub fn row_ln(&self, id: RowId, cells: &[f64], locals: &[f64], noise: &Noise) -> f64 {
        self.observes[id.observe].op.ln_at(id.row, cells, locals, noise)
    }

    /// A measurement that is simulated for a row at these scalars. It is made as `cells` were: a
    /// bracket has the width of theirs.
    pub fn row_replicate(
        &self,
        id: RowId,
        cells: &[f64],
        locals: &[f64],
        rng: &mut dyn Rng,
    ) -> Vec<f64> {
        self.observes[id.observe].op.replicate(id.row, cells, locals, rng)
    }

    /// The predicted value of a row at these scalars, in the unit of the measurement.
    pub fn row_location(&self, id: RowId, locals: &[f64]) -> Option<f64> {
        self.observes[id.observe].op.location(id.row, locals)
    }

    /// The derivative of a row's predicted value in each of its scalars.
    pub fn row_location_slopes(&self, id: RowId, locals: &[f64]) -> Option<Vec<f64>> {
        self.observes[id.observe].op.location_slopes(id.row, locals)
    }

    /// For each field, its name and the names of the parameters in mm on which its kernels depend.
    pub fn lengthscales(&self) -> Vec<(&str, Vec<String>)> {
        let named = |v: usize| {
            let holds = |p: &&Parameter| matches!(p.position, Position::Values(at) if (at..at + p.len).contains(&v));
            let p = self.parameters.iter().filter(|p| p.unit == "mm").find(holds)?;
            let Position::Values(at) = p.position else { return None };
            Some(p.element(v - at))
        };
        let of_field = |f: &FieldEntry| {
            f.op.terms.iter().flat_map(|t| t.spectrum.mentions()).filter_map(named).collect()
        };
        self.fields.iter().map(|f| (f.name.as_str(), of_field(f))).collect()
    }

    /// Names of the fields.
    pub fn field_names(&self) -> Vec<&str> {
        self.fields.iter().map(|f| f.name.as_str()).collect()
    }

    /// The measurement of a row, as cells.
    pub fn measured_row(&self, id: RowId) -> Vec<f64> {
        self.observes[id.observe].observed_row(id.row)
    }

    /// Takes a row out of the density, but keeps its place among the rows: the posterior is then
    /// that given the other rows.
    pub fn leave_out(&mut self, id: RowId) {
        self.observes[id.observe].op.place.left_out = Some(id.row);
    }
}
