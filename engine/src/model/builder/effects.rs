//! `effect` statements, declared and added: additive offsets of fields and `let`s.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::{Builder, Len};
use crate::dist::{Dist, HalfNormal, Normal, Support};
use crate::model::discrepancy::Spread;
use crate::model::error::ModelError;
use crate::model::expression::AnyPrior;
use crate::model::forms::Form;
use crate::model::functions::{Decl, PriorFn};
use crate::model::laid_out::{PriorEntry, SpreadEntry};
use crate::model::linear::Linear;
use crate::model::parameter::{NormalOp, ParameterOp, PriorOp};
use crate::model::reported::Kind;
use crate::num::{Num, Real};
use crate::table::{Measurements, Probes};

/// Above this number of measurements per label, a coefficient is not sampled as a deviation.
const MANY: usize = 10;

pub(super) struct Effect {
    name: String,
    pub(super) on: Vec<String>,
    design: Design,
    beta: usize,
}

/// What an effect multiplies its coefficients by.
enum Design {
    /// `linear(row.a, row.b)`: the columns as they are. No cell may be empty.
    Columns(Vec<String>),
    /// A form.
    Form(Form),
}

impl Builder<'_> {
    /// `effect name on a, b [unit] = linear(row.c) ~ prior;`
    ///
    /// # Errors
    /// Those of [`Builder::param`].
    pub fn linear_effect(
        &mut self,
        decl: Decl,
        on: &[&str],
        columns: &[&str],
        prior: &AnyPrior,
    ) -> Result<(), ModelError> {
        let columns: Vec<String> = columns.iter().map(ToString::to_string).collect();
        let name = decl.name.to_string();
        self.param(decl, Len::Many(columns.len()), prior)?;
        let n = columns.len();
        self.push_effect(&name, on, Design::Columns(columns), n);
        Ok(())
    }

    /// `effect name on a, b [unit] = scaled(row.c, 1.0, 2.0) ~ prior;`, and the other forms.
    ///
    /// # Errors
    /// Those of [`Builder::param`], and a column that the table lacks.
    #[expect(clippy::needless_pass_by_value, reason = "the expansion makes one for each statement")]
    pub fn effect(
        &mut self,
        decl: Decl,
        on: &[&str],
        form: Form,
        prior: &AnyPrior,
    ) -> Result<(), ModelError> {
        let name = decl.name.to_string();
        let n = self.n_coefficients(&name, &form)?;
        if self.coefficients(&decl, Len::Many(n), prior)? {
            self.note_spread(&form);
        }
        self.label_last(&form);
        self.push_effect(&name, on, Design::Form(form), n);
        Ok(())
    }

    /// An effect that is in no model file. Its coefficients are `~ Normal(0, sd)`; `decl` has that
    /// prior as its text.
    ///
    /// # Errors
    /// A column that the table lacks.
    pub(in crate::model) fn added_effect(
        &mut self,
        decl: &Decl,
        on: &[String],
        form: &Form,
        sd: f64,
    ) -> Result<(), ModelError> {
        let n = self.n_coefficients(&decl.name, form)?;
        let (u, v) = (self.unknowns(n), self.values(n));
        self.push_parameter(decl, n, Kind::Vector, vec![], Support::Real, v);
        self.model.prior_entries.push(PriorEntry { u: u..u + n, v, len: n, mentions: vec![] });
        self.model.priors.push(Box::new(NormalOp { u, v, n, sd }));
        self.label_last(form);
        let on: Vec<&str> = on.iter().map(String::as_str).collect();
        self.push_effect(&decl.name, &on, Design::Form(form.clone()), n);
        Ok(())
    }

    /// A random effect of the labels of a column that is in no model file, and its sd. It is laid
    /// out as if `param SD ~ HalfNormal(…);` and `effect NAME on … = FORM ~ Normal(0.0, SD);` were
    /// declared.
    ///
    /// # Errors
    /// A column that the table lacks.
    pub(in crate::model) fn spread(&mut self, spread: &Spread) -> Result<(), ModelError> {
        let sd = self.learnt_sd(&spread.sd, &spread.unit, spread.prior_sd);
        let n = self.n_coefficients(&spread.name, &spread.form)?;
        let (u, v) = (self.unknowns(n), self.values(n));
        *self.mentions.entry(sd).or_default() += 1;
        let mut op = ParameterOp::<Deviating, 1, 2>::new(Deviating);
        op.put(&[sd as u32], u, v, n);
        if self.deviates(n) {
            op.take_deviations();
        }
        self.push_prior(&spread.decl(), Box::new(op), vec![sd], u..u + n, v);
        if self.deviates(n) {
            self.note_spread(&spread.form);
        }
        self.label_last(&spread.form);
        let on: Vec<&str> = spread.on.iter().map(String::as_str).collect();
        self.push_effect(&spread.name, &on, Design::Form(spread.form.clone()), n);
        Ok(())
    }

    /// Declares the sds of the further errors that were added, as if each were a `param` after all
    /// others.
    pub(super) fn declare_row_errors(&mut self) {
        for error in std::mem::take(&mut self.further_errors) {
            let sd = self.learnt_sd(&error.name, &error.unit, error.prior_sd);
            let observes = error.observes.into_iter();
            self.row_errors.extend(observes.map(|observe| (observe, sd, error.scatter.clone())));
        }
    }

    /// Declares a parameter `~ HalfNormal(prior_sd)` that is in no model file. Returns where its
    /// value is.
    pub(super) fn learnt_sd(&mut self, name: &str, unit: &str, prior_sd: f64) -> usize {
        let (u, v) = (self.unknowns(1), self.values(1));
        let mut op = ParameterOp::<Positive, 0, 1>::new(Positive { sd: prior_sd });
        op.put(&[], u, v, 1);
        let text = format!("HalfNormal({prior_sd:?})");
        let decl =
            Decl { name: name.to_owned().into(), unit: unit.to_owned().into(), text: text.into() };
        self.push_prior(&decl, Box::new(op), vec![], u..u + 1, v);
        v
    }

    fn push_prior(
        &mut self,
        decl: &Decl,
        op: Box<dyn PriorOp>,
        mentions: Vec<usize>,
        u: Range<usize>,
        v: usize,
    ) {
        let (n, support) = (u.len(), op.support());
        let kind = if mentions.is_empty() { Kind::Scalar } else { Kind::Vector };
        self.push_parameter(decl, n, kind, vec![], support, v);
        self.model.prior_entries.push(PriorEntry { u, v, len: n, mentions });
        self.model.priors.push(op);
    }

    fn push_effect(&mut self, name: &str, on: &[&str], design: Design, n: usize) {
        let on = on.iter().map(ToString::to_string).collect();
        if let Design::Form(form) = &design {
            self.model.effect_modes = self.model.effect_modes.max(form.n_modes());
        }
        self.effects.push(Effect { name: name.into(), on, design, beta: self.n_v - n });
    }

    fn n_coefficients(&self, effect: &str, form: &Form) -> Result<usize, ModelError> {
        let Some(data) = self.data else { return Ok(form.n_modes().max(1)) };
        check_modes(effect, form, data)?;
        for column in form.column().into_iter().chain(form.also_requires()) {
            data.require(column, &format!("effect {effect}"))?;
        }
        Ok(form.design(data).1)
    }

    /// Whether `n` coefficients are better sampled as deviations, in units of their sd. They are
    /// not if there are many measurements of each: these fix the coefficient whatever the sd is, so
    /// that its deviation would have to move with the sd.
    pub(super) fn deviates(&self, n: usize) -> bool {
        self.data.is_none_or(|data| data.len() <= MANY * n)
    }

    /// Notes that the last prior is that of deviations of places, if each label has a vertex of its
    /// own and each vertex one label. Such deviations can be sampled together with the fields
    /// there.
    fn note_spread(&mut self, form: &Form) {
        let Some(data) = self.data else { return };
        let (z, n) = form.design(data);
        let (mut vertices, mut of_vertex) = (vec![None; n], BTreeMap::new());
        for (row, z) in z.chunks_exact(n.max(1)).enumerate() {
            let ones: Vec<usize> = (0..n).filter(|label| z[*label] != 0.0).collect();
            let (&[label], Some(vertex)) = (&ones[..], data.vertex(row)) else { return };
            if (z[label] - 1.0).abs() > 0.0
                || *vertices[label].get_or_insert(vertex) != vertex
                || *of_vertex.entry(vertex).or_insert(label) != label
            {
                return;
            }
        }
        let prior = self.model.priors.len() - 1;
        let vertices: Option<Vec<u32>> = vertices.into_iter().collect();
        self.model.spreads.extend(vertices.map(|vertices| SpreadEntry { prior, vertices }));
    }

    /// Names the numbers of the last parameter after the labels of the form.
    fn label_last(&mut self, form: &Form) {
        if let (Some(data), Some(parameter)) = (self.data, self.model.parameters.last_mut()) {
            parameter.labels = form.labels(data);
        }
    }

    /// Lets every effect add to the offsets of the fields and `let`s that it acts on.
    pub(super) fn apply_effects(&mut self) -> Result<(), ModelError> {
        for effect in std::mem::take(&mut self.effects) {
            let mut hit = BTreeSet::new();
            for i in 0..self.model.observes.len() {
                let (observe, rows) =
                    (self.model.observes[i].name, self.model.observes[i].rows.clone());
                let mut out = vec![];
                for ((_, target), at) in self.hooks.iter().filter(|((o, _), _)| *o == observe) {
                    if effect.on.iter().any(|on| on == target) {
                        hit.insert(target.clone());
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
            (Design::Columns(columns), _) => self.design(rows, columns, effect.beta, out, true),
            (Design::Form(form), Some(data)) => {
                let (z, n) = form.design(data);
                let z = rows.iter().flat_map(|row| z[row * n..][..n].iter().copied()).collect();
                Ok(Linear { beta: effect.beta, n, z, out, rows: rows.len(), add: true })
            }
            (Design::Form(_), None) => {
                Ok(Linear { beta: effect.beta, n: 1, z: vec![], out, rows: 0, add: true })
            }
        }
    }
}

/// `Normal(0.0, SD)`
#[derive(Clone, Copy)]
struct Deviating;

impl PriorFn<1> for Deviating {
    fn prior<T: Real>(&self, [sd]: [Num<T>; 1]) -> impl Dist<Num<T>> + use<T> {
        Normal { mu: Num::from(0.0), sd }
    }
}

/// `HalfNormal(…)`
#[derive(Clone, Copy)]
struct Positive {
    sd: f64,
}

impl PriorFn<0> for Positive {
    fn prior<T: Real>(&self, _: [Num<T>; 0]) -> impl Dist<Num<T>> + use<T> {
        HalfNormal { sd: Num::from(self.sd) }
    }
}

/// Refuses a form that needs more modes than are known at the rows.
fn check_modes(effect: &str, form: &Form, data: &Measurements) -> Result<(), ModelError> {
    let (field, k) = (effect.to_owned(), form.n_modes());
    match data.probes().map(Probes::n_modes) {
        _ if k == 0 => Ok(()),
        None => Err(ModelError::NoBasis { field }),
        Some(available) if k > available => Err(ModelError::TooManyModes { field, k, available }),
        Some(_) => Ok(()),
    }
}
