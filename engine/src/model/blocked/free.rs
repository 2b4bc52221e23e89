//! Parameters and effects as free latent values: measurements are linear in them, and their priors are normal or flat.

use super::blocks::gaussian;
use crate::dist::Gaussian;
use crate::model::laid_out::Model;
use crate::model::reported::Position;
use crate::model::tape::Tape;
use std::ops::Range;

/// The numbers of one `param` or `effect`.
#[derive(Debug)]
pub(super) struct FreeBlock {
    /// Which of the model's priors is theirs.
    pub(super) prior: usize,
    /// Unknowns.
    pub(super) u: Range<usize>,
    /// Values.
    v: Range<usize>,
    /// Prior precision of their coefficients.
    pub(super) precision: f64,
}

/// The priors, normal or flat, of the parameters and effects of these names.
pub(in crate::model) fn priors_of(model: &Model, names: &[String]) -> Vec<usize> {
    let values = model.tape().v;
    let named = model.parameters.iter().filter(|own| names.contains(&own.name));
    let prior = |at: &Position| match at {
        Position::Values(v) => model.prior_entries.iter().position(|entry| entry.v == *v),
        _ => None,
    };
    named
        .filter_map(|own| prior(&own.position))
        .filter(|prior| model.priors[*prior].gaussian(&values).is_some())
        .collect()
}

impl FreeBlock {
    pub(super) fn new(model: &Model, prior: usize) -> Self {
        let entry = &model.prior_entries[prior];
        let precision = gaussian(model, prior, &model.tape().v).precision;
        Self { prior, u: entry.u.clone(), v: entry.v..entry.v + entry.len, precision }
    }

    /// Number of values.
    pub(super) fn n(&self) -> usize {
        self.u.len()
    }

    /// Writes offset and scale of each value.
    pub(super) fn set_design(
        &self,
        model: &Model,
        values: &[f64],
        (offset, scale): (&mut [f64], &mut [f64]),
    ) {
        let prior = gaussian(model, self.prior, values);
        offset.fill(prior.location);
        scale.fill(prior.scale);
    }

    /// Writes the values to where measurements and effects read them.
    pub(super) fn set_values(&self, theta: &[f64], t: &mut Tape) {
        t.v[self.v.clone()].copy_from_slice(theta);
    }

    /// The adjoints of the values.
    pub(super) fn slopes(&self, t: &Tape, out: &mut [f64]) {
        out.copy_from_slice(&t.g[self.v.clone()]);
    }

    /// The coefficients at a position of the model's unknowns. What their prior mentions is on the tape.
    pub(super) fn coefficients(
        &self,
        model: &Model,
        t: &mut Tape,
        position: &[f64],
        out: &mut [f64],
    ) {
        t.u[self.u.clone()].copy_from_slice(&position[self.u.clone()]);
        model.priors[self.prior].forward(t);
        let Gaussian { location, scale, .. } = gaussian(model, self.prior, &t.v);
        for (out, x) in out.iter_mut().zip(&t.v[self.v.clone()]) {
            *out = (x - location) / scale;
        }
    }

    /// Writes the unknowns of these coefficients into a position. What their prior mentions is on the tape.
    pub(super) fn put(&self, model: &Model, t: &Tape, coefficients: &[f64], position: &mut [f64]) {
        let Gaussian { location, scale, .. } = gaussian(model, self.prior, &t.v);
        for (u, w) in self.u.clone().zip(coefficients) {
            position[u] = model.priors[self.prior].unknown(&t.v, location + scale * w);
        }
    }
}
