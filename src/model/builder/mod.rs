//! What the macro calls, one call for each statement: lays out unknowns and values, and makes operations.

use std::collections::{BTreeMap, BTreeSet};
use std::marker::PhantomData;
use std::sync::Arc;

use crate::dist::{Dist, Sequence, Support, Vector};
use crate::manifold::Basis;
use crate::model::error::ModelError;
use crate::model::expansion::{Decl, PriorFn, VectorFn};
use crate::model::model::{Kind, Model, Parameter, Position, PriorEntry, Statement};
use crate::model::parameter::{ImputedOp, Known, ParameterOp, SequenceFn, SequenceOp};
use crate::model::scope::Local;
use crate::num::Num;
use crate::table::Measurements;

mod effects;
mod fields;
mod lets;
mod observes;

/// How many numbers a parameter is.
#[derive(Clone, Copy, Debug)]
pub enum Len {
    /// `param sigma`
    One,
    /// `param w(3)`
    Many(usize),
    /// `param b(operator)`: one per label
    Each(&'static str),
}

/// What a likelihood or a `let` mentions: names of numbers, and of the `let`s through which they are seen.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// Parameters, fields, labelled parameters, linear predictors, imputed columns.
    pub numbers: &'static [&'static str],
    /// `let`s.
    pub lets: &'static [&'static str],
    /// Whether a column of the row is read.
    pub reads_row: bool,
}

/// `from (…)`: a measurement that is computed from columns.
#[derive(Clone, Copy, Debug)]
pub struct Computed {
    /// The expression, as written.
    pub text: &'static str,
    /// The columns that it reads.
    pub columns: &'static [&'static str],
}

/// The labels of a column, and which of them each row of the table has.
#[derive(Clone, Debug)]
pub(super) struct Labels {
    pub(super) column: &'static str,
    pub(super) names: Vec<String>,
    pub(super) of_row: Vec<usize>,
}

/// What a name stands for in a row.
#[derive(Clone, Debug)]
enum Source {
    /// So many numbers from `v` on.
    Scalars {
        v: usize,
        len: usize,
    },
    /// A number for each label.
    Each {
        v: usize,
        labels: Arc<Labels>,
    },
    /// The cells of a column with a prior: a number for each row of the table.
    Cells {
        v: usize,
    },
    /// A linear predictor.
    Linear {
        beta: &'static str,
        columns: Vec<&'static str>,
    },
    /// A field, or the first of one for each label.
    Field {
        field: usize,
        labels: Option<Arc<Labels>>,
    },
    Let,
}

/// Lays a model out on its data.
pub struct Builder<'a> {
    basis: Option<&'a Basis>,
    data: Option<&'a Measurements>,
    probes: Vec<u32>,
    names: Vec<(String, Source)>,
    effects: Vec<effects::Effect>,
    /// Names that offsets are wanted for besides those of effects.
    offsets_on: Vec<String>,
    /// Share and sd of outliers that are added to every `observe`.
    outliers: Option<(f64, f64)>,
    /// First offset of (observe, field or let).
    hooks: BTreeMap<(&'static str, &'static str), usize>,
    /// First value of (observe, linear predictor).
    predictors: BTreeMap<(&'static str, &'static str), usize>,
    /// (`let`, observe that depends on it)
    seen: BTreeSet<(&'static str, &'static str)>,
    lets: Vec<lets::Declared>,
    /// Values whose prior is flat, with their unknown; and values that expressions mention, how often.
    flat: BTreeMap<usize, usize>,
    mentions: BTreeMap<usize, usize>,
    /// The field or block whose hyperparameters are being declared.
    prefix: Option<&'static str>,
    /// The field that is being declared.
    field: Option<fields::Declared>,
    n_u: usize,
    n_v: usize,
    n_work: usize,
    model: Model,
}

impl std::fmt::Debug for Builder<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Builder").field("model", &self.model).finish_non_exhaustive()
    }
}

impl<'a> Builder<'a> {
    /// For an empty `model`. Without `data` no measurement is laid out: enough to show a model.
    pub(super) fn new(
        model: Model,
        basis: Option<&'a Basis>,
        data: Option<&'a Measurements>,
    ) -> Self {
        let probes = data.map(Measurements::vertices).unwrap_or_default();
        Builder {
            basis,
            data,
            probes,
            names: vec![],
            effects: vec![],
            offsets_on: vec![],
            outliers: None,
            hooks: BTreeMap::new(),
            predictors: BTreeMap::new(),
            seen: BTreeSet::new(),
            lets: vec![],
            flat: BTreeMap::new(),
            mentions: BTreeMap::new(),
            prefix: None,
            field: None,
            n_u: 0,
            n_v: 1, // v[0] is zero
            n_work: 0,
            model,
        }
    }

    /// Asks for an offset, zero by itself, wherever a likelihood depends on one of these names.
    pub(super) fn want_offsets(&mut self, on: impl IntoIterator<Item = String>) {
        self.offsets_on.extend(on);
    }

    /// Lets this share of the measurements of every `observe` to come have a further error of this sd.
    pub(super) fn add_outliers(&mut self, share: f64, sd: f64) {
        self.outliers = Some((share, sd));
        self.model.outliers = self.outliers;
    }

    fn values(&mut self, n: usize) -> usize {
        self.n_v += n;
        self.n_v - n
    }

    fn unknowns(&mut self, n: usize) -> usize {
        self.n_u += n;
        self.n_u - n
    }

    #[allow(clippy::expect_used, reason = "the macro has resolved every name of an expression")]
    fn source(&self, name: &str) -> &Source {
        let found = self.names.iter().rev().find(|(n, _)| *n == name);
        &found.expect("names are declared before use").1
    }

    fn state(&mut self, keyword: &'static str, decl: Decl) {
        self.model.statements.push(Statement { keyword, decl });
    }

    /// Where the N numbers behind these names live, of labelled ones that of number `label`.
    fn local<const N: usize>(&mut self, names: &[&str], label: usize) -> Local<N> {
        let mut at = [0; N];
        let mut places = at.iter_mut();
        for name in names {
            let (v, len) = match *self.source(name) {
                Source::Scalars { v, len } => (v, len),
                Source::Each { v, .. } => (v + label, 1),
                _ => unreachable!("the macro hands over parameters here"),
            };
            for v in v..v + len {
                *self.mentions.entry(v).or_default() += 1;
                if let Some(place) = places.next() {
                    *place = v as u32;
                }
            }
        }
        Local { at }
    }

    /// What follows, up to [`Builder::end_block`], are the parameters of the block `name`.
    pub fn block(&mut self, name: &'static str) {
        self.prefix = Some(name);
    }

    /// The block ends.
    pub fn end_block(&mut self) {
        self.prefix = None;
    }

    /// `param name(len) [unit] ~ prior;`, or a hyperparameter of a field or block. M is N + 1.
    ///
    /// # Errors
    /// A label column that the data lack.
    pub fn param<F: PriorFn<N>, const N: usize, const M: usize>(
        &mut self,
        decl: Decl,
        len: Len,
        mentions: &[&str],
    ) -> Result<(), ModelError> {
        let local = self.local::<N>(mentions, 0);
        let prior = F::prior([Num(1.0); N]);
        let (support, ln_norm) = (support_of::<F, N>(), constant_norm(&prior, N));
        let is_flat = prior.is_flat();
        drop(prior);
        let places = local.places();
        let (u, v, n) = self.lay_out(decl, len, places, support, is_flat)?;
        let op = ParameterOp::<F, N, M> { local, u, v, n, ln_norm, f: PhantomData };
        self.model.priors.push(Box::new(op));
        Ok(())
    }

    /// First unknown and first value of a parameter, and how many it has.
    fn lay_out(
        &mut self,
        decl: Decl,
        len: Len,
        mentions: Vec<usize>,
        support: Support,
        is_flat: bool,
    ) -> Result<(usize, usize, usize), ModelError> {
        let labels = match len {
            Len::Each(column) => Some(self.labels(column, &format!("param {}", decl.name))?),
            _ => None,
        };
        let n = match (len, &labels) {
            (Len::Many(n), _) => n,
            (_, Some(labels)) => labels.names.len(),
            _ => 1,
        };
        let (u, v) = (self.unknowns(n), self.values(n));
        if is_flat {
            self.flat.extend((0..n).map(|i| (v + i, u + i)));
        }
        let kind = if matches!(len, Len::One) { Kind::Scalar } else { Kind::Vector };
        let names = labels.as_ref().map(|labels| labels.names.clone()).unwrap_or_default();
        let source = match labels {
            Some(labels) => Source::Each { v, labels },
            None => Source::Scalars { v, len: n },
        };
        self.names.push((self.full_name(&decl.name), source));
        self.push_parameter(&decl, n, kind, names, support, v);
        if self.prefix.is_none() {
            self.state("param", decl);
        }
        self.model.prior_entries.push(PriorEntry { u: u..u + n, v, len: n, mentions });
        Ok((u, v, n))
    }

    /// The labels of a column; none without data.
    fn labels(&self, column: &'static str, who: &str) -> Result<Arc<Labels>, ModelError> {
        let (names, of_row) = match self.data {
            Some(data) => data.labels(column, who)?,
            None => (vec![], vec![]),
        };
        Ok(Arc::new(Labels { column, names, of_row }))
    }

    /// `sigma`, or `field.sigma` of a hyperparameter.
    fn full_name(&self, name: &str) -> String {
        self.prefix.map_or_else(|| name.to_owned(), |prefix| format!("{prefix}.{name}"))
    }

    fn push_parameter(
        &mut self,
        decl: &Decl,
        len: usize,
        kind: Kind,
        labels: Vec<String>,
        support: Support,
        v: usize,
    ) {
        self.model.parameters.push(Parameter {
            name: self.full_name(&decl.name),
            unit: decl.unit.clone().into(),
            len,
            kind,
            labels,
            prior: decl.text.clone().into(),
            support,
            position: Position::Values(v),
        });
    }

    /// `param name(n) [unit] ~ prior;`, the prior one of each number or of the whole. M1 is N + 1, M2 is N + 2.
    ///
    /// # Errors
    /// A prior of the whole that is of another length or no density.
    pub fn vector<F: VectorFn<N>, const N: usize, const M1: usize, const M2: usize>(
        &mut self,
        decl: Decl,
        n: usize,
        mentions: &[&str],
    ) -> Result<(), ModelError> {
        if is_whole(&F::prior([Num(1.0); N])) {
            self.sequence::<Known<F>, N, M2>(decl, n, mentions)
        } else {
            self.param::<Known<F>, N, M1>(decl, Len::Many(n), mentions)
        }
    }

    /// A vector with a prior of all of its numbers.
    fn sequence<F: SequenceFn<N>, const N: usize, const M: usize>(
        &mut self,
        decl: Decl,
        n: usize,
        mentions: &[&str],
    ) -> Result<(), ModelError> {
        let local = self.local::<N>(mentions, 0);
        let prior = F::sequence([Num(1.0); N]);
        let (parameter, expected) = (decl.name.clone().into(), prior.length(n));
        if n < expected && expected == 2 {
            return Err(ModelError::TooShort { parameter, len: n });
        }
        if n != expected {
            return Err(ModelError::Length { parameter, len: n, expected });
        }
        if N == 0 && !prior.ln_norm(n).0.is_finite() {
            return Err(ModelError::NoDensity { parameter, prior: decl.text.into() });
        }
        let (n_unknowns, n_carry) = (prior.n_unknowns(n), prior.n_carry(n).max(1));
        let support = prior.support();
        drop(prior);
        let (u, v) = (self.unknowns(n_unknowns), self.values(n));
        let mentions = local.places();
        let entry = PriorEntry { u: u..u + n_unknowns, v, len: n, mentions };
        self.model.prior_entries.push(entry);
        let work = self.n_work;
        self.n_work += (n + 1) * n_carry;
        self.push_parameter(&decl, n, Kind::Vector, vec![], support, v);
        self.names.push((decl.name.clone().into(), Source::Scalars { v, len: n }));
        self.state("param", decl);
        let op = SequenceOp::<F, N, M> { local, u, v, work, n, n_carry, f: PhantomData };
        self.model.priors.push(Box::new(op));
        Ok(())
    }

    /// `column name [unit] ~ prior;`: every empty cell is an unknown. M is N + 1.
    ///
    /// # Errors
    /// No such column, a cell that is no number, a prior whose bounds are unknown.
    pub fn imputed<F: PriorFn<N>, const N: usize, const M: usize>(
        &mut self,
        decl: Decl,
        mentions: &[&str],
    ) -> Result<(), ModelError> {
        let local = self.local::<N>(mentions, 0);
        let support = support_of::<F, N>();
        if support == Support::Between {
            return Err(ModelError::ImputedBounds { column: decl.name.into() });
        }
        let (mut cells, mut lines) = (vec![], vec![]);
        if let Some(data) = self.data {
            for row in 0..data.len() {
                let who = format!("column {}", decl.name);
                cells.push(data.number_or_empty(row, &decl.name, &who)?);
                lines.push(format!("line {}", data.line(row)));
            }
        }
        let v = self.values(cells.len());
        let is_missing = |i: &usize| cells[*i].is_nan();
        let missing: Vec<usize> = (0..cells.len()).filter(is_missing).collect();
        let seen: Vec<(usize, f64)> =
            (0..cells.len()).filter(|i| !is_missing(i)).map(|i| (i, cells[i])).collect();
        self.model.constants.extend(seen.iter().map(|(i, x)| (v + i, *x)));
        let u = self.unknowns(missing.len());
        let labels = missing.iter().map(|i| lines[*i].clone()).collect();
        self.push_parameter(&decl, missing.len(), Kind::Vector, labels, support, v);
        if let Some(parameter) = self.model.parameters.last_mut() {
            parameter.position = Position::Cells { v, rows: missing.clone() };
        }
        let n = missing.len();
        let entry = PriorEntry { u: u..u + n, v, len: cells.len(), mentions: local.places() };
        self.model.prior_entries.push(entry);
        self.names.push((decl.name.clone().into(), Source::Cells { v }));
        self.state("column", decl);
        let op = ImputedOp::<F, N, M> { local, u, v, missing, seen, f: PhantomData };
        self.model.priors.push(Box::new(op));
        Ok(())
    }

    /// Everything is declared.
    pub(super) fn finish(mut self) -> Result<Model, ModelError> {
        self.apply_effects()?;
        self.lay_out_lets()?;
        self.model.layout = [self.n_u, self.n_v, self.n_work];
        if let Some(data) = self.data {
            self.model.check(data)?;
        }
        self.model.hooks = self.hooks;
        Ok(self.model)
    }
}

/// Whether a prior is one of the whole vector.
fn is_whole<T: Vector<Num<f64>>>(_: &T) -> bool {
    T::IS_WHOLE
}

/// The support of a prior; that of one whose bounds move with what it mentions is only known while it runs.
fn support_of<F: PriorFn<N>, const N: usize>() -> Support {
    let support = |x: f64| F::prior([Num(x); N]).support();
    if support(1.0) == support(0.5) { support(1.0) } else { Support::Between }
}

/// The normaliser of a prior that mentions nothing: computed once.
fn constant_norm(prior: &impl Dist<Num<f64>>, n_mentioned: usize) -> f64 {
    if n_mentioned == 0 { prior.ln_norm().0 } else { 0.0 }
}
