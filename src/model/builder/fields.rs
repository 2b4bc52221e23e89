//! `field` statements: hyperparameters, terms, and whether the constant mode is collapsed.

use std::marker::PhantomData;

use super::{Builder, Source};
use crate::dist::Support;
use crate::manifold::Basis;
use crate::model::error::ModelError;
use crate::model::gp::{Collapsed, Field, KernelFn, SpectrumAt, Term, padded};
use crate::model::model::{FieldEntry, Kind, Parameter, Position};
use crate::model::scalar::{Scalar, ScalarAt, ScalarFn};
use crate::model::scope::Scope;
use crate::model::units::Decl;

/// √λ of the first modes, the probes' rows of them, and the constant mode's value if it is constant.
type Modes = (Vec<f64>, Vec<f64>, Option<f64>);

/// A scalar of a field, on its way from [`Builder::scalar`] to [`Builder::term`].
#[derive(Debug)]
pub struct ScalarHandle(Box<dyn Scalar>);

impl Builder<'_> {
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
        let lone_mean = self.lone_mean(hyper, mean_text);
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
        let (theta, work) = (self.values(padded(n)), self.n_work);
        self.n_work += 2 * stride + used;
        let mut probes = vec![0.0; n * stride];
        for (to, from) in
            probes.chunks_exact_mut(stride.max(1)).zip(rows.chunks_exact(n_modes.max(1)))
        {
            to[..k].copy_from_slice(&from[first..]);
        }
        let mut modes = vec![0.0; stride * padded(n)];
        for (i, row) in modes.chunks_exact_mut(padded(n).max(1)).enumerate() {
            for (j, x) in row[..n].iter_mut().enumerate() {
                *x = probes[j * stride + i];
            }
        }
        let hyper_names = self.names.len() - hyper.len();
        self.names.truncate(hyper_names);
        let mean = mean.0;
        let frequency = frequency[first..].to_vec();
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
            modes,
            frequency,
        };
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

    /// The value of a mean that is a hyperparameter and nothing else, which nothing else mentions.
    fn lone_mean(&self, hyper: &[&str], mean: &str) -> Option<usize> {
        let Source::Scalars(v) = *self.source(hyper.iter().find(|name| **name == mean)?) else {
            return None;
        };
        (self.mentions.get(&v) == Some(&1)).then_some(v)
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
        self.lone_mean(hyper, mean)?;
        let field = self.model.fields.len();
        for parameter in &mut self.model.parameters {
            if matches!(parameter.position, Position::Values(at) if at == v) {
                parameter.position = Position::CollapsedMean { field };
            }
        }
        Some(Collapsed { mean: v, phi0 })
    }
}

/// The constant mode's value, if the first mode is constant: λ₀ = 0 on one connected surface.
fn constant_mode(basis: &Basis) -> Option<f64> {
    let values = || (0..basis.n_vertices()).map(|vertex| basis.at(vertex)[0]);
    let mean = values().sum::<f64>() / basis.n_vertices() as f64;
    values().all(|phi| (phi - mean).abs() <= 1e-6 * mean.abs()).then_some(mean)
}
