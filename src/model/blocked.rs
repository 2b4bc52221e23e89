//! A model's fields as the blocks of [`sample_blocked`]: which unknowns are in them, and their design.
//!
//! ```text
//! Σ_terms amplitude √S_k η_k = √s_k ζ_k      s_k = Σ_terms (amplitude √S_k)²
//! ```
//! so that the terms of a field are one term with ζ standard normal. With fewer sites than modes, the
//! sites see only n combinations w of them: θ = mean + L w with L Lᵀ = Φ diag(s) Φᵀ. A mean with a
//! normal or flat prior that nothing else mentions is in the block too, as location + scale w; the
//! rest of the unknowns is outer. What the sites do not see is drawn from its exact conditional
//! ([`restore`](super::restore)).

use std::collections::BTreeSet;

use super::gp::Field;
use super::model::Model;
use super::restore::{Seen, coefficients, weights_of};
use super::tape::{Op, Tape, add_rows};
use crate::dist::Gaussian;
use crate::infer::{
    self, BlockLayout, ChainResult, Design, Evaluator, InferError, Latent, LatentGaussian, Layout,
    LogDensity, Progress, Settings, Shape, sample_blocked,
};
use rand::Rng;

/// Which sampler a model is sampled with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampler {
    /// Fields whitened in a block, their hyperparameters by Metropolis, the rest by NUTS.
    Blocked,
    /// NUTS on all unknowns.
    Nuts,
}

impl Sampler {
    /// The blocked sampler for every model with fields that measurements see; NUTS for others.
    pub fn of(model: &Model) -> Self {
        let seen = |f: &super::model::FieldEntry| f.op.k > 0 && f.op.n_probes() > 0;
        if model.has_fields() && model.fields.iter().all(seen) { Self::Blocked } else { Self::Nuts }
    }

    /// Its name for tables and records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Blocked => "blocked",
            Self::Nuts => "nuts",
        }
    }

    /// Samples `model`; the draws are its own unknowns whichever sampler it is.
    ///
    /// # Errors
    /// Those of [`infer::sample`].
    pub fn sample(
        self,
        model: &Model,
        starts: &[Vec<f64>],
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Result<Vec<ChainResult>, InferError> {
        match self {
            Self::Blocked => sample_blocked(&Blocks::new(model), starts, settings, progress),
            Self::Nuts => infer::sample(model, starts, settings, progress),
        }
    }
}

/// A model seen as a [`LatentGaussian`].
#[derive(Debug)]
pub(super) struct Blocks<'m> {
    pub(super) model: &'m Model,
    pub(super) layout: Layout,
    pub(super) fields: Vec<Block>,
}

/// What is precomputed of one field.
#[derive(Debug)]
pub(super) struct Block {
    /// Which of the model's priors is that of its mean, if that is in the block.
    mean: Option<usize>,
    /// The sites' modes `(n_sites, k)`, without padding.
    pub(super) modes: Vec<f64>,
    /// Products φᵢ φⱼ of every pair of sites j ≤ i `(k, pairs)`; empty unless the sites are fewer.
    products: Vec<f64>,
}

impl<'m> Blocks<'m> {
    /// With a coefficient per site or per mode, whichever are fewer.
    pub(super) fn new(model: &'m Model) -> Self {
        let n_latent: usize = model.fields.iter().map(|f| f.op.n_probes()).sum();
        let n_modes: usize = model.fields.iter().map(|f| f.op.k).sum();
        Self::shaped(model, n_latent < n_modes)
    }

    /// With a coefficient per site (triangular designs) or per mode: either is exact.
    fn shaped(model: &'m Model, is_triangular: bool) -> Self {
        let ops = || model.fields.iter().map(|f| &f.op);
        let n_sites = ops().map(Field::n_probes).next().unwrap_or(0);
        let values = model.tape().v;
        let fields: Vec<Block> = ops().map(|op| Block::new(model, op, is_triangular)).collect();
        let layout = |(op, block): (&Field, &Block)| BlockLayout {
            n_coefficients: if is_triangular { n_sites } else { op.k },
            mean_precision: block.mean.map(|prior| gaussian(model, prior, &values).precision),
            shape: if is_triangular {
                Shape::Triangular
            } else {
                Shape::Scaled(block.modes.clone())
            },
        };
        let outer = outer(model, &fields);
        let is_hyper = hyperparameters(model, &fields);
        let layout = Layout {
            n_seen: n_sites,
            blocks: ops().zip(&fields).map(layout).collect(),
            hyper: (0..outer.len()).filter(|i| is_hyper.contains(&outer[*i])).collect(),
            outer,
        };
        Self { model, layout, fields }
    }

    /// The priors of outer unknowns.
    fn priors(&self) -> impl DoubleEndedIterator<Item = &dyn Op> {
        let is_outer = |prior: &usize| self.fields.iter().all(|block| block.mean != Some(*prior));
        (0..self.model.priors.len()).filter(is_outer).map(|prior| &*self.model.priors[prior])
    }
}

/// The prior of a mean that is in the block, at these values.
#[allow(clippy::expect_used, reason = "a mean is in the block because its prior is")]
fn gaussian(model: &Model, prior: usize, values: &[f64]) -> Gaussian {
    model.priors[prior].gaussian(values).expect("normal or flat")
}

impl Block {
    fn new(model: &Model, op: &Field, is_triangular: bool) -> Self {
        let values = model.tape().v;
        let is_mean = |prior: &usize| {
            op.lone_mean == Some(model.prior_entries[*prior].v)
                && model.priors[*prior].gaussian(&values).is_some()
        };
        let mean = (0..model.priors.len()).find(is_mean);
        let rows = || op.probes.chunks_exact(op.stride).map(|row| &row[..op.k]);
        let mut products = vec![];
        for k in 0..op.k {
            for (i, left) in rows().enumerate().filter(|_| is_triangular) {
                products.extend(rows().take(i + 1).map(|right| left[k] * right[k]));
            }
        }
        Self { mean, modes: rows().flatten().copied().collect(), products }
    }

    /// L of the covariance with these variances of the modes. A site that the earlier ones
    /// determine to rounding has a zero column.
    fn lower(&self, variances: &[f64], covariance: &mut [f64], rows: &mut [f64], width: usize) {
        const ROUNDING: f64 = 1e-13;
        covariance.fill(0.0);
        add_rows(variances, &self.products, covariance);
        let mut at = 0;
        for i in 0..rows.len() / width {
            let (done, rest) = rows.split_at_mut(i * width);
            let row = &mut rest[..width];
            for j in 0..i {
                let other = &done[j * width..][..=j];
                let pivot = other[j];
                let sum: f64 = row.iter().zip(&other[..j]).map(|(a, b)| a * b).sum();
                row[j] = if pivot > 0.0 { (covariance[at + j] - sum) / pivot } else { 0.0 };
            }
            let variance = covariance[at + i];
            let left = variance - row[..i].iter().map(|x| x * x).sum::<f64>();
            row[i] = if left > ROUNDING * variance { left.sqrt() } else { 0.0 };
            at += i + 1;
        }
    }
}

/// Unknowns that are neither coefficients of a GP term nor a mean in the block.
fn outer(model: &Model, fields: &[Block]) -> Vec<usize> {
    let is_outer = |(prior, _): &(usize, _)| fields.iter().all(|block| block.mean != Some(*prior));
    let entries = model.prior_entries.iter().enumerate().filter(is_outer);
    entries.flat_map(|(_, entry)| entry.u.clone()).collect()
}

/// Unknowns that a field's mean, amplitudes and kernels depend on, also through their priors.
fn hyperparameters(model: &Model, fields: &[Block]) -> BTreeSet<usize> {
    let mut values: BTreeSet<usize> = BTreeSet::new();
    for (entry, block) in model.fields.iter().zip(fields) {
        for term in &entry.op.terms {
            values.extend(term.amplitude.mentions());
            values.extend(term.spectrum.mentions());
        }
        values.extend(match block.mean {
            Some(prior) => model.prior_entries[prior].mentions.clone(),
            None => entry.op.mean.mentions(),
        });
    }
    let mut unknowns = BTreeSet::new();
    // a prior mentions only earlier parameters
    for entry in model.prior_entries.iter().rev() {
        // one that is mentioned takes its vector along: its numbers may depend on each other
        if values.range(entry.v..entry.v + entry.len).next().is_some() {
            values.extend(&entry.mentions);
            unknowns.extend(entry.u.clone());
        }
    }
    unknowns
}

impl LogDensity for Blocks<'_> {
    fn dim(&self) -> usize {
        self.model.dim()
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        self.model.evaluator()
    }
}

impl LatentGaussian for Blocks<'_> {
    fn layout(&self) -> &Layout {
        &self.layout
    }
    fn latent(&self) -> Box<dyn Latent + '_> {
        let k = self.model.fields.iter().map(|f| f.op.k).max().unwrap_or(0);
        let n = self.layout.n_seen;
        Box::new(OnTape {
            blocks: self,
            tape: self.model.tape(),
            theta: self.model.fields.iter().map(|f| f.op.theta).collect(),
            c: vec![0.0; k],
            variances: vec![0.0; k],
            covariance: vec![0.0; n * (n + 1) / 2],
            gradient: vec![0.0; self.model.dim()],
        })
    }
}

/// A model's block on a tape of its own.
struct OnTape<'m> {
    blocks: &'m Blocks<'m>,
    tape: Tape,
    /// First latent value of each field on the tape.
    theta: Vec<usize>,
    c: Vec<f64>,
    variances: Vec<f64>,
    covariance: Vec<f64>,
    gradient: Vec<f64>,
}

impl OnTape<'_> {
    /// Values of everything but the fields, from outer unknowns.
    fn forward(&mut self, outer: &[f64]) {
        let (model, t) = (self.blocks.model, &mut self.tape);
        for (u, x) in self.blocks.layout.outer.iter().zip(outer) {
            t.u[*u] = *x;
        }
        for range in &model.offsets {
            t.v[range.clone()].fill(0.0);
        }
        model.priors.iter().for_each(|prior| prior.forward(t));
        model.linear.iter().for_each(|linear| linear.forward(t));
    }

    fn set_latent(&mut self, theta: &[f64]) {
        let n = self.blocks.layout.n_seen;
        for (at, theta) in self.theta.iter().zip(theta.chunks_exact(n)) {
            self.tape.v[*at..][..n].copy_from_slice(theta);
        }
    }

    fn latent_slope(&self, theta_bar: &mut [f64]) {
        let n = self.blocks.layout.n_seen;
        for (at, bar) in self.theta.iter().zip(theta_bar.chunks_exact_mut(n)) {
            bar.copy_from_slice(&self.tape.g[*at..][..n]);
        }
    }

    /// The variances s of one field's modes at the tape's hyperparameters.
    fn set_variances(&mut self, op: &Field) {
        self.variances.fill(0.0);
        for term in &op.terms {
            let amplitude = term.amplitude.value(&self.tape.v);
            let c = &mut self.c[..term.k];
            term.spectrum.values(&self.tape.v, &op.frequency[..term.k], c);
            for (s, c) in self.variances.iter_mut().zip(c) {
                *s += (amplitude * *c) * (amplitude * *c);
            }
        }
    }

    fn set_design(&mut self, design: &mut Design) {
        let blocks = self.blocks;
        for (f, (entry, block)) in blocks.model.fields.iter().zip(&blocks.fields).enumerate() {
            let op = &entry.op;
            let width = design.scale[f].len();
            let rows = &mut design.rows[f];
            if let Some(prior) = block.mean {
                let Gaussian { location, scale, .. } = gaussian(blocks.model, prior, &self.tape.v);
                design.offset[f] = location;
                design.scale[f][width - 1] = scale;
                rows.chunks_exact_mut(width).for_each(|row| row[width - 1] = scale);
            } else {
                design.offset[f] = op.mean.value(&self.tape.v);
            }
            self.set_variances(op);
            if matches!(blocks.layout.blocks[f].shape, Shape::Triangular) {
                block.lower(&self.variances[..op.k], &mut self.covariance, rows, width);
                continue;
            }
            for (c, s) in design.scale[f].iter_mut().zip(&self.variances[..op.k]) {
                *c = s.sqrt();
            }
            for (row, modes) in rows.chunks_exact_mut(width).zip(block.modes.chunks_exact(op.k)) {
                for ((x, mode), c) in row.iter_mut().zip(modes).zip(&design.scale[f]) {
                    *x = mode * c;
                }
            }
        }
    }
}

impl Latent for OnTape<'_> {
    fn coefficients(&mut self, position: &[f64], out: &mut [f64]) {
        let outer: Vec<f64> = self.blocks.layout.outer.iter().map(|u| position[*u]).collect();
        self.forward(&outer);
        let model = self.blocks.model;
        let mut at = 0;
        for (entry, field) in model.fields.iter().zip(&self.blocks.fields) {
            let w =
                coefficients(&entry.op, &field.modes, &self.tape.v, position, self.is_collapsed());
            out[at..][..w.len()].copy_from_slice(&w);
            at += w.len();
            if let Some(prior) = field.mean {
                let Gaussian { location, scale, .. } = gaussian(model, prior, &self.tape.v);
                out[at] = (position[model.prior_entries[prior].u.start] - location) / scale;
                at += 1;
            }
        }
    }

    fn join(
        &mut self,
        outer: &[f64],
        block: &[f64],
        rng: &mut dyn Rng,
        position: &mut [f64],
    ) -> f64 {
        self.forward(outer);
        for (u, x) in self.blocks.layout.outer.iter().zip(outer) {
            position[*u] = *x;
        }
        let model = self.blocks.model;
        let mut at = 0;
        for (f, (entry, field)) in model.fields.iter().zip(&self.blocks.fields).enumerate() {
            let n = self.blocks.layout.blocks[f].n_coefficients;
            let seen = Seen { w: &block[at..][..n], is_collapsed: self.is_collapsed() };
            weights_of(&entry.op, &field.modes, &self.tape.v, &seen, rng, position);
            at += n;
            if let Some(prior) = field.mean {
                let Gaussian { location, scale, .. } = gaussian(model, prior, &self.tape.v);
                position[model.prior_entries[prior].u.start] = location + scale * block[at];
                at += 1;
            }
        }
        model.ln_density(&mut self.tape, position, &mut self.gradient)
    }

    fn set_outer(&mut self, outer: &[f64], design: &mut Design) -> f64 {
        self.forward(outer);
        self.set_design(design);
        let (model, t) = (self.blocks.model, &mut self.tape);
        t.lp = 0.0;
        model.densities.iter().for_each(|density| density.op.backward(t));
        self.blocks.priors().for_each(|prior| prior.backward(t));
        t.lp
    }

    fn ln_likelihood(&mut self, theta: &[f64]) -> f64 {
        self.set_latent(theta);
        // with its gradient, which is asked of many rows at once: faster than the terms row by row
        self.tape.lp = 0.0;
        for observe in &self.blocks.model.observes {
            observe.op.backward(&mut self.tape);
        }
        self.tape.lp
    }

    fn slope(&mut self, theta: &[f64], theta_bar: &mut [f64]) -> f64 {
        self.set_latent(theta);
        let t = &mut self.tape;
        t.lp = 0.0;
        t.g.fill(0.0);
        for observe in &self.blocks.model.observes {
            observe.op.backward(t);
        }
        let value = t.lp;
        self.latent_slope(theta_bar);
        value
    }

    fn slopes(
        &mut self,
        outer: &[f64],
        theta: &[f64],
        theta_bar: &mut [f64],
        outer_bar: &mut [f64],
    ) -> f64 {
        self.forward(outer);
        self.tape.gu.fill(0.0);
        self.slope(theta, theta_bar);
        let (model, t) = (self.blocks.model, &mut self.tape);
        model.densities.iter().for_each(|density| density.op.backward(t));
        model.linear.iter().rev().for_each(|linear| linear.backward(t));
        self.blocks.priors().rev().for_each(|prior| prior.backward(t));
        for (bar, u) in outer_bar.iter_mut().zip(&self.blocks.layout.outer) {
            *bar = t.gu[*u];
        }
        t.lp
    }
}

impl OnTape<'_> {
    fn is_collapsed(&self) -> bool {
        self.blocks.layout.blocks.iter().any(|f| matches!(f.shape, Shape::Triangular))
    }
}

#[cfg(test)]
#[path = "blocked_tests.rs"]
mod tests;
