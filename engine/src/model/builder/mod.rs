//! What the macro calls, with one call for each statement. It gives every unknown and value its
//! place, and makes the operations.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::manifold::Basis;
use crate::model::discrepancy::RowError;
use crate::model::error::ModelError;
use crate::model::expression::AnyPredictor;
use crate::model::laid_out::{Hooks, Model};
use crate::table::Measurements;

mod effects;
mod fields;
mod lets;
mod observes;
mod operators;
mod params;

pub use operators::Operation;

/// How many numbers a parameter has.
#[derive(Clone, Copy, Debug)]
pub enum Len {
    /// `param sigma`
    One,
    /// `param w(3)`
    Many(usize),
    /// `param b(operator)`: one for each label
    Each(&'static str),
}

/// What a likelihood or a `let` mentions: names of numbers, and of the `let`s through which it
/// depends on them.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// Parameters, fields, labelled parameters, linear predictors, imputed columns.
    pub numbers: &'static [&'static str],
    /// `let`s.
    pub lets: &'static [&'static str],
    /// Whether a column of the row is read.
    pub reads_row: bool,
}

/// `in LOW..HIGH` or `within LOW..HIGH` of a field.
#[derive(Clone, Copy, Debug)]
pub struct Range {
    /// Its ends, if there is one.
    pub ends: Option<(f64, f64)>,
    /// Whether the field's sum is bent into it.
    pub is_within: bool,
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
    /// This many numbers, from `v` on.
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
    Linear(Linear),
    /// A field, or the first of one for each label.
    Field {
        field: usize,
        labels: Option<Arc<Labels>>,
    },
    Let,
}

/// How a linear predictor is declared.
#[derive(Clone, Debug)]
enum Linear {
    /// `linear(row.a, row.b; beta)`
    Columns { beta: &'static str, columns: Vec<&'static str> },
    /// An expression of these parameters.
    Written { numbers: &'static [&'static str], factors: AnyPredictor },
    /// Numbers of the operator number `.0`.
    Operator(usize),
}

/// Lays a model out on its data.
pub struct Builder<'a> {
    basis: Option<&'a Basis>,
    data: Option<&'a Measurements>,
    /// The vertices that rows are at, ascending.
    probes: Vec<u32>,
    names: Vec<(String, Source)>,
    effects: Vec<effects::Effect>,
    /// Names that get an offset although no effect acts on them.
    offsets_on: Vec<String>,
    /// Share and sd of outliers that are added to every `observe`.
    outliers: Option<(f64, f64)>,
    /// Further errors that are to be added. They move to `row_errors` when their sds have places.
    further_errors: Vec<RowError>,
    /// Names of `observe`s whose rows have a further error, where its sd is, and the `let` that is
    /// ln of a factor of it.
    row_errors: Vec<(String, usize, Option<String>)>,
    /// First offset of (observe, field or let).
    hooks: Hooks,
    /// First value of (observe, linear predictor).
    predictors: BTreeMap<(&'static str, &'static str), usize>,
    operators: Vec<operators::Declared>,
    /// Operators at the rows that are known so far.
    over: Vec<operators::Waiting>,
    /// (`let`, observe that depends on it)
    seen: BTreeSet<(&'static str, &'static str)>,
    lets: Vec<lets::Declared>,
    /// Values whose prior is flat, each with its unknown. In `mentions`: how often expressions
    /// mention a value.
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
    /// A builder for an empty `model`. Without `data` no measurement is laid out; this is enough to
    /// show a model.
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
            further_errors: vec![],
            row_errors: vec![],
            hooks: Hooks::new(),
            predictors: BTreeMap::new(),
            operators: vec![],
            over: vec![],
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

    /// Asks for an offset wherever a likelihood depends on one of these names. It is zero unless it
    /// is set.
    pub(super) fn want_offsets(&mut self, on: impl IntoIterator<Item = String>) {
        self.offsets_on.extend(on);
    }

    /// Adds outliers to every `observe` that follows: this share of its measurements has a further
    /// error of this sd.
    pub(super) fn add_outliers(&mut self, share: f64, sd: f64) {
        self.outliers = Some((share, sd));
        self.model.outliers = self.outliers;
    }

    /// Adds a further error to every measurement of some `observe`s, which must follow.
    pub(super) fn add_row_error(&mut self, error: &RowError) {
        self.further_errors.push(error.clone());
        self.model.row_errors.extend(error.of_observes());
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

    /// Where the numbers behind these names live. If a name has one for each label, it is that of
    /// number `label`.
    fn local(&mut self, names: &[&str], label: usize) -> Vec<u32> {
        let mut at = vec![];
        for name in names {
            let (v, len) = match *self.source(name) {
                Source::Scalars { v, len } => (v, len),
                Source::Each { v, .. } => (v + label, 1),
                _ => unreachable!("the macro hands over parameters here"),
            };
            for v in v..v + len {
                *self.mentions.entry(v).or_default() += 1;
                at.push(v as u32);
            }
        }
        at
    }

    /// Finishes the model: everything is declared.
    pub(super) fn finish(mut self) -> Result<Model, ModelError> {
        self.apply_effects()?;
        self.lay_out_lets()?;
        self.lay_out_operators()?;
        self.model.layout = [self.n_u, self.n_v, self.n_work];
        if let Some(data) = self.data {
            self.model.check(data)?;
        }
        self.model.hooks = self.hooks;
        Ok(self.model)
    }
}
