//! What the macro calls, one call per statement: lays out unknowns and values, and makes operations.

use std::collections::{BTreeMap, BTreeSet};
use std::marker::PhantomData;

use crate::dist::{Dist, Sequence, Support, Vector};
use crate::manifold::Basis;
use crate::model::error::ModelError;
use crate::model::form::Form;
use crate::model::linear::Linear;
use crate::model::maps::{LetFn, Map, MapAt, MapFn, Source as MapSource};
use crate::model::model::{Kind, Model, Parameter, Position, PriorEntry, Statement};
use crate::model::parameter::{
    Known, NormalOp, ParameterOp, PriorFn, SequenceFn, SequenceOp, VectorFn,
};
use crate::model::scope::{Local, Scope};
use crate::model::units::{Decl, check_units};
use crate::table::Measurements;
use crate::table::SOURCE;

mod fields;
mod lets;
mod observes;
pub use observes::outlying;

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

/// What a name stands for in a row.
#[derive(Clone, Debug)]
enum Source {
    Scalars(usize),
    Each { v: usize, index: Vec<usize> },
    Linear { beta: &'static str, columns: Vec<&'static str> },
    Field(usize),
    Let,
}

struct Effect {
    name: String,
    on: Vec<String>,
    design: EffectDesign,
    beta: usize,
}

/// What an effect multiplies its coefficients by.
enum EffectDesign {
    /// `linear(row.a, row.b)`: columns as they are, every cell filled in.
    Columns(Vec<&'static str>),
    /// Anything else.
    Form(Form),
}

/// Lays a model out on its data.
pub struct Builder<'a> {
    basis: Option<&'a Basis>,
    data: Option<&'a Measurements>,
    probes: Vec<u32>,
    names: Vec<(&'static str, Source)>,
    effects: Vec<Effect>,
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
    /// The field whose hyperparameters are being declared.
    field: Option<Decl>,
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
    /// For a model called `name`. Without `data` no measurement is laid out: enough to show a model.
    pub(super) fn new(
        name: &'static str,
        doc: &'static str,
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
            field: None,
            n_u: 0,
            n_v: 1, // v[0] is zero
            n_work: 0,
            model: Model::empty(name, doc),
        }
    }

    /// Asks for an offset, zero by itself, wherever a likelihood depends on one of these names.
    pub(super) fn want_offsets(&mut self, on: impl IntoIterator<Item = String>) {
        self.offsets_on.extend(on);
    }

    /// Lets this share of the measurements of every `observe` to come have a further error of this sd.
    pub(super) fn add_outliers(&mut self, share: f64, sd: f64) {
        self.outliers = Some((share, sd));
    }

    fn values(&mut self, n: usize) -> usize {
        self.n_v += n;
        self.n_v - n
    }

    fn unknowns(&mut self, n: usize) -> usize {
        self.n_u += n;
        self.n_u - n
    }

    #[allow(clippy::expect_used, reason = "the compiler has resolved every name in an expression")]
    fn source(&self, name: &str) -> &Source {
        let found = self.names.iter().rev().find(|(n, _)| *n == name);
        &found.expect("names are declared before use").1
    }

    fn local<const N: usize, const W: usize>(&mut self, scope: &Scope) -> Local<N, W> {
        let (at, slot) = self.scalars(scope);
        let is_its_own = |i, j| f64::from(u8::from(slot.get(j) == Some(&(i as u32))));
        Local {
            at: std::array::from_fn(|i| at[i]),
            unit: std::array::from_fn(|i| std::array::from_fn(|j| is_its_own(i, j))),
            slot: std::array::from_fn(|j| slot.get(j).copied().unwrap_or(0)),
            used: slot.len(),
        }
    }

    /// Where a scope's scalars live in `v`, and which of them the expression mentions.
    fn scalars(&mut self, scope: &Scope) -> (Vec<u32>, Vec<u32>) {
        let (mut at, mut slot) = (vec![], vec![]);
        for (i, name) in scope.names.iter().enumerate() {
            let Source::Scalars(v) = *self.source(name) else {
                unreachable!("the macro puts only parameters in this scope")
            };
            for e in 0..scope.lens[i] {
                if scope.mentions(i) {
                    slot.push(at.len() as u32);
                    *self.mentions.entry(v + e).or_default() += 1;
                }
                at.push((v + e) as u32);
            }
        }
        (at, slot)
    }

    /// `param name(len) [unit] ~ prior;`, or a hyperparameter between `field` and `field_end`.
    ///
    /// # Errors
    /// A label column that the data lack.
    pub fn param<F: PriorFn + 'static, const N: usize, const W: usize>(
        &mut self,
        _: F,
        decl: Decl,
        len: Len,
        scope: &Scope,
    ) -> Result<(), ModelError> {
        let local = self.local::<N, W>(scope);
        let probe = F::dist::<f64>(&[1.0; N]);
        let is_fixed = probe.support() == F::dist::<f64>(&[0.5; N]).support();
        let support = if is_fixed { probe.support() } else { Support::Between };
        let ln_norm = if W == 1 { probe.ln_norm() } else { 0.0 };
        let (u, v, n) = self.lay_out(decl, len, local.mentioned(), support, probe.is_flat())?;
        let op = ParameterOp::<F, N, W> { local, u, v, n, ln_norm, f: PhantomData };
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
        let (levels, index) = match (len, self.data) {
            (Len::Each(column), Some(data)) => {
                data.labels(column, &format!("param {}", decl.name))?
            }
            _ => (vec![], vec![]),
        };
        let n = match len {
            Len::One => 1,
            Len::Many(n) => n,
            Len::Each(_) => levels.len(),
        };
        let (u, v) = (self.unknowns(n), self.values(n));
        if is_flat {
            self.flat.insert(v, u);
        }
        let kind = if matches!(len, Len::One) { Kind::Scalar } else { Kind::Vector };
        self.push_parameter(decl, n, kind, levels, support, v);
        let source = match len {
            Len::Each(_) => Source::Each { v, index },
            _ => Source::Scalars(v),
        };
        self.names.push((decl.name, source));
        if self.field.is_none() {
            self.state("param", decl, None);
        }
        self.model.prior_entries.push(PriorEntry { u: u..u + n, v, len: n, mentions });
        Ok((u, v, n))
    }

    fn push_parameter(
        &mut self,
        decl: Decl,
        len: usize,
        kind: Kind,
        labels: Vec<String>,
        support: Support,
        v: usize,
    ) {
        let name = match &self.field {
            Some(field) => format!("{}.{}", field.name, decl.name),
            None => decl.name.into(),
        };
        self.model.parameters.push(Parameter {
            name,
            unit: decl.unit.into(),
            len,
            kind,
            labels,
            prior: decl.text.into(),
            support,
            position: Position::Values(v),
        });
    }

    /// `param name(n) [unit] ~ prior;`, W1 derivatives for a prior of each number, W2 for one of all.
    ///
    /// # Errors
    /// A prior of all that is of another length or no density.
    pub fn vector<F: VectorFn + 'static, const N: usize, const W1: usize, const W2: usize>(
        &mut self,
        _: F,
        decl: Decl,
        n: usize,
        scope: &Scope,
    ) -> Result<(), ModelError> {
        if is_whole(&F::prior::<f64>(&[1.0; N])) {
            self.sequence::<Known<F>, N, W2>(decl, n, scope)
        } else {
            self.param::<Known<F>, N, W1>(Known::new(), decl, Len::Many(n), scope)
        }
    }

    /// A vector with a prior of all of its numbers.
    fn sequence<F: SequenceFn + 'static, const N: usize, const W: usize>(
        &mut self,
        decl: Decl,
        n: usize,
        scope: &Scope,
    ) -> Result<(), ModelError> {
        let local = self.local::<N, W>(scope);
        let prior = F::sequence::<f64>(&[1.0; N]);
        let (parameter, expected) = (decl.name.into(), prior.length(n));
        if n < expected && expected == 2 {
            return Err(ModelError::TooShort { parameter, len: n });
        }
        if n != expected {
            return Err(ModelError::Length { parameter, len: n, expected });
        }
        if local.used == 0 && !prior.ln_norm(n).is_finite() {
            return Err(ModelError::NoDensity { parameter, prior: decl.text.into() });
        }
        let (n_unknowns, n_carry) = (prior.n_unknowns(n), prior.n_carry(n).max(1));
        let (u, v) = (self.unknowns(n_unknowns), self.values(n));
        let mentions = local.mentioned();
        let entry = PriorEntry { u: u..u + n_unknowns, v, len: n, mentions };
        self.model.prior_entries.push(entry);
        let work = self.n_work;
        self.n_work += (n + 1) * n_carry;
        self.push_parameter(decl, n, Kind::Vector, vec![], prior.support(), v);
        self.names.push((decl.name, Source::Scalars(v)));
        self.state("param", decl, None);
        let op = SequenceOp::<F, N, W> { local, u, v, work, n, n_carry, f: PhantomData };
        self.model.priors.push(Box::new(op));
        Ok(())
    }

    fn state(&mut self, keyword: &'static str, decl: Decl, range: Option<(f64, f64)>) {
        self.model.statements.push(Statement { keyword, decl, range });
    }

    /// `let name(row) [unit] in range = expr;`
    pub fn value<F: LetFn + 'static, const N: usize>(
        &mut self,
        _: F,
        decl: Decl,
        range: Option<(f64, f64)>,
        scope: &Scope,
        reads_row: bool,
    ) {
        self.map(decl, range, scope, reads_row, || Box::new(MapAt::<F, N>::new()));
    }

    /// Keeps a `let` for what is reported of it, and as a map over the vertices if it depends on parameters
    /// and fields alone.
    fn map(
        &mut self,
        decl: Decl,
        range: Option<(f64, f64)>,
        scope: &Scope,
        reads_row: bool,
        make: fn() -> Box<dyn MapFn>,
    ) {
        self.state("let", decl, range);
        let mut sources = vec![];
        let mut is_map = !reads_row;
        for (i, name) in scope.names.iter().enumerate() {
            for e in 0..scope.lens[i] {
                sources.push(match self.source(name) {
                    _ if !scope.mentions(i) => MapSource::Value(0),
                    Source::Scalars(v) => MapSource::Value(v + e),
                    Source::Field(field) => MapSource::Field(*field),
                    Source::Let => {
                        is_map &= self.model.maps.iter().any(|m| m.name == *name);
                        MapSource::Value(0)
                    }
                    Source::Each { .. } | Source::Linear { .. } => {
                        is_map = false;
                        MapSource::Value(0)
                    }
                });
            }
        }
        self.declare_let(decl, scope, reads_row, make);
        self.names.push((decl.name, Source::Let));
        if is_map {
            let (unit, at) = (decl.unit.into(), make());
            self.model.maps.push(Map { name: decl.name, unit, range, sources, at });
        }
    }

    /// `column name [unit];`
    pub fn column(&mut self, decl: Decl) {
        self.state("column", decl, None);
    }

    /// `let name(row) = linear(row.a, row.b; beta);`
    pub fn linear(&mut self, decl: Decl, columns: &[&'static str], beta: &'static str) {
        self.state("let", decl, None);
        self.names.push((decl.name, Source::Linear { beta, columns: columns.to_vec() }));
        self.declare_linear(decl);
    }

    /// `effect name on a, b [unit] = linear(row.c) ~ prior;`
    ///
    /// # Errors
    /// Those of [`Builder::param`].
    pub fn effect<F: PriorFn + 'static, const N: usize, const W: usize>(
        &mut self,
        f: F,
        decl: Decl,
        prior: &'static str,
        on: &[&'static str],
        columns: &[&'static str],
        scope: &Scope,
    ) -> Result<(), ModelError> {
        self.coefficients::<F, N, W>(f, decl, prior, columns.len(), scope)?;
        self.push_effect(decl.name, on, EffectDesign::Columns(columns.to_vec()), columns.len());
        Ok(())
    }

    /// `effect name on a, b [unit] = scaled(row.c, 1.0, 2.0) ~ prior;`, and the other forms.
    ///
    /// # Errors
    /// Those of [`Builder::param`], and a column that the table lacks.
    pub fn formed_effect<F: PriorFn + 'static, const N: usize, const W: usize>(
        &mut self,
        f: F,
        decl: Decl,
        prior: &'static str,
        on: &[&'static str],
        form: Form,
        scope: &Scope,
    ) -> Result<(), ModelError> {
        let n = self.n_coefficients(decl.name, &form)?;
        self.coefficients::<F, N, W>(f, decl, prior, n, scope)?;
        self.label_last(&form);
        self.push_effect(decl.name, on, EffectDesign::Form(form), n);
        Ok(())
    }

    /// An effect that is in no model file: coefficients `~ Normal(0, sd)`.
    ///
    /// # Errors
    /// A column that the table lacks.
    pub(super) fn added_effect(
        &mut self,
        decl: Decl,
        on: &[String],
        form: &Form,
        sd: f64,
    ) -> Result<(), ModelError> {
        let n = self.n_coefficients(decl.name, form)?;
        let (u, v) = (self.unknowns(n), self.values(n));
        let prior = decl.text.rsplit_once('~').map_or("", |(_, prior)| prior.trim_start());
        let named = Decl { text: prior, ..decl };
        self.push_parameter(named, n, Kind::Vector, vec![], Support::Real, v);
        self.state("effect", decl, None);
        self.model.prior_entries.push(PriorEntry { u: u..u + n, v, len: n, mentions: vec![] });
        self.model.priors.push(Box::new(NormalOp { u, v, n, sd }));
        self.label_last(form);
        let on: Vec<&str> = on.iter().map(String::as_str).collect();
        self.push_effect(decl.name, &on, EffectDesign::Form(form.clone()), n);
        Ok(())
    }

    fn coefficients<F: PriorFn + 'static, const N: usize, const W: usize>(
        &mut self,
        f: F,
        decl: Decl,
        prior: &'static str,
        n: usize,
        scope: &Scope,
    ) -> Result<(), ModelError> {
        self.param::<F, N, W>(f, Decl { text: prior, ..decl }, Len::Many(n), scope)?;
        if let Some(statement) = self.model.statements.last_mut() {
            *statement = Statement { keyword: "effect", decl, range: None };
        }
        Ok(())
    }

    fn push_effect(&mut self, name: &str, on: &[&str], design: EffectDesign, n: usize) {
        let on = on.iter().map(ToString::to_string).collect();
        self.effects.push(Effect { name: name.into(), on, design, beta: self.n_v - n });
    }

    fn n_coefficients(&self, effect: &str, form: &Form) -> Result<usize, ModelError> {
        let Some(data) = self.data else { return Ok(form.n_modes().max(1)) };
        check_probes(effect, form, data)?;
        if let Some(column) = form.column() {
            data.require(column, &format!("effect {effect}"))?;
        }
        Ok(form.design(data).1)
    }

    /// Names the last parameter's numbers after the form's labels.
    fn label_last(&mut self, form: &Form) {
        if let (Some(data), Some(parameter)) = (self.data, self.model.parameters.last_mut()) {
            parameter.labels = form.labels(data);
        }
    }

    /// Everything is declared.
    pub(super) fn finish(mut self) -> Result<Model, ModelError> {
        let forms = self.effects.iter().filter_map(|effect| match &effect.design {
            EffectDesign::Form(form) => Some(form.n_modes()),
            EffectDesign::Columns(_) => None,
        });
        self.model.effect_modes = forms.max().unwrap_or(0);
        self.apply_effects()?;
        self.lay_out_lets()?;
        check_units(&self.model)?;
        self.model.layout = [self.n_u, self.n_v, self.n_work];
        if let Some(data) = self.data {
            self.model.check(data)?;
        }
        self.model.hooks = self.hooks;
        Ok(self.model)
    }

    /// Makes every effect's design act on the offsets of its targets.
    fn apply_effects(&mut self) -> Result<(), ModelError> {
        for effect in std::mem::take(&mut self.effects) {
            let mut hit = BTreeSet::new();
            for i in 0..self.model.observes.len() {
                let (observe, rows) =
                    (self.model.observes[i].name, self.model.observes[i].rows.clone());
                let mut out = vec![];
                for ((_, target), at) in self.hooks.iter().filter(|((o, _), _)| *o == observe) {
                    if effect.on.iter().any(|on| on == target) {
                        hit.insert(*target);
                        out.push(*at);
                    }
                }
                if !out.is_empty() {
                    let linear = self.effect_rows(&effect, &rows, out)?;
                    self.model.linear.push(linear);
                }
            }
            if let Some(target) = effect.on.iter().find(|on| !hit.contains(on.as_str())) {
                let (effect, target) = (effect.name, target.clone());
                return Err(ModelError::NoTarget { effect, target });
            }
        }
        Ok(())
    }

    /// An effect's design at the rows of one `observe`.
    fn effect_rows(
        &self,
        effect: &Effect,
        rows: &[usize],
        out: Vec<usize>,
    ) -> Result<Linear, ModelError> {
        match (&effect.design, self.data) {
            (EffectDesign::Columns(columns), _) => {
                let names: Vec<String> = columns.iter().map(ToString::to_string).collect();
                self.design(rows, &names, effect.beta, out, true)
            }
            (EffectDesign::Form(form), Some(data)) => {
                let (z, n) = form.design(data);
                let z = rows.iter().flat_map(|row| z[row * n..][..n].iter().copied()).collect();
                Ok(Linear { beta: effect.beta, n, z, out, rows: rows.len(), add: true })
            }
            (EffectDesign::Form(_), None) => {
                Ok(Linear { beta: effect.beta, n: 1, z: vec![], out, rows: 0, add: true })
            }
        }
    }
}

/// Whether a prior is one of the whole vector.
fn is_whole<T: Vector<f64>>(_: &T) -> bool {
    T::IS_WHOLE
}

/// Complains unless the modes that a form needs are known at the rows.
fn check_probes(effect: &str, form: &Form, data: &Measurements) -> Result<(), ModelError> {
    let k = form.n_modes();
    if k == 0 {
        return Ok(());
    }
    let field = effect.to_owned();
    let Some(probes) = data.probes() else { return Err(ModelError::NoBasis { field }) };
    if matches!(form, Form::Path { .. }) {
        data.require(SOURCE, &format!("effect {effect}"))?;
    }
    let available = probes.n_modes();
    if k > available { Err(ModelError::TooManyModes { field, k, available }) } else { Ok(()) }
}
