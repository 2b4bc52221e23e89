//! Passes over a laid-out model: from the unknowns to all values, and back to the gradient.

use super::laid_out::Model;
use super::operator::Memo;
use super::tape::{Op, Tape};

impl Model {
    /// Fresh scratch memory.
    pub fn tape(&self) -> Tape {
        let [n_u, n_v, n_work] = self.layout;
        let mut v = vec![0.0; n_v];
        for (at, x) in &self.constants {
            v[*at] = *x;
        }
        Tape {
            u: vec![0.0; n_u],
            gu: vec![0.0; n_u],
            v,
            g: vec![0.0; n_v],
            work: vec![0.0; n_work],
            kept: vec![Memo::default(); self.over.len()],
            lp: 0.0,
        }
    }

    /// Computes all values from the unknowns.
    pub fn forward(&self, t: &mut Tape, u: &[f64]) {
        self.forward_fields(t, u);
        for over in &self.over {
            over.forward(t);
        }
        for predictor in &self.predictors {
            predictor.forward(t);
        }
        for linear in &self.linear {
            linear.forward(t);
        }
    }

    /// Computes parameters and fields, and leaves all else as it was: an operator over the surface takes milliseconds.
    pub fn forward_fields(&self, t: &mut Tape, u: &[f64]) {
        t.u.copy_from_slice(u);
        for range in &self.offsets {
            t.v[range.clone()].fill(0.0);
        }
        for prior in &self.priors {
            prior.forward(t);
        }
        for field in &self.fields {
            field.op.forward(t);
        }
    }

    /// Computes the values that [`Model::report`] and [`Model::let_values`] read. Where there is no `let` to
    /// report, these are the parameters, and the fields at all places are left as they were.
    pub fn forward_reported(&self, t: &mut Tape, u: &[f64]) {
        if !self.lets.is_empty() {
            return self.forward(t, u);
        }
        self.forward_parameters(t, u);
    }

    /// All that parameters need, and no `let`.
    pub fn forward_parameters(&self, t: &mut Tape, u: &[f64]) {
        t.u.copy_from_slice(u);
        for prior in &self.priors {
            prior.forward(t);
        }
    }

    /// Log density and gradient.
    pub fn ln_density(&self, t: &mut Tape, u: &[f64], gradient: &mut [f64]) -> f64 {
        self.forward(t, u);
        self.backward(t);
        gradient.copy_from_slice(&t.gu);
        t.lp
    }

    /// Log density and its gradient on the tape, after a forward pass.
    pub(super) fn backward(&self, t: &mut Tape) {
        self.backward_to_parameters(t);
        self.backward_of_parameters(t);
    }

    /// The first part of [`Model::backward`]: to the values of parameters.
    pub(super) fn backward_to_parameters(&self, t: &mut Tape) {
        t.lp = 0.0;
        t.g.fill(0.0);
        t.gu.fill(0.0);
        for observe in &self.observes {
            observe.op.backward(t);
        }
        for density in &self.densities {
            density.op.backward(t);
        }
        for linear in self.linear.iter().rev() {
            linear.backward(t);
        }
        for predictor in &self.predictors {
            predictor.backward(t);
        }
        for over in &self.over {
            over.backward(t);
        }
        for field in self.fields.iter().rev() {
            field.op.backward(t);
        }
    }

    /// The second part: from the values of parameters to the unknowns.
    pub(super) fn backward_of_parameters(&self, t: &mut Tape) {
        for prior in self.priors.iter().rev() {
            prior.backward(t);
        }
    }

    /// Log density without its gradient: the same number as [`Model::ln_density`] gives. Rows have value
    /// and slopes at once, so only what comes after them is saved.
    pub(super) fn ln_density_alone(&self, t: &mut Tape, u: &[f64]) -> f64 {
        self.forward(t, u);
        self.ln_density_of_values(t)
    }

    /// The same after a forward pass. It leaves the adjoints of what rows see.
    pub(super) fn ln_density_of_values(&self, t: &mut Tape) -> f64 {
        t.lp = 0.0;
        t.g.fill(0.0);
        t.gu.fill(0.0);
        self.observes.iter().for_each(|observe| observe.op.backward(t));
        self.densities.iter().for_each(|density| density.op.ln_density(t));
        self.fields.iter().rev().for_each(|field| field.op.ln_density(t));
        self.priors.iter().rev().for_each(|prior| prior.ln_density(t));
        t.lp
    }

    /// Log density of everything but the measurements, after a forward pass.
    pub(super) fn backward_without_rows(&self, t: &mut Tape) {
        t.lp = 0.0;
        t.g.fill(0.0);
        t.gu.fill(0.0);
        self.densities.iter().for_each(|density| density.op.backward(t));
        self.fields.iter().rev().for_each(|field| field.op.backward(t));
        self.priors.iter().rev().for_each(|prior| prior.backward(t));
    }
}
