//! `field` statements: hyperparameters, terms, one field or one for each label, and whether the constant mode is
//! collapsed.

use std::marker::PhantomData;
use std::sync::Arc;

use super::{Builder, Labels, Range, Source};
use crate::dist::Support;
use crate::manifold::Basis;
use crate::model::error::ModelError;
use crate::model::functions::{Decl, KernelFn, ScalarFn};
use crate::model::gp::{Collapsed, Field, SpectrumAt, Term, padded};
use crate::model::laid_out::FieldEntry;
use crate::model::reported::{Kind, Parameter, Position};
use crate::model::scalar::{Scalar, ScalarAt};
use crate::num::Within;

/// The field that is being declared.
pub(super) struct Declared {
    name: &'static str,
    unit: String,
    range: Option<(f64, f64)>,
    within: Option<Within>,
    labels: Option<Arc<Labels>>,
}

impl Declared {
    /// How many fields it is: one for each label, and one where there are no data to have labels.
    fn n_fields(&self) -> usize {
        self.labels.as_ref().map_or(1, |labels| labels.names.len().max(1))
    }

    /// `tau_out`, or `tau_out[a]` of label a.
    fn name_of(&self, label: usize) -> String {
        let own = self.labels.as_ref().and_then(|labels| labels.names.get(label));
        own.map_or_else(|| self.name.into(), |own| format!("{}[{own}]", self.name))
    }
}

/// The modes of a surface as fields need them.
struct Modes {
    /// √λ of each.
    frequency: Vec<f64>,
    /// (probes, modes)
    rows: Vec<f64>,
    /// The value of the first, if it is constant.
    phi0: Option<f64>,
}

/// A mean or an amplitude, once for each label, on its way from [`Builder::scalar`] to the field.
#[derive(Debug)]
pub struct Scalars(Vec<Box<dyn Scalar>>);

/// A Gaussian process, once for each label, on its way from [`Builder::term`] to the field.
#[derive(Debug)]
pub struct Terms(Vec<Term>);

impl Builder<'_> {
    /// `field name(x, label) [unit] range = …`: its hyperparameters follow, then its mean and terms, then
    /// [`Builder::end_field`].
    ///
    /// # Errors
    /// A label column that the data lack.
    pub fn field(
        &mut self,
        decl: Decl,
        Range { ends: range, is_within }: Range,
        label: Option<&'static str>,
        name: &'static str,
    ) -> Result<(), ModelError> {
        let who = format!("field {name}");
        let labels = label.map(|column| self.labels(column, &who)).transpose()?;
        self.prefix = Some(name);
        let unit = decl.unit.clone().into();
        let within = range.filter(|_| is_within).map(|(low, high)| Within { low, high });
        self.field = Some(Declared { name, unit, range, within, labels });
        self.state("field", decl);
        Ok(())
    }

    fn n_fields(&self) -> usize {
        self.field.as_ref().map_or(1, Declared::n_fields)
    }

    /// A field's mean or amplitude.
    pub fn scalar<F: ScalarFn<N>, const N: usize>(&mut self, mentions: &[&str]) -> Scalars {
        let n_fields = self.n_fields();
        let one = |label| -> Box<dyn Scalar> {
            Box::new(ScalarAt::<F, N> { local: self.local(mentions, label), f: PhantomData })
        };
        Scalars((0..n_fields).map(one).collect())
    }

    /// One `amplitude * gp(kernel, K = k)`.
    pub fn term<F: KernelFn<N>, const N: usize>(
        &mut self,
        amplitude: Scalars,
        k: usize,
        mentions: &[&str],
    ) -> Terms {
        let terms = amplitude.0.into_iter().enumerate().map(|(label, amplitude)| {
            let local = self.local(mentions, label);
            let spectrum = Box::new(SpectrumAt::<F, N> { local, f: PhantomData });
            Term { amplitude, spectrum, k, eta: 0, work: 0 }
        });
        Terms(terms.collect())
    }

    /// The end of a field; `lone_mean` names the hyperparameter that is its mean, if that is all the mean is.
    ///
    /// # Errors
    /// No surface, or fewer modes than K.
    pub fn end_field(
        &mut self,
        lone_mean: Option<&str>,
        mean: Scalars,
        terms: Vec<Terms>,
    ) -> Result<(), ModelError> {
        let n_fields = self.n_fields();
        let Some(declared) = self.field.take() else { return Ok(()) };
        self.prefix = None;
        let n_modes = terms.iter().flat_map(|t| &t.0).map(|t| t.k).max().unwrap_or(0);
        let modes = self.modes(declared.name, n_modes)?;
        let first_field = self.model.fields.len();
        let mut terms: Vec<_> = terms.into_iter().map(|terms| terms.0.into_iter()).collect();
        for (label, mean) in mean.0.into_iter().enumerate().take(n_fields) {
            let own: Vec<Term> = terms.iter_mut().filter_map(Iterator::next).collect();
            let lone = lone_mean.and_then(|name| self.lone_mean(name, label));
            self.one_field(&declared, label, &modes, lone, (mean, own));
        }
        let labels = declared.labels.clone();
        let source = Source::Field { field: first_field, labels };
        if declared.within.is_some() {
            self.names.push((format!("{}.sum", declared.name), source));
            self.link(declared.name);
        } else {
            self.names.push((declared.name.into(), source));
        }
        Ok(())
    }

    /// Lays out the field of one label.
    fn one_field(
        &mut self,
        declared: &Declared,
        label: usize,
        modes: &Modes,
        lone: Option<usize>,
        (mean, mut terms): (Box<dyn Scalar>, Vec<Term>),
    ) {
        let name = declared.name_of(label);
        let n_modes = modes.frequency.len();
        let lone_mean = lone.filter(|v| self.mentions.get(v) == Some(&1));
        let collapsed = self.collapse(lone, lone_mean, declared.range, modes.phi0);
        let first = usize::from(collapsed.is_some());
        let work_of_terms = self.coefficients_of(&name, &mut terms, first);
        let (k, n) = (n_modes - first, self.probes.len());
        let stride = padded(k);
        let (theta, work) = (self.values(padded(n)), self.n_work);
        self.n_work += 2 * stride + work_of_terms;
        let (probes, transposed) = matrices(modes, first, n);
        let op = Field {
            mean,
            lone_mean,
            terms,
            collapsed,
            k,
            work,
            theta,
            probes,
            stride,
            modes: transposed,
            frequency: modes.frequency[first..].to_vec(),
        };
        let (unit, range, within) = (declared.unit.clone(), declared.range, declared.within);
        let label = declared.labels.as_ref().map(|_| label);
        self.model.fields.push(FieldEntry { name, unit, range, within, label, first, op });
    }

    /// The coefficients of each term: parameters of the model. Gives the length of the terms' work.
    fn coefficients_of(&mut self, field: &str, terms: &mut [Term], first: usize) -> usize {
        let mut used = 0;
        for (i, term) in terms.iter_mut().enumerate() {
            let suffix = if i == 0 { String::new() } else { (i + 1).to_string() };
            self.model.parameters.push(Parameter {
                name: format!("{field}.eta{suffix}"),
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
        used
    }

    /// The first `k` modes of the basis.
    fn modes(&self, field: &str, k: usize) -> Result<Modes, ModelError> {
        let Some(basis) = self.basis else {
            if self.data.is_some() {
                return Err(ModelError::NoBasis { field: field.into() });
            }
            return Ok(Modes { frequency: vec![0.0; k], rows: vec![], phi0: Some(0.0) });
        };
        if k > basis.n_modes() {
            let available = basis.n_modes();
            return Err(ModelError::TooManyModes { field: field.into(), k, available });
        }
        let frequency = basis.eigenvalues[..k].iter().map(|l| l.max(0.0).sqrt()).collect();
        let rows = self.probes.iter().flat_map(|&p| basis.at(p as usize)[..k].iter().copied());
        Ok(Modes { frequency, rows: rows.collect(), phi0: constant_mode(basis) })
    }

    /// The value of the hyperparameter that is the mean of the field of this label.
    fn lone_mean(&self, name: &str, label: usize) -> Option<usize> {
        match self.source(name) {
            Source::Scalars { v, len: 1 } => Some(*v),
            Source::Each { v, .. } => Some(v + label),
            _ => None,
        }
    }

    /// Whether the mean is a flat hyperparameter that nothing else mentions: see [`super::super::gp`].
    fn collapse(
        &mut self,
        mean: Option<usize>,
        lone_mean: Option<usize>,
        range: Option<(f64, f64)>,
        phi0: Option<f64>,
    ) -> Option<Collapsed> {
        let v = mean?;
        let u = *self.flat.get(&v)?;
        if let Some((low, high)) = range {
            self.model.start.push((u, 0.5 * (low + high)));
        }
        let phi0 = phi0?;
        lone_mean?;
        let field = self.model.fields.len();
        let is_it = |p: &&mut Parameter| matches!(p.position, Position::Values(at) if at == v);
        let parameter = self.model.parameters.iter_mut().find(is_it)?;
        parameter.position = Position::CollapsedMean { field };
        Some(Collapsed { mean: v, phi0 })
    }
}

/// The modes from `first` on at the `n` probes, (probes, padded modes), and transposed.
fn matrices(modes: &Modes, first: usize, n: usize) -> (Vec<f64>, Vec<f64>) {
    let n_modes = modes.frequency.len();
    let k = n_modes - first;
    let (stride, height) = (padded(k), padded(n));
    let mut probes = vec![0.0; n * stride];
    let rows = modes.rows.chunks_exact(n_modes.max(1));
    for (to, from) in probes.chunks_exact_mut(stride.max(1)).zip(rows) {
        to[..k].copy_from_slice(&from[first..]);
    }
    let mut transposed = vec![0.0; stride * height];
    for (i, row) in transposed.chunks_exact_mut(height.max(1)).enumerate() {
        for (j, x) in row[..n].iter_mut().enumerate() {
            *x = probes[j * stride + i];
        }
    }
    (probes, transposed)
}

/// The constant mode's value, if the first mode is constant: λ₀ = 0 on one connected surface.
fn constant_mode(basis: &Basis) -> Option<f64> {
    let values = || (0..basis.n_vertices()).map(|vertex| basis.at(vertex)[0]);
    let mean = values().sum::<f64>() / basis.n_vertices() as f64;
    values().all(|phi| (phi - mean).abs() <= 1e-6 * mean.abs()).then_some(mean)
}
