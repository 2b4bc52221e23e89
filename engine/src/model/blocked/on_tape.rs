//! The blocks of a model at one position of its unknowns.

use super::blocks::{Blocks, gaussian};
use crate::dist::Gaussian;
use crate::infer::{Design, Evaluator, Latent, LatentGaussian, Layout, LogDensity};
use crate::model::gp::Field;
use crate::model::laid_out::Model;
use crate::model::restore::{Seen, coefficients, weights_of};
use crate::model::row_line::{Line, Slope};
use crate::model::tape::{Op, Tape};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::ops::Range;

/// A model's block on a tape of its own.
pub(super) struct OnTape<'m> {
    pub(super) blocks: &'m Blocks<'m>,
    pub(super) tape: Tape,
    /// Where each block's latent values are on the tape.
    pub(super) theta: Vec<Range<usize>>,
    pub(super) c: Vec<f64>,
    pub(super) variances: Vec<f64>,
    pub(super) covariance: Vec<f64>,
}

/// A row as a function of the values at its place, at some outer unknowns.
struct RowAt {
    /// `[observe, row]`
    id: [usize; 2],
    base: Vec<f64>,
    slopes: Vec<Slope>,
    n_blocks: usize,
}

impl RowAt {
    /// Adds the row's log likelihood at each of these values `(n, n_blocks)`.
    fn add_lns(&self, model: &Model, theta: &[f64], out: &mut [f64]) {
        let Self { id: [observe, row], base, slopes, n_blocks } = self;
        let line = Line { base, slopes, n_blocks: *n_blocks };
        model.observes[*observe].op.add_lns(*row, line, theta, out);
    }
}

impl OnTape<'_> {
    /// Computes the values of everything but the fields, from the outer unknowns.
    pub(super) fn forward(&mut self, outer: &[f64]) {
        let (model, t) = (self.blocks.model, &mut self.tape);
        for (u, x) in self.blocks.layout.outer.iter().zip(outer) {
            t.u[*u] = *x;
        }
        model.priors.iter().for_each(|prior| prior.forward(t));
        self.blocks.model.set_offsets(&mut self.tape);
    }

    fn set_latent(&mut self, theta: &[f64]) {
        let mut first = 0;
        for at in &self.theta {
            self.tape.v[at.clone()].copy_from_slice(&theta[first..][..at.len()]);
            first += at.len();
        }
        for block in &self.blocks.places {
            block.set_values(&theta[first..], &mut self.tape);
            first += block.n();
        }
        for block in &self.blocks.free {
            block.set_values(&theta[first..][..block.n()], &mut self.tape);
            first += block.n();
        }
        if !(self.blocks.places.is_empty() && self.blocks.free.is_empty()) {
            self.blocks.model.set_offsets(&mut self.tape);
        }
    }

    /// Sets the latent values of one place of a group.
    pub(super) fn set_place(&mut self, group: usize, place: usize, theta: &[f64]) {
        let fields = self.blocks.fields.iter().zip(&self.theta);
        let own = fields.filter(|(block, _)| block.at.0 == group).map(|(_, at)| at.start + place);
        let n_fields = own.zip(theta).map(|(at, x)| self.tape.v[at] = *x).count();
        if self.blocks.places.is_empty() {
            return;
        }
        for (block, x) in self.blocks.places.iter().zip(&theta[n_fields..]) {
            block.set_value(place, *x, &mut self.tape);
        }
        self.blocks.model.set_offsets(&mut self.tape);
    }

    /// The rows of a place. Their numbers are linear in the values there.
    fn rows_at(&mut self, [group, place]: [usize; 2], n_blocks: usize) -> Vec<RowAt> {
        let rows = &self.blocks.rows[group][place];
        let mut at = |theta: &[f64]| {
            self.set_place(group, place, theta);
            rows.iter().map(|[observe, row]| self.numbers(*observe, *row)).collect::<Vec<_>>()
        };
        let mut one = vec![0.0; n_blocks];
        let base = at(&one);
        let mut slopes: Vec<Vec<Slope>> = vec![vec![]; rows.len()];
        for block in 0..n_blocks {
            one[block] = 1.0;
            for ((slopes, base), numbers) in slopes.iter_mut().zip(&base).zip(at(&one)) {
                let changes = base.iter().zip(&numbers).map(|(base, x)| x - base).enumerate();
                let changes = changes.filter(|(_, change)| *change != 0.0);
                slopes.extend(changes.map(|(number, per_unit)| Slope { number, block, per_unit }));
            }
            one[block] = 0.0;
        }
        let row = |((id, base), slopes)| RowAt { id, base, slopes, n_blocks };
        rows.iter().copied().zip(base).zip(slopes).map(row).collect()
    }

    /// The numbers that the likelihood of a row depends on.
    fn numbers(&self, observe: usize, row: usize) -> Vec<f64> {
        self.blocks.model.observes[observe].op.place.numbers_at(&self.tape.v, row)
    }

    fn latent_slope(&self, theta_bar: &mut [f64]) {
        let mut first = 0;
        for at in &self.theta {
            theta_bar[first..][..at.len()].copy_from_slice(&self.tape.g[at.clone()]);
            first += at.len();
        }
        for block in &self.blocks.places {
            block.slopes(&self.tape, &mut theta_bar[first..][..block.n()]);
            first += block.n();
        }
        for block in &self.blocks.free {
            block.slopes(&self.tape, &mut theta_bar[first..][..block.n()]);
            first += block.n();
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

    fn set_designs(&mut self, designs: &mut [Design]) {
        let blocks = self.blocks;
        for block in &blocks.fields {
            let op = &blocks.model.fields[block.field].op;
            let (group, f) = block.at;
            let design = &mut designs[group];
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
            if block.is_triangular {
                let n = op.n_probes();
                let covariance = &mut self.covariance[..n * (n + 1) / 2];
                block.lower(&self.variances[..op.k], covariance, rows, width);
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
        for (f, block) in (blocks.fields.len()..).zip(&blocks.places) {
            let Design { offset, rows, scale } = &mut designs[0];
            let own = (&mut offset[f], &mut rows[f][..], &mut scale[f][..]);
            block.set_design(blocks.model, &self.tape.v, own);
        }
        let mut first = 0;
        for block in &blocks.free {
            let Design { offset, scale, .. } = &mut designs[blocks.layout.groups.len()];
            let own = (&mut offset[first..][..block.n()], &mut scale[0][first..][..block.n()]);
            block.set_design(blocks.model, &self.tape.v, own);
            first += block.n();
        }
    }
}

impl Latent for OnTape<'_> {
    fn coefficients(&mut self, position: &[f64], out: &mut [f64]) {
        let outer: Vec<f64> = self.blocks.layout.outer.iter().map(|u| position[*u]).collect();
        self.forward(&outer);
        let model = self.blocks.model;
        let mut at = 0;
        for field in &self.blocks.fields {
            let op = &model.fields[field.field].op;
            let w = coefficients(op, &field.modes, &self.tape.v, position, field.is_triangular);
            out[at..][..w.len()].copy_from_slice(&w);
            at += w.len();
            if let Some(prior) = field.mean {
                let Gaussian { location, scale, .. } = gaussian(model, prior, &self.tape.v);
                out[at] = (position[model.prior_entries[prior].u.start] - location) / scale;
                at += 1;
            }
        }
        for block in &self.blocks.places {
            block.coefficients(position, &mut out[at..]);
            at += block.n();
        }
        for block in &self.blocks.free {
            block.coefficients(model, &mut self.tape, position, &mut out[at..][..block.n()]);
            at += block.n();
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
        for field in &self.blocks.fields {
            let op = &model.fields[field.field].op;
            let n = self.blocks.layout.groups[field.at.0].blocks[field.at.1].n_coefficients;
            let seen = Seen { w: &block[at..][..n], is_collapsed: field.is_triangular };
            weights_of(op, &field.modes, &self.tape.v, &seen, rng, position);
            at += n;
            if let Some(prior) = field.mean {
                let Gaussian { location, scale, .. } = gaussian(model, prior, &self.tape.v);
                position[model.prior_entries[prior].u.start] = location + scale * block[at];
                at += 1;
            }
        }
        for places in &self.blocks.places {
            places.put(&block[at..], position);
            at += places.n();
        }
        for free in &self.blocks.free {
            free.put(model, &self.tape, &block[at..][..free.n()], position);
            at += free.n();
        }
        model.ln_density_alone(&mut self.tape, position)
    }

    fn set_outer(&mut self, outer: &[f64], designs: &mut [Design]) -> f64 {
        self.forward(outer);
        self.set_designs(designs);
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

    fn ln_likelihoods(&mut self, [group, place]: [usize; 2], theta: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for row in self.rows_at([group, place], theta.len() / out.len()) {
            row.add_lns(self.blocks.model, theta, out);
        }
    }

    fn ln_of_rows(&mut self, at: [usize; 2], theta: &[f64]) -> Vec<Vec<f64>> {
        let n_blocks = self.blocks.layout.groups[at[0]].blocks.len();
        let one = |row: RowAt| {
            let mut out = vec![0.0; theta.len() / n_blocks];
            row.add_lns(self.blocks.model, theta, &mut out);
            out
        };
        self.rows_at(at, n_blocks).into_iter().map(one).collect()
    }

    fn slope(&mut self, theta: &[f64], theta_bar: &mut [f64]) -> f64 {
        self.set_latent(theta);
        let t = &mut self.tape;
        t.lp = 0.0;
        t.g.fill(0.0);
        let model = self.blocks.model;
        for observe in &model.observes {
            observe.op.backward(t);
        }
        model.linear.iter().rev().for_each(|linear| linear.backward(t));
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
        self.blocks.priors().rev().for_each(|prior| prior.backward(t));
        for (bar, u) in outer_bar.iter_mut().zip(&self.blocks.layout.outer) {
            *bar = t.gu[*u];
        }
        t.lp
    }
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
    fn prior_outer(&self, n: usize, rng: &mut ChaCha8Rng) -> Option<Vec<Vec<f64>>> {
        let draws = self.model.plausible(n, rng)?;
        Some(draws.iter().map(|draw| self.layout.outer_of(draw)).collect())
    }
    fn latent(&self) -> Box<dyn Latent + '_> {
        Box::new(self.on_tape())
    }
}

impl Blocks<'_> {
    /// Memory to evaluate them with.
    pub(super) fn on_tape(&self) -> OnTape<'_> {
        let k = self.model.fields.iter().map(|f| f.op.k).max().unwrap_or(0);
        let ops = || self.fields.iter().map(|block| &self.model.fields[block.field].op);
        let triangular = self.fields.iter().filter(|block| block.is_triangular);
        let n = triangular.map(|block| self.model.fields[block.field].op.n_probes());
        let n = n.max().unwrap_or(0);
        OnTape {
            blocks: self,
            tape: self.model.tape(),
            theta: ops().map(|op| op.theta..op.theta + op.n_probes()).collect(),
            c: vec![0.0; k],
            variances: vec![0.0; k],
            covariance: vec![0.0; n * (n + 1) / 2],
        }
    }
}
