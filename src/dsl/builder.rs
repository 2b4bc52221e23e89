//! What the macro calls, one call per statement: lays out unknowns and values, and makes operations.

use std::collections::{BTreeMap, BTreeSet};
use std::marker::PhantomData;

use super::data::Measurements;
use super::error::ModelError;
use super::gp::{Collapsed, Field, KernelFn, SpectrumAt, Term, padded};
use super::linear::Linear;
use super::maps::{LetFn, Map, MapAt, Source as MapSource};
use super::model::{FieldEntry, Kind, Model, Observe, Parameter, Position, PriorEntry, Statement};
use super::parameter::{ParameterOp, PriorFn, SequenceFn, SequenceOp};
use super::rows::{Columns, Place, RowFn, Rows};
use super::scalar::{Scalar, ScalarAt, ScalarFn};
use super::scope::{Local, Scope};
use super::units::{Decl, check_units, require, unit_of};
use crate::dist::{Dist, Sequence, Support};
use crate::likelihood::Observation;
use crate::manifold::Basis;

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
    name: &'static str,
    on: Vec<&'static str>,
    columns: Vec<&'static str>,
    beta: usize,
}

/// √λ of the first modes, the probes' rows of them, and the constant mode's value if it is constant.
type Modes = (Vec<f64>, Vec<f64>, Option<f64>);

/// Lays a model out on its data.
pub struct Builder<'a> {
    basis: Option<&'a Basis>,
    data: Option<&'a Measurements>,
    probes: Vec<u32>,
    names: Vec<(&'static str, Source)>,
    effects: Vec<Effect>,
    /// First offset of (observe, field or let).
    hooks: BTreeMap<(&'static str, &'static str), usize>,
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
            hooks: BTreeMap::new(),
            flat: BTreeMap::new(),
            mentions: BTreeMap::new(),
            field: None,
            n_u: 0,
            n_v: 1, // v[0] is zero
            n_work: 0,
            model: Model::empty(name, doc),
        }
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
        Local {
            at: std::array::from_fn(|i| at[i]),
            slot: std::array::from_fn(|j| slot.get(j).copied().unwrap_or(0)),
            used: slot.len(),
        }
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
        let mentions = local.mentioned();
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
        let probe = F::dist::<f64>(&[1.0; N]);
        if probe.is_flat() {
            self.flat.insert(v, u);
        }
        let ln_norm = if W == 1 { probe.ln_norm() } else { 0.0 };
        let kind = if matches!(len, Len::One) { Kind::Scalar } else { Kind::Vector };
        self.push_parameter(decl, n, kind, levels, probe.support(), v);
        let source = match len {
            Len::Each(_) => Source::Each { v, index },
            _ => Source::Scalars(v),
        };
        self.names.push((decl.name, source));
        if self.field.is_none() {
            self.state("param", decl, None);
        }
        self.model.prior_entries.push(PriorEntry { u: u..u + n, v, len: n, mentions });
        self.model.priors.push(Box::new(ParameterOp::<F, N, W> {
            local,
            u,
            v,
            n,
            ln_norm,
            f: PhantomData,
        }));
        Ok(())
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

    /// `param name(n) [unit] ~ prior;` of a vector whose numbers constrain each other.
    ///
    /// # Errors
    /// Fewer than two numbers.
    pub fn sequence<F: SequenceFn + 'static, const N: usize, const W: usize>(
        &mut self,
        _: F,
        decl: Decl,
        n: usize,
        scope: &Scope,
    ) -> Result<(), ModelError> {
        if n < 2 {
            return Err(ModelError::TooShort { parameter: decl.name.into(), len: n });
        }
        let local = self.local::<N, W>(scope);
        let prior = F::sequence::<f64>(&[1.0; N]);
        let n_unknowns = prior.n_unknowns(n);
        let (u, v) = (self.unknowns(n_unknowns), self.values(n));
        let mentions = local.mentioned();
        let entry = PriorEntry { u: u..u + n_unknowns, v, len: n, mentions };
        self.model.prior_entries.push(entry);
        let work = self.n_work;
        self.n_work += n;
        self.push_parameter(decl, n, Kind::Vector, vec![], prior.support(), v);
        self.names.push((decl.name, Source::Scalars(v)));
        self.state("param", decl, None);
        let op = SequenceOp::<F, N, W> { local, u, v, work, n, f: PhantomData };
        self.model.priors.push(Box::new(op));
        Ok(())
    }

    fn state(&mut self, keyword: &'static str, decl: Decl, range: Option<(f64, f64)>) {
        self.model.statements.push(Statement { keyword, decl, range });
    }

    /// `field name(x) [unit] in range = …`: its hyperparameters follow, then [`Builder::field_end`].
    pub fn field(&mut self, decl: Decl, range: Option<(f64, f64)>) {
        self.state("field", decl, range);
        self.field = Some(decl);
    }

    /// A field's mean or amplitude.
    pub fn scalar<F: ScalarFn + 'static, const N: usize, const W: usize>(
        &mut self,
        _: F,
        scope: &Scope,
    ) -> ScalarHandle {
        ScalarHandle(Box::new(ScalarAt::<F, N, W> { local: self.local(scope), f: PhantomData }))
    }

    /// One `amplitude * gp(kernel, K = …)`.
    pub fn term<F: KernelFn + 'static, const N: usize, const W: usize>(
        &mut self,
        amplitude: ScalarHandle,
        _: F,
        k: usize,
        scope: &Scope,
    ) -> Term {
        let spectrum = Box::new(SpectrumAt::<F, N, W> { local: self.local(scope), f: PhantomData });
        Term { amplitude: amplitude.0, spectrum, k, eta: 0, work: 0 }
    }

    /// The end of a field: `hyper` are the names declared since [`Builder::field`], `mean` the text of
    /// its mean.
    ///
    /// # Errors
    /// No surface, or fewer modes than K.
    pub fn field_end(
        &mut self,
        hyper: &[&str],
        mean_text: &str,
        mean: ScalarHandle,
        mut terms: Vec<Term>,
    ) -> Result<(), ModelError> {
        let Some(decl) = self.field.take() else { return Ok(()) };
        let n_modes = terms.iter().map(|t| t.k).max().unwrap_or(0);
        let (frequency, rows, phi0) = self.modes(decl.name, n_modes)?;
        let range = self.model.statements.last().and_then(|s| s.range);
        let collapsed = self.collapse(hyper, mean_text, range, phi0);
        let first = usize::from(collapsed.is_some());

        let (k, n) = (n_modes - first, self.probes.len());
        let stride = padded(k);
        let mut used = 0;
        for (i, term) in terms.iter_mut().enumerate() {
            let suffix = if i == 0 { String::new() } else { (i + 1).to_string() };
            self.model.parameters.push(Parameter {
                name: format!("{}.eta{suffix}", decl.name),
                unit: "1".into(),
                len: term.k,
                kind: Kind::Eta,
                labels: vec![],
                prior: "Normal(0.0, 1.0)".into(),
                support: Support::Real,
                position: Position::Eta {
                    u: self.n_u,
                    first,
                    field: self.model.fields.len(),
                    term: i,
                },
            });
            term.k -= first;
            term.eta = self.unknowns(term.k);
            term.work = used;
            used += term.k * (2 + term.spectrum.width());
        }
        let (theta, work) = (self.values(n), self.n_work);
        self.n_work += 2 * stride + used;
        let mut probes = vec![0.0; n * stride];
        for (to, from) in
            probes.chunks_exact_mut(stride.max(1)).zip(rows.chunks_exact(n_modes.max(1)))
        {
            to[..k].copy_from_slice(&from[first..]);
        }
        let hyper_names = self.names.len() - hyper.len();
        self.names.truncate(hyper_names);
        let mean = mean.0;
        let frequency = frequency[first..].to_vec();
        let op = Field { mean, terms, collapsed, k, work, theta, probes, stride, frequency };
        self.names.push((decl.name, Source::Field(self.model.fields.len())));
        self.model.fields.push(FieldEntry {
            name: decl.name,
            unit: decl.unit.into(),
            range,
            first,
            op,
        });
        Ok(())
    }

    /// The first `k` modes of the basis.
    fn modes(&self, field: &str, k: usize) -> Result<Modes, ModelError> {
        let Some(basis) = self.basis else {
            if self.data.is_some() {
                return Err(ModelError::NoBasis { field: field.into() });
            }
            return Ok((vec![0.0; k], vec![], Some(0.0)));
        };
        if k > basis.n_modes() {
            let available = basis.n_modes();
            return Err(ModelError::TooManyModes { field: field.into(), k, available });
        }
        let frequency = basis.eigenvalues[..k].iter().map(|l| l.max(0.0).sqrt()).collect();
        let rows = self.probes.iter().flat_map(|&p| basis.at(p as usize)[..k].iter().copied());
        Ok((frequency, rows.collect(), constant_mode(basis)))
    }

    /// Whether the mean is a flat hyperparameter that nothing else mentions: see [`super::gp`].
    fn collapse(
        &mut self,
        hyper: &[&str],
        mean: &str,
        range: Option<(f64, f64)>,
        phi0: Option<f64>,
    ) -> Option<Collapsed> {
        if !hyper.contains(&mean) {
            return None;
        }
        let Source::Scalars(v) = *self.source(mean) else { return None };
        let u = *self.flat.get(&v)?;
        if let Some((low, high)) = range {
            self.model.start.push((u, 0.5 * (low + high)));
        }
        let phi0 = phi0?;
        (self.mentions.get(&v) == Some(&1)).then_some(())?;
        let field = self.model.fields.len();
        for parameter in &mut self.model.parameters {
            if matches!(parameter.position, Position::Values(at) if at == v) {
                parameter.position = Position::CollapsedMean { field };
            }
        }
        Some(Collapsed { mean: v, phi0 })
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
        self.state("let", decl, range);
        self.names.push((decl.name, Source::Let));
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
        if is_map {
            let at = Box::new(MapAt::<F, N>::new());
            self.model.maps.push(Map {
                name: decl.name,
                unit: decl.unit.into(),
                range,
                sources,
                at,
            });
        }
    }

    /// `let name(row) = linear(row.a, row.b; beta);`
    pub fn linear(&mut self, decl: Decl, columns: &[&'static str], beta: &'static str) {
        self.state("let", decl, None);
        self.names.push((decl.name, Source::Linear { beta, columns: columns.to_vec() }));
    }

    /// `effect name on a, b [unit] = linear(row.c) ~ prior;`
    ///
    /// # Errors
    /// Those of [`Builder::param`].
    pub fn effect<F: PriorFn + 'static, const N: usize, const W: usize>(
        &mut self,
        f: F,
        decl: Decl,
        on: &[&'static str],
        columns: &[&'static str],
        scope: &Scope,
    ) -> Result<(), ModelError> {
        for target in on {
            if let Some(unit) = unit_of(&self.model, target) {
                require(&format!("effect {} on {target}", decl.name), &unit, decl.unit)?;
            }
        }
        self.param::<F, N, W>(f, decl, Len::Many(columns.len()), scope)?;
        if let Some(statement) = self.model.statements.last_mut() {
            statement.keyword = "effect";
        }
        let beta = self.n_v - columns.len();
        self.effects.push(Effect {
            name: decl.name,
            on: on.to_vec(),
            columns: columns.to_vec(),
            beta,
        });
        Ok(())
    }

    /// `density name = expr;`
    pub fn density<F: ScalarFn + 'static, const N: usize, const W: usize>(
        &mut self,
        _: F,
        decl: Decl,
        scope: &Scope,
    ) {
        self.state("density", decl, None);
        let local = self.local(scope);
        self.model.densities.push(Box::new(ScalarAt::<F, N, W> { local, f: PhantomData }));
    }

    /// `observe name(row): Y [unit] ~ likelihood;`
    ///
    /// # Errors
    /// No row of it, a missing column, a cell that does not fit.
    pub fn observe<F: RowFn + 'static, const N: usize, const W: usize>(
        &mut self,
        _: F,
        decl: Decl,
        scope: &Scope,
    ) -> Result<(), ModelError> {
        self.state("observe", decl, None);
        let (rows, y) = match self.data {
            Some(data) => read_rows::<F::Y>(data, decl.name)?,
            None => (vec![], vec![]),
        };
        let who = format!("observe {}", decl.name);
        let mut columns = vec![];
        for &row in &rows {
            let Some(data) = self.data else { break };
            columns.push(F::Columns::read(&mut |name| data.number(row, name, &who))?);
        }
        let place = self.place(decl.name, &rows, scope, W)?;
        let slot = std::array::from_fn(|j| place.slot[j]);
        self.model.observes.push(Observe {
            name: decl.name,
            unit: decl.unit.into(),
            columns: F::Y::COLUMNS,
            rows,
            op: Box::new(Rows::<F, N, W> { columns, y, slot, place }),
        });
        Ok(())
    }

    /// For each row, where in `v` each scalar that the likelihood mentions lives.
    fn place(
        &mut self,
        observe: &'static str,
        rows: &[usize],
        scope: &Scope,
        w: usize,
    ) -> Result<Place, ModelError> {
        let n = rows.len();
        let mut place = Place { index: vec![0; n * w], hook: vec![], slot: vec![], lets: vec![] };
        let (mut scalar, mut hooked) = (0, vec![]);
        for (i, &name) in scope.names.iter().enumerate() {
            let start = scalar;
            scalar += scope.lens[i];
            if !scope.mentions(i) {
                continue;
            }
            if i >= scope.first_let() {
                if self.acts(name) {
                    place.lets.push((start, self.hook(observe, name, n)));
                }
                continue;
            }
            let source = self.source(name).clone();
            let predictor = self.predictor(name, &source, rows)?;
            for e in 0..scope.lens[i] {
                let j = place.slot.len();
                place.slot.push((start + e) as u32);
                if matches!(source, Source::Field(_)) && self.acts(name) {
                    hooked.push((j, self.hook(observe, name, n)));
                }
                for (r, &row) in rows.iter().enumerate() {
                    place.index[r * w + j] = match &source {
                        Source::Scalars(v) => v + e,
                        Source::Each { v, index } => v + index[row],
                        Source::Field(field) => self.probe(*field, row),
                        Source::Linear { .. } => predictor + r,
                        Source::Let => unreachable!("lets come last in a scope"),
                    } as u32;
                }
            }
        }
        if !hooked.is_empty() {
            // an offset on a field's value needs no derivative of its own: it is the field's
            place.hook = vec![0; n * w];
        }
        for (j, at) in hooked {
            for r in 0..n {
                place.hook[r * w + j] = (at + r) as u32;
            }
        }
        Ok(place)
    }

    /// The value of field number `field` at the probe of `row`.
    fn probe(&self, field: usize, row: usize) -> usize {
        let vertex = self.data.and_then(|d| d.vertex(row)).unwrap_or(0);
        let probe = self.probes.binary_search(&vertex).unwrap_or(0);
        self.model.fields[field].op.theta + probe
    }

    /// Lays out a linear predictor's values for these rows; 0 for any other source.
    fn predictor(
        &mut self,
        name: &str,
        source: &Source,
        rows: &[usize],
    ) -> Result<usize, ModelError> {
        let Source::Linear { beta, columns } = source else { return Ok(0) };
        let wrong = |expected, got| ModelError::Coefficients {
            name: name.into(),
            beta: (*beta).into(),
            expected,
            got,
        };
        let declared = self.names.iter().rev().find(|(n, _)| n == beta);
        let Some((_, Source::Scalars(v))) = declared else { return Err(wrong(columns.len(), 0)) };
        let v = *v;
        let n_beta = self.model.parameters.iter().find(|p| p.name == *beta).map_or(0, |p| p.len);
        let out = self.values(rows.len());
        let alone = if columns.len() == 1 { n_beta } else { 1 };
        let names: Vec<String> = columns.iter().flat_map(|c| self.numbered(c, alone)).collect();
        let linear = self.design(rows, &names, v, vec![out], false)?;
        if linear.n != n_beta {
            return Err(wrong(linear.n, n_beta));
        }
        self.model.linear.push(linear);
        Ok(out)
    }

    /// A column, or all the numbered columns x1, x2, … of the table; the `expected` ones of these if it
    /// has neither.
    fn numbered(&self, name: &str, expected: usize) -> Vec<String> {
        let numbers = |n: usize| (1..=n).map(|i| format!("{name}{i}"));
        match self.data {
            Some(data) if data.has(name) => vec![name.into()],
            Some(data) if data.has(&format!("{name}1")) => {
                numbers(data.n_columns()).take_while(|n| data.has(n)).collect()
            }
            _ if expected > 1 => numbers(expected).collect(),
            _ => vec![name.into()],
        }
    }

    /// Design of the columns `names` at these rows.
    fn design(
        &self,
        rows: &[usize],
        names: &[String],
        beta: usize,
        out: Vec<usize>,
        add: bool,
    ) -> Result<Linear, ModelError> {
        let Some(data) = self.data else {
            return Ok(Linear { beta, n: names.len(), z: vec![], out, rows: 0, add });
        };
        let mut z = Vec::with_capacity(rows.len() * names.len());
        for &row in rows {
            for name in names {
                z.push(data.number(row, name, "a linear predictor")?);
            }
        }
        Ok(Linear { beta, n: names.len(), z, out, rows: rows.len(), add })
    }

    fn acts(&self, name: &str) -> bool {
        self.effects.iter().any(|e| e.on.contains(&name))
    }

    fn hook(&mut self, observe: &'static str, name: &'static str, n: usize) -> usize {
        let at = self.values(n);
        self.model.offsets.push(at..at + n);
        self.hooks.insert((observe, name), at);
        at
    }

    /// Everything is declared.
    pub(super) fn finish(mut self) -> Result<Model, ModelError> {
        let mut hit = BTreeSet::new();
        for effect in std::mem::take(&mut self.effects) {
            for i in 0..self.model.observes.len() {
                let (observe, rows) =
                    (self.model.observes[i].name, self.model.observes[i].rows.clone());
                let on = effect.on.iter().filter_map(|&on| {
                    let at = self.hooks.get(&(observe, on)).copied()?;
                    hit.insert((effect.name, on));
                    Some(at)
                });
                let out: Vec<usize> = on.collect();
                if !out.is_empty() {
                    let names: Vec<String> =
                        effect.columns.iter().map(ToString::to_string).collect();
                    let linear = self.design(&rows, &names, effect.beta, out, true)?;
                    self.model.linear.push(linear);
                }
            }
            if let Some(target) = effect.on.iter().find(|on| !hit.contains(&(effect.name, **on))) {
                return Err(ModelError::NoTarget {
                    effect: effect.name.into(),
                    target: (*target).into(),
                });
            }
        }
        check_units(&self.model)?;
        self.model.layout = [self.n_u, self.n_v, self.n_work];
        if let Some(data) = self.data {
            self.model.check(data)?;
        }
        Ok(self.model)
    }
}

/// A scalar of a field, on its way from [`Builder::scalar`] to [`Builder::term`].
#[derive(Debug)]
pub struct ScalarHandle(Box<dyn Scalar>);

/// The rows of an `observe` statement that hold a measurement, and the measurements.
fn read_rows<Y: Observation>(
    data: &Measurements,
    observe: &str,
) -> Result<(Vec<usize>, Vec<Y>), ModelError> {
    let who = format!("observe {observe}");
    // a single value may stand in a column of the statement's own name
    let names: Vec<&str> = match Y::COLUMNS {
        ["value"] if data.has(observe) => vec![observe],
        names => names.to_vec(),
    };
    let (mut rows, mut y) = (vec![], vec![]);
    for row in data.rows_of(observe) {
        let mut cells = vec![];
        for name in &names {
            cells.push(data.number_or_empty(row, name, &who)?);
        }
        let read = Y::read(&cells).map_err(|problem| {
            data.cell_error(row, &names.join(", "), problem, "mend the row or drop it")
        })?;
        if let Some(measurement) = read {
            rows.push(row);
            y.push(measurement);
        }
    }
    if rows.is_empty() {
        return Err(ModelError::NoRows { observe: observe.into(), file: data.file().into() });
    }
    Ok((rows, y))
}

/// The constant mode's value, if the first mode is constant: λ₀ = 0 on one connected surface.
fn constant_mode(basis: &Basis) -> Option<f64> {
    let values = || (0..basis.n_vertices()).map(|vertex| basis.at(vertex)[0]);
    let mean = values().sum::<f64>() / basis.n_vertices() as f64;
    values().all(|phi| (phi - mean).abs() <= 1e-6 * mean.abs()).then_some(mean)
}
