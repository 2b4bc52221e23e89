//! Fields and parameters that shift normal measurements, integrated out.
//!
//! Where a model has an operator over the surface, a gradient costs milliseconds, and fields that are added to the operator's
//! numbers can stand for much of what it says: a chain that moves both moves slowly. But they integrate out. With w
//! their coefficients, of prior precision T, and C what these are multiplied by:
//!
//! ```text
//! y ~ N(m + D C w, W⁻¹)        P = T + C DᵀWD C        b = C DᵀW (y − m)
//! ln ∫ p(w) L dw = ln p(0) L(0) + ½ bᵀP⁻¹b − ½ ln |P| + const        w | y ~ N(P⁻¹b, P⁻¹)
//! ```
//! W rests during a trajectory. The gradient of the integral is that of p(w) L at w = P⁻¹b, and of −½ ln |P|. Between
//! trajectories C and W move under the integral, which costs no operator, and then w is drawn.

mod integral;
mod layout;
mod left_out;

use integral::Integrated;
use layout::Shifts;
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;

use super::blocked::Predictive;
use super::laid_out::Model;
use super::local::RowId;
use super::second::Hessian;
use super::tape::Op as _;
use crate::infer::{Evaluator, LogDensity};
use crate::num::vector::dot;

/// Steps of C and of W: some small, some large, and how often each is made.
const STEPS: [f64; 3] = [0.03, 0.1, 0.3];
const ROUNDS: usize = 8;

/// The density of a model with what shifts its measurements integrated out.
#[derive(Debug)]
struct WithoutShifts<'m>(Shifts<'m>);

impl Model {
    /// Of a model with an operator over the surface: its density with the fields and parameters integrated out that shift normal
    /// measurements; `None` if there are none. This is what [`Sampler::Nuts`](super::Sampler::Nuts) then samples: a position is one of the model's
    /// unknowns, and the density does not depend on those that are integrated out ([`Evaluator::ln_whole`] does).
    pub fn without_shifts(&self) -> Option<Box<dyn LogDensity + '_>> {
        Shifts::of(self).map(|shifts| Box::new(WithoutShifts(shifts)) as Box<dyn LogDensity>)
    }

    /// [`Model::predictive`] of a model with something that integrates out so; `None` of others.
    pub(super) fn predictive_without_shifts(
        &self,
        draws: &[Vec<f64>],
        rows: &[RowId],
        seed: u64,
    ) -> Option<Vec<Option<Predictive>>> {
        Shifts::of(self).map(|shifts| shifts.predictive(draws, rows, seed))
    }
}

impl Integrated<'_> {
    /// By how much the gradient changes with unknown `i`, on which C depends; 0 next to a place without support. What does
    /// not depend on C must be on the tape as it is at `position`.
    fn change(&mut self, position: &[f64], i: usize) -> Vec<f64> {
        const STEP: f64 = 1e-4;
        let (mut change, mut gradient) = (vec![0.0; position.len()], vec![0.0; position.len()]);
        for step in [-STEP, STEP] {
            let mut moved = position.to_vec();
            moved[i] += step;
            if !self.value_again(&moved).is_finite() {
                return vec![0.0; position.len()];
            }
            self.gradient(&moved, &mut gradient);
            change.iter_mut().zip(&gradient).for_each(|(sum, g)| *sum += g / (2.0 * step));
        }
        change
    }
}

impl LogDensity for WithoutShifts<'_> {
    fn dim(&self) -> usize {
        self.0.model.dim()
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        Box::new(Integrated::new(&self.0))
    }
    fn interwoven(&self) -> Option<Vec<usize>> {
        Some(self.0.resting.clone())
    }
    fn unclimbed(&self) -> Vec<usize> {
        [&self.0.resting[..], &self.0.shaping].concat()
    }
    fn draw_near(&self, draws: &[Vec<f64>]) -> bool {
        self.0.model.correct_at_draws(draws)
    }
}

impl Evaluator for Integrated<'_> {
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        let value = self.value_at(position);
        if value.is_finite() {
            self.gradient(position, gradient);
        } else {
            gradient.fill(0.0);
        }
        value
    }

    fn value(&mut self, position: &[f64]) -> f64 {
        self.value_at(position)
    }

    fn ln_whole(&mut self, position: &[f64], mut ln_density: f64) -> f64 {
        if self.last_at != self.at_zero(position) {
            ln_density = self.value_at(position);
        }
        let of = self.of;
        let from_mean = |j: &usize| {
            let c = &of.coefficients[*j];
            (position[c.unknown] - c.zero) / c.unit - self.mean[*j]
        };
        for (part, factor) in of.parts.iter().zip(self.known.iter().flat_map(|k| &k.factors)) {
            let d: Vec<f64> = part.of.iter().map(from_mean).collect();
            let z = factor.whitened(&d);
            ln_density += factor.ln_det() - 0.5 * dot::<4>(&z, &z);
        }
        ln_density
    }

    /// C and W move under the integral, what is integrated out is drawn, and then scales and means move as fields rest.
    fn interweave(
        &mut self,
        position: &mut [f64],
        gradient: &mut [f64],
        rng: &mut dyn Rng,
    ) -> Option<f64> {
        let mut here = self.value_at(position);
        let mut proposal = position.to_vec();
        for step in std::iter::repeat_n(STEPS, ROUNDS).flatten() {
            for moving in &self.of.moving {
                proposal.copy_from_slice(position);
                for u in moving {
                    proposal[*u] += step * rng.sample::<f64, _>(StandardNormal);
                }
                let there = self.value_again(&proposal);
                // NaN is not accepted
                if rng.random::<f64>().ln() < there - here {
                    position.copy_from_slice(&proposal);
                    here = there;
                }
            }
        }
        self.value_again(position);
        self.draw(position, rng);
        self.of.model.rescale_fields(&mut self.tape, position, rng);
        self.of.model.recentre_fields(&mut self.tape, position, rng);
        // fields are as they were, and so are the operators' numbers
        let value = self.value_again(position);
        self.of.model.fields.iter().for_each(|field| field.op.forward(&mut self.tape));
        self.gradient(position, gradient);
        // as they were but for rounding: a chain that goes on after an interruption computes them anew, so this one must, too
        self.position.clear();
        Some(value)
    }

    fn multipliers(&mut self, position: &[f64]) -> Vec<f64> {
        let mut all = self.of.model.multipliers(&mut self.tape, position);
        self.of.coefficients.iter().for_each(|c| all[c.unknown] = 0.0);
        all
    }

    fn ln_prior(&mut self, position: &[f64]) -> f64 {
        self.of.model.ln_prior_alone(&mut self.tape, position)
    }

    /// That of the integral: H − H(·, w) H(w, w)⁻¹ H(w, ·), where w has its mean; by differences in what C depends on. Of
    /// what rests it is −1.
    fn hessian(&mut self, position: &[f64], take: &mut dyn FnMut(usize, &[f64])) {
        let (of, dim) = (self.of, position.len());
        self.value_at(position);
        let shaped: Vec<Vec<f64>> = of.shaping.iter().map(|i| self.change(position, *i)).collect();
        self.value_again(position);
        let mut at = position.to_vec();
        self.put(&self.mean, &mut at);
        let mut whole = Hessian::at(of.model, &at, true);
        let mut columns: Vec<Option<(Vec<f64>, Vec<f64>)>> = vec![None; dim];
        let is_exact = |i: &usize| ![&of.resting, &of.shaping].iter().any(|of| of.contains(i));
        for i in (0..dim).filter(is_exact) {
            let mut column = whole.column(i).to_vec();
            let mut with_w = vec![];
            for (part, factor) in
                of.parts.iter().zip(self.known.iter().flat_map(|known| &known.factors))
            {
                let one =
                    |j: &usize| column[of.coefficients[*j].unknown] * of.coefficients[*j].unit;
                let mut own: Vec<f64> = part.of.iter().map(one).collect();
                factor.solve(&mut own);
                with_w.extend(own);
            }
            of.resting.iter().for_each(|i| column[*i] = 0.0);
            columns[i] = Some((column, with_w));
        }
        let mut out = vec![0.0; dim];
        for i in 0..dim {
            out.fill(0.0);
            if let Some((column, with_w)) = &columns[i] {
                for ((out, h), other) in out.iter_mut().zip(column).zip(&columns) {
                    *out = h + other.as_ref().map_or(0.0, |(_, other)| dot::<4>(with_w, other));
                }
                of.shaping.iter().zip(&shaped).for_each(|(j, shaped)| out[*j] = shaped[i]);
            } else if let Ok(at) = of.shaping.binary_search(&i) {
                out.copy_from_slice(&shaped[at]);
            } else {
                out[i] = -1.0;
            }
            take(i, &out);
        }
    }
}
