//! Which unknowns are in blocks, and what makes a block's design.

use std::collections::BTreeSet;

use crate::dist::Gaussian;
use crate::infer::{BlockLayout, Layout, Shape};
use crate::model::gp::Field;
use crate::model::laid_out::Model;
use crate::model::tape::{Op, add_rows};

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
    pub(super) mean: Option<usize>,
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
    pub(super) fn shaped(model: &'m Model, is_triangular: bool) -> Self {
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
    pub(super) fn priors(&self) -> impl DoubleEndedIterator<Item = &dyn Op> {
        let is_outer = |prior: &usize| self.fields.iter().all(|block| block.mean != Some(*prior));
        (0..self.model.priors.len()).filter(is_outer).map(|prior| &*self.model.priors[prior])
    }
}

/// The prior of a mean that is in the block, at these values.
#[allow(clippy::expect_used, reason = "a mean is in the block because its prior is")]
pub(super) fn gaussian(model: &Model, prior: usize, values: &[f64]) -> Gaussian {
    model.priors[prior].gaussian(values).expect("normal or flat")
}

impl Block {
    pub(super) fn new(model: &Model, op: &Field, is_triangular: bool) -> Self {
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
    pub(super) fn lower(
        &self,
        variances: &[f64],
        covariance: &mut [f64],
        rows: &mut [f64],
        width: usize,
    ) {
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
pub(super) fn outer(model: &Model, fields: &[Block]) -> Vec<usize> {
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
