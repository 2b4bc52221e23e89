//! A model with its data: a log density over unconstrained unknowns, and what its draws mean.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, RwLock};

use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;

use super::density::Density;
use super::error::ModelError;
use super::gp::Field;
use super::late::LateMaps;
use super::lets::LetValues;
use super::linear::Linear;
use super::map::Map;
use super::over::Over;
use super::predictor::Predictor;
use super::reported::{Parameter, Position};
use super::rows::Rows;
use super::tape::{Op, Tape};
use crate::num::Within;
use crate::table::{Measurements, Triangulation};

/// First offset of (observe, field or `let`).
pub(super) type Hooks = BTreeMap<(&'static str, Cow<'static, str>), usize>;

/// Where the numbers of a declared parameter live, and what its prior depends on.
#[derive(Clone, Debug)]
pub(super) struct PriorEntry {
    /// Unknowns.
    pub(super) u: Range<usize>,
    /// First value.
    pub(super) v: usize,
    /// Number of values.
    pub(super) len: usize,
    /// Values that its prior mentions.
    pub(super) mentions: Vec<usize>,
}

/// Deviations of places: one for each vertex. Their prior is normal, and its sd is learnt.
#[derive(Debug)]
pub(super) struct SpreadEntry {
    /// Which of the model's priors is theirs.
    pub(super) prior: usize,
    /// The vertex of each.
    pub(super) vertices: Vec<u32>,
}

#[derive(Debug)]
pub(super) struct FieldEntry {
    pub(super) name: String,
    pub(super) unit: String,
    pub(super) range: Option<(f64, f64)>,
    /// The range into which its sum of mean and processes is bent. The tape holds the sum, not the
    /// bent value.
    pub(super) within: Option<Within>,
    /// Which label it belongs to, if there is one field for each.
    pub(super) label: Option<usize>,
    /// Whether its mean depends on a flat parameter. The field then has no prior width.
    pub(super) has_flat_mean: bool,
    /// First sampled mode: 1 if the constant mode is collapsed, else 0.
    pub(super) first: usize,
    /// The vertices that its rows are at, ascending.
    pub(super) probes: Vec<u32>,
    /// Number of its group. Fields of different groups share no row; fields of the same group have
    /// the same probes.
    pub(super) group: usize,
    pub(super) op: Field,
}

impl FieldEntry {
    /// The field's value where its sum is this.
    pub(super) fn value(&self, sum: f64) -> f64 {
        self.within.map_or(sum, |within| within.value(sum))
    }

    /// The sum at which the field has this value.
    pub(super) fn sum(&self, value: f64) -> f64 {
        self.within.map_or(value, |within| within.inverse(value))
    }
}

/// The measurements of one `observe` statement.
#[derive(Debug)]
pub struct Observe {
    /// The statement's name.
    pub name: &'static str,
    /// Declared unit.
    pub unit: String,
    /// Names of the numbers that a measurement consists of.
    pub columns: &'static [&'static str],
    /// Columns of the table that it is read or computed from.
    pub cells: Vec<String>,
    /// Rows of the table, from 0.
    pub rows: Vec<usize>,
    pub(super) op: Rows,
}

/// Where arrival times were corrected (`corrected.rs`).
#[derive(Debug)]
pub(super) struct Correction {
    /// xₖ
    pub(super) at: Vec<Vec<f64>>,
    /// Of the finer triangles.
    pub(super) n_vertices: usize,
}

/// A model laid out on its data.
#[derive(Debug)]
pub struct Model {
    /// The model's name.
    pub name: &'static str,
    /// The model as a model file has it, with what was added to it.
    pub source: String,
    /// Parameters in order of declaration.
    pub parameters: Vec<Parameter>,
    /// Measurements in order of declaration.
    pub observes: Vec<Observe>,
    /// What is reported of `let`s that are no maps, in order of declaration.
    pub lets: Vec<LetValues>,
    /// Log densities in order of declaration.
    pub densities: Vec<Density>,
    pub(super) priors: Vec<Box<dyn Op>>,
    /// What is known of each of `priors`.
    pub(super) prior_entries: Vec<PriorEntry>,
    pub(super) fields: Vec<FieldEntry>,
    pub(super) spreads: Vec<SpreadEntry>,
    pub(super) linear: Vec<Linear>,
    /// Linear predictors that are written out. Only a model without fields has any.
    pub(super) predictors: Vec<Predictor>,
    /// Operators over the whole surface. They depend on fields and parameters.
    pub(super) over: Vec<Over>,
    /// What they are computed on.
    pub(super) triangulation: Option<Arc<Triangulation>>,
    /// Of arrival times. It changes once while chains run.
    pub(super) correction: RwLock<Option<Correction>>,
    pub(super) maps: Vec<Map>,
    pub(super) late_maps: LateMaps,
    pub(super) offsets: Vec<Range<usize>>,
    /// First offset of (observe, field or let).
    pub(super) hooks: Hooks,
    /// Share and sd of outliers that were added to every `observe`.
    pub(super) outliers: Option<(f64, f64)>,
    /// Names of the `observe`s whose rows were given a further error, each with the name of the
    /// error's sd.
    pub(super) row_errors: Vec<eplat_language::FurtherError>,
    /// Values that are known: the filled cells of columns with a prior.
    pub(super) constants: Vec<(usize, f64)>,
    /// Unknowns whose starting value is the middle of a declared range.
    pub(super) start: Vec<(usize, f64)>,
    /// Lengths of unknowns, values, work.
    pub(super) layout: [usize; 3],
    /// The most modes that an effect asks for.
    pub(super) effect_modes: usize,
}

impl Model {
    /// Computes the values of effects and linear predictors.
    pub(super) fn set_offsets(&self, t: &mut Tape) {
        for range in &self.offsets {
            t.v[range.clone()].fill(0.0);
        }
        self.linear.iter().for_each(|linear| linear.forward(t));
    }

    /// A model of which nothing is laid out yet.
    pub(super) fn empty(name: &'static str, source: String) -> Self {
        Model {
            name,
            source,
            parameters: vec![],
            observes: vec![],
            lets: vec![],
            priors: vec![],
            prior_entries: vec![],
            fields: vec![],
            spreads: vec![],
            linear: vec![],
            predictors: vec![],
            over: vec![],
            triangulation: None,
            correction: RwLock::default(),
            densities: vec![],
            maps: vec![],
            late_maps: LateMaps::default(),
            offsets: vec![],
            hooks: Hooks::new(),
            constants: vec![],
            outliers: None,
            row_errors: vec![],
            start: vec![],
            layout: [0; 3],
            effect_modes: 0,
        }
    }

    /// Refuses measurements that a likelihood cannot take, and terms without a row.
    pub(super) fn check(&mut self, data: &Measurements) -> Result<(), ModelError> {
        let mut t = self.tape();
        self.forward(&mut t, &self.initial());
        for density in &mut self.densities {
            density.settle(&t)?;
        }
        for observe in &self.observes {
            if let Some((i, why)) = observe.op.objection(&t) {
                let columns = observe.cells.join(", ");
                return Err(data
                    .cell_error(
                        observe.rows[i],
                        &columns,
                        why.into(),
                        "mend the row, drop it, or change the likelihood",
                    )
                    .into());
            }
        }
        Ok(())
    }

    /// Whether the model has a field, and so needs a surface.
    pub fn has_fields(&self) -> bool {
        !self.fields.is_empty()
    }

    /// What operators over the whole surface are computed on, in a model with any.
    pub fn triangulation(&self) -> Option<&Triangulation> {
        self.triangulation.as_deref()
    }

    /// The most modes that a field, or an effect that is one, asks for.
    pub fn n_modes(&self) -> usize {
        let fields = self.fields.iter().map(|f| f.op.k + f.first);
        fields.max().unwrap_or(0).max(self.effect_modes)
    }

    /// Number of reported numbers: parameters, with the constant modes that are drawn afterwards.
    pub fn n_reported(&self) -> usize {
        self.parameters.iter().map(|p| p.len).sum()
    }

    /// Where the search for a starting point begins: priors at a typical value, field means in the
    /// middle of their declared range, coefficients zero.
    pub fn initial(&self) -> Vec<f64> {
        let mut t = self.tape();
        for prior in &self.priors {
            prior.initial(&mut t);
        }
        for &(u, value) in &self.start {
            t.u[u] = value;
        }
        t.u
    }

    /// The parameters of the last forward pass in their order. Constant modes that are collapsed
    /// are drawn.
    pub fn report(&self, t: &Tape, rng: &mut dyn Rng, out: &mut Vec<f64>) {
        self.report_with(t, &mut || rng.sample(StandardNormal), out);
    }

    /// The parameters of the last forward pass in their order. Constant modes that are collapsed
    /// are at their mode, zero.
    pub fn report_mode(&self, t: &Tape, out: &mut Vec<f64>) {
        self.report_with(t, &mut || 0.0, out);
    }

    fn report_with(&self, t: &Tape, eta0: &mut dyn FnMut() -> f64, out: &mut Vec<f64>) {
        let restored: Vec<_> = self.fields.iter().map(|f| f.op.restore(t, eta0)).collect();
        for p in &self.parameters {
            match &p.position {
                &Position::Values(v) => out.extend_from_slice(&t.v[v..v + p.len]),
                Position::Cells { v, rows } => out.extend(rows.iter().map(|row| t.v[v + row])),
                &Position::CollapsedMean { field } => {
                    out.push(restored[field].as_ref().map_or(f64::NAN, |(mean, _)| *mean));
                }
                &Position::Eta { u, first, field, term } => {
                    if let (1, Some((_, eta0))) = (first, &restored[field]) {
                        out.push(eta0[term]);
                    }
                    out.extend_from_slice(&t.u[u..u + p.len - first]);
                }
            }
        }
    }

    /// Values of [`Model::lets`] in their order, after a forward pass.
    pub fn let_values(&self, t: &Tape, out: &mut Vec<f64>) {
        self.lets.iter().for_each(|values| values.values(t, out));
    }

    /// Name and rows of everything that has a log likelihood per row: the `observe`s, then the
    /// `density`s with a term for each row.
    pub fn measured(&self) -> impl Iterator<Item = (&'static str, &[usize])> {
        let observes = self.observes.iter().map(|o| (o.name, o.rows.as_slice()));
        observes.chain(self.densities.iter().map(|d| (d.name, d.rows.as_slice())))
    }

    /// Log likelihood of every row of [`Model::measured`], in their order, after a forward pass.
    pub fn pointwise(&self, t: &Tape, out: &mut Vec<f64>) {
        for observe in &self.observes {
            observe.op.pointwise(t, out);
        }
        for density in &self.densities {
            density.pointwise(t, out);
        }
    }

    /// What was measured at every row of [`Model::measured`], in their order.
    pub fn observed(&self) -> impl Iterator<Item = Vec<f64>> {
        let densities = self.densities.iter().flat_map(Density::observed);
        self.observes.iter().flat_map(Observe::observed).chain(densities)
    }

    /// Names of the statements that read measurements.
    pub fn readers(&self) -> Vec<&'static str> {
        let densities = self.densities.iter().filter(|d| d.reads_data).map(|d| d.name);
        self.observes.iter().map(|o| o.name).chain(densities).collect()
    }

    /// Names of the unknowns' parameters, one per unknown, for messages.
    pub fn unknown_names(&self) -> Vec<String> {
        let (mut names, mut priors) = (vec![], self.prior_entries.iter());
        for p in &self.parameters {
            let unknown = match p.position {
                Position::Eta { first, .. } => first..p.len,
                _ => 0..priors.next().map_or(p.len, |entry| entry.u.len()),
            };
            names.extend(unknown.map(|i| p.element(i)));
        }
        names
    }
}

impl Observe {
    /// Whether a row of a table with the same columns holds a measurement of this kind: everything
    /// that the measurement is computed from, or an end of a bracket.
    pub fn is_measured(&self, table: &Measurements, row: usize) -> bool {
        let has = |column: &String| table.cell(row, column).is_some_and(|cell| !cell.is_empty());
        let is_computed = self.cells.len() != self.columns.len();
        if is_computed { self.cells.iter().all(has) } else { self.cells.iter().any(has) }
    }

    /// The measurement of one row.
    pub fn observed_row(&self, row: usize) -> Vec<f64> {
        self.op.observed_row(row)
    }

    /// The measurements, one vector of [`Observe::columns`] per row.
    pub fn observed(&self) -> Vec<Vec<f64>> {
        self.op.observed()
    }

    /// A replicate of every measurement, after a forward pass.
    pub fn simulate(&self, t: &Tape, rng: &mut dyn Rng) -> Vec<Vec<f64>> {
        self.op.simulate(t, rng)
    }
}
