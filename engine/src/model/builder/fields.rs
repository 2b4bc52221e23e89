//! `field` statements: their hyperparameters and terms, whether there is one field or one for each
//! label, and whether the constant mode is collapsed.

use std::collections::BTreeSet;
use std::sync::Arc;

use eplat_language::syntax::Item;

use super::{Builder, Labels, Range, Source};
use crate::dist::Support;
use crate::manifold::Basis;
use crate::model::error::ModelError;
use crate::model::expression::{AnyKernel, AnyScalar};
use crate::model::functions::Decl;
use crate::model::gp::{Collapsed, Field, Term, padded};
use crate::model::laid_out::{FieldEntry, Model};
use crate::model::reported::{Kind, Parameter, Position};
use crate::model::scalar::Scalar;
use crate::num::Within;
use crate::table::Measurements;

/// The field that is being declared.
pub(super) struct Declared {
    name: &'static str,
    unit: String,
    range: Option<(f64, f64)>,
    within: Option<Within>,
    labels: Option<Arc<Labels>>,
    /// Whether no row sees fields of two labels. Each field then needs only the places of its own
    /// rows.
    is_apart: bool,
}

impl Declared {
    /// How many fields the statement makes: one for each label. Without data there are no labels,
    /// and it makes one.
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
    /// The value of the first, if it is constant.
    phi0: Option<f64>,
}

/// A mean or an amplitude, once for each label: what [`Builder::scalar`] returns, for the field to
/// take.
#[derive(Debug)]
pub struct Scalars(Vec<Box<dyn Scalar>>);

/// A Gaussian process, once for each label: what [`Builder::term`] returns, for the field to take.
#[derive(Debug)]
pub struct Terms(Vec<Term>);

impl Builder<'_> {
    /// `field name(x, label) [unit] range = …`. Calls for its hyperparameters must follow, then for
    /// its mean and terms, then [`Builder::end_field`].
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
        let is_apart = labels.is_some() && is_by_label(&self.model);
        let unit = decl.unit.into();
        let within = range.filter(|_| is_within).map(|(low, high)| Within { low, high });
        self.field = Some(Declared { name, unit, range, within, labels, is_apart });
        Ok(())
    }

    fn n_fields(&self) -> usize {
        self.field.as_ref().map_or(1, Declared::n_fields)
    }

    /// A field's mean or amplitude.
    pub fn scalar(&mut self, of: &AnyScalar) -> Scalars {
        let n_fields = self.n_fields();
        let one = |label| (of.make)(&self.local(of.mentions, label));
        Scalars((0..n_fields).map(one).collect())
    }

    /// One `amplitude * gp(kernel, K = k)`.
    pub fn term(&mut self, amplitude: Scalars, k: usize, kernel: &AnyKernel) -> Terms {
        let terms = amplitude.0.into_iter().enumerate().map(|(label, amplitude)| {
            let spectrum = (kernel.make)(&self.local(kernel.mentions, label));
            Term { amplitude, spectrum, k, eta: 0, work: 0 }
        });
        Terms(terms.collect())
    }

    /// The end of a field. If the mean of the field is a hyperparameter and nothing else,
    /// `lone_mean` is the name of that.
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
            self.one_field(&declared, label, &modes, lone, (mean, own))?;
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
    ) -> Result<(), ModelError> {
        let name = declared.name_of(label);
        let n_modes = modes.frequency.len();
        let lone_mean = lone.filter(|v| self.mentions.get(v) == Some(&1));
        let collapsed = self.collapse(lone, lone_mean, declared.range, modes.phi0);
        let first = usize::from(collapsed.is_some());
        let work_of_terms = self.coefficients_of(&name, &mut terms, first);
        let (group, seen) = self.seen_by(declared, label)?;
        let has_flat_mean = mean.mentions().iter().any(|v| self.flat.contains_key(v));
        let (k, n) = (n_modes - first, seen.len());
        let stride = padded(k);
        let (theta, work) = (self.values(padded(n)), self.n_work);
        self.n_work += 2 * stride + work_of_terms;
        let (probes, transposed) = self.matrices(n_modes, first, &seen);
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
        self.model.fields.push(FieldEntry {
            name,
            unit,
            range,
            within,
            label,
            has_flat_mean,
            first,
            probes: seen,
            group,
            op,
        });
        Ok(())
    }

    /// Declares the coefficients of each term, which are parameters of the model. Returns the
    /// length of the terms' work.
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
                is_flat: false,
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
            return Ok(Modes { frequency: vec![0.0; k], phi0: Some(0.0) });
        };
        if k > basis.n_modes() {
            let available = basis.n_modes();
            return Err(ModelError::TooManyModes { field: field.into(), k, available });
        }
        let frequency = basis.eigenvalues[..k].iter().map(|l| l.max(0.0).sqrt()).collect();
        Ok(Modes { frequency, phi0: constant_mode(basis) })
    }

    /// The group of the field of this label, and the vertices that its rows are at; all of the triangulation where
    /// operators depend on it.
    fn seen_by(&self, declared: &Declared, label: usize) -> Result<(usize, Vec<u32>), ModelError> {
        let ground = self.data.and_then(Measurements::ground);
        if let Some(ground) = ground.filter(|_| is_everywhere(&self.model, declared.name)) {
            return Ok((0, ground.triangulation(self.model.fineness())?.vertices.clone()));
        }
        let Some((labels, data)) =
            declared.labels.as_ref().zip(self.data).filter(|_| declared.is_apart)
        else {
            return Ok((0, self.probes.clone()));
        };
        let own = labels.of_row.iter().enumerate().filter(|(_, of)| **of == label);
        let seen: BTreeSet<u32> = own.filter_map(|(row, _)| data.vertex(row)).collect();
        Ok((label, seen.into_iter().collect()))
    }

    /// The modes from `first` on at these vertices, (probes, padded modes), and transposed.
    fn matrices(&self, n_modes: usize, first: usize, seen: &[u32]) -> (Vec<f64>, Vec<f64>) {
        let (k, n) = (n_modes - first, seen.len());
        let (stride, height) = (padded(k), padded(n));
        let mut probes = vec![0.0; n * stride];
        if let Some(basis) = self.basis {
            for (to, vertex) in probes.chunks_exact_mut(stride.max(1)).zip(seen) {
                to[..k].copy_from_slice(&basis.at(*vertex as usize)[first..n_modes]);
            }
        }
        let mut transposed = vec![0.0; stride * height];
        for (i, row) in transposed.chunks_exact_mut(height.max(1)).enumerate() {
            for (j, x) in row[..n].iter_mut().enumerate() {
                *x = probes[j * stride + i];
            }
        }
        (probes, transposed)
    }

    /// The value of the hyperparameter that is the mean of the field of this label.
    fn lone_mean(&self, name: &str, label: usize) -> Option<usize> {
        match self.source(name) {
            Source::Scalars { v, len: 1 } => Some(*v),
            Source::Each { v, .. } => Some(v + label),
            _ => None,
        }
    }

    /// Whether the mean is a flat hyperparameter that nothing else mentions. The constant mode is
    /// then collapsed: see [`super::super::gp`].
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

/// Whether arrivals over the whole surface depend on this field.
fn is_everywhere(model: &Model, field: &str) -> bool {
    model.syntax().is_ok_and(|tree| tree.fields_everywhere().iter().any(|name| *name == field))
}

/// Whether all fields of the model are labelled by the same column.
fn is_by_label(model: &Model) -> bool {
    let Ok(tree) = model.syntax() else { return false };
    let mut labels = tree.statements.iter().filter_map(|statement| match &statement.item {
        Item::Field(field) => Some(&field.label),
        _ => None,
    });
    let Some(first) = labels.next() else { return false };
    first.is_some() && labels.all(|label| label == first)
}

/// The constant mode's value, if the first mode is constant: λ₀ = 0 on one connected surface.
fn constant_mode(basis: &Basis) -> Option<f64> {
    let values = || (0..basis.n_vertices()).map(|vertex| basis.at(vertex)[0]);
    let mean = values().sum::<f64>() / basis.n_vertices() as f64;
    values().all(|phi| (phi - mean).abs() <= 1e-6 * mean.abs()).then_some(mean)
}
