//! The two conditionals that the sampler alternates between, at one state of a chain.
//!
//! - *Inner*: the whitened coefficients z and the free outer unknowns, given the hyperparameters.
//!   This is the density of the trajectories. The Cholesky factor U is fixed in it, so that no
//!   derivative goes through U.
//! - *Hyper*: the hyperparameters, given z and the rest. Each value takes one factorisation and one
//!   likelihood.

use super::anchors::Guide;
use super::groups::Whitening;
use super::latent::{Latent, Layout};
use super::meeting::Shared;
use super::particles::Here;
use super::stand_in::Sample;
use super::swaps::Swap;
use crate::infer::density::Evaluator;
use crate::num::vector::dot;
use rand::{Rng, RngExt as _};
use std::mem;
use std::sync::Arc;

/// So many latent values for each coefficient are many.
const MANY: usize = 4;
/// Proposals of a swap, one after the other: to add it or to take it away.
const SWAPS: usize = 2;

/// A chain's state with the memory to evaluate both conditionals.
pub(super) struct Conditional<'d> {
    latent: Box<dyn Latent + 'd>,
    layout: &'d Layout,
    shared: Arc<Shared>,
    /// Outer unknowns that are no hyperparameters.
    free: Vec<usize>,
    pub(super) outer: Vec<f64>,
    whitening: Whitening,
    /// ln p(outer) at the present values of the outer unknowns.
    ln_prior: f64,
    trial_outer: Vec<f64>,
    trial: Whitening,
    /// How often moves of the hyperparameters have evaluated the likelihood.
    pub(super) n_trials: u64,
    w: Vec<f64>,
    theta: Vec<f64>,
    slope: Vec<f64>,
    outer_bar: Vec<f64>,
    scratch: Vec<f64>,
}

impl<'d> Conditional<'d> {
    /// At a chain's outer unknowns; `None` if they have no support.
    pub(super) fn new(
        latent: Box<dyn Latent + 'd>,
        layout: &'d Layout,
        shared: Arc<Shared>,
        outer: &[f64],
    ) -> Option<Self> {
        let whitening = Whitening::new(layout);
        let n_latent = layout.n_latent();
        let mut new = Self {
            latent,
            layout,
            shared,
            free: layout.free(),
            outer: outer.to_vec(),
            trial: whitening.clone(),
            whitening,
            ln_prior: 0.0,
            trial_outer: outer.to_vec(),
            n_trials: 0,
            w: vec![0.0; layout.n_coefficients()],
            theta: vec![0.0; n_latent],
            slope: vec![0.0; n_latent],
            outer_bar: vec![0.0; outer.len()],
            scratch: vec![0.0; n_latent],
        };
        new.ln_prior = new.latent.set_outer(&new.outer, &mut new.whitening.designs);
        if !new.ln_prior.is_finite() || !new.whitening.prepare(&new.shared.stand_in) {
            return None;
        }
        new.whitening.set_basis();
        Some(new)
    }

    /// The inner position of these coefficients at the present outer unknowns.
    pub(super) fn position(&self, coefficients: &[f64]) -> Vec<f64> {
        let mut z = vec![0.0; coefficients.len()];
        self.whitening.whitened(coefficients, &mut z);
        z.extend(self.free.iter().map(|i| self.outer[*i]));
        z
    }

    /// The coefficients at an inner position.
    pub(super) fn coefficients(&mut self, position: &[f64]) -> &[f64] {
        self.whitening.coefficients(&position[..self.w.len()], &mut self.w);
        &self.w
    }

    /// Whether what the inner move moves is nearly standard normal: whitened coefficients alone, or those of fields
    /// that are seen at so many places that other unknowns are nearly normal, too.
    pub(super) fn is_nearly_normal(&self) -> bool {
        self.free.is_empty() || self.layout.n_latent() >= MANY * self.layout.n_coefficients()
    }

    /// Whether there are hyperparameters to move.
    pub(super) fn has_hyper(&self) -> bool {
        !self.layout.hyper.is_empty()
    }

    /// Writes the present hyperparameters.
    pub(super) fn hyper(&self, hyper: &mut [f64]) {
        for (h, i) in hyper.iter_mut().zip(&self.layout.hyper) {
            *h = self.outer[*i];
        }
    }

    /// Proposes these hyperparameters, while z and the rest stay as they are. Moves there with the
    /// Metropolis–Hastings probability, which is returned. `ln_ratio` is the proposal's own part of
    /// that probability. `ln_density` is the present log density and is kept up to date. `uniform`,
    /// a uniform random number, decides.
    pub(super) fn move_hyper(
        &mut self,
        position: &[f64],
        proposed: &[f64],
        ln_ratio: f64,
        uniform: f64,
        ln_density: &mut f64,
    ) -> f64 {
        self.propose(proposed);
        let Some((value, ln_prior)) = self.try_outer(&position[..self.w.len()]) else { return 0.0 };
        let accept = (value - *ln_density + ln_ratio).exp().min(1.0);
        if uniform < accept {
            mem::swap(&mut self.whitening, &mut self.trial);
            mem::swap(&mut self.outer, &mut self.trial_outer);
            self.ln_prior = ln_prior;
            *ln_density = value;
        }
        if accept.is_nan() { 0.0 } else { accept }
    }

    /// ln π at the trial's outer unknowns and this z, and ln p(outer); `None` out of support.
    fn try_outer(&mut self, z: &[f64]) -> Option<(f64, f64)> {
        let ln_prior = self.latent.set_outer(&self.trial_outer, &mut self.trial.designs);
        self.n_trials += 1;
        if !ln_prior.is_finite() || !self.trial.prepare(&self.shared.stand_in) {
            return None;
        }
        self.trial.coefficients(z, &mut self.w);
        self.trial.latent(&self.w, &mut self.theta);
        let likelihood = self.latent.ln_likelihood(&self.theta);
        let value = ln_prior + likelihood + self.stand_in_quadratic() + self.trial.ln_evidence
            - 0.5 * dot::<4>(z, z);
        (!value.is_nan()).then_some((value, ln_prior))
    }

    /// Makes these hyperparameters, with the other outer unknowns as they are, those of the trial.
    fn propose(&mut self, hyper: &[f64]) {
        self.trial_outer.copy_from_slice(&self.outer);
        for (i, h) in self.layout.hyper.iter().zip(hyper) {
            self.trial_outer[*i] = *h;
        }
    }

    /// ln of an estimate of the posterior density of the present outer unknowns, in which the coefficients of this
    /// position are one particle. What is not a number tells that there is none.
    pub(super) fn estimate(&mut self, position: &[f64], guide: &Guide, rng: &mut impl Rng) -> f64 {
        self.whitening.coefficients(&position[..self.w.len()], &mut self.w);
        // the free unknowns may have moved since it was computed last
        let ln_prior = self.latent.set_outer(&self.outer, &mut self.trial.designs);
        self.trial.latent(&self.w, &mut self.theta);
        let Some(here) = Here::new(self.layout, &guide.lookahead, &mut self.trial) else {
            return f64::NAN;
        };
        self.n_trials += guide.n_particles as u64;
        ln_prior + here.at(&mut *self.latent, guide.n_particles, &self.theta, rng)
    }

    /// Proposes these outer unknowns with new coefficients, which take their place in `position`. Moves there with
    /// the Metropolis–Hastings probability. `ln_ratio` is the proposal's own part of it. `present` is ln of the
    /// estimate at the present outer unknowns, and is kept up to date.
    pub(super) fn leap(
        &mut self,
        (proposed, guide): (&[f64], &Guide),
        ln_ratio: f64,
        (position, present): (&mut [f64], &mut f64),
        rng: &mut impl Rng,
    ) -> bool {
        self.trial_outer.copy_from_slice(proposed);
        let ln_prior = self.latent.set_outer(&self.trial_outer, &mut self.trial.designs);
        if !ln_prior.is_finite() {
            return false;
        }
        let Some(here) = Here::new(self.layout, &guide.lookahead, &mut self.trial) else {
            return false;
        };
        let mut z = vec![0.0; self.w.len()];
        self.n_trials += guide.n_particles as u64;
        let value = ln_prior + here.draw(&mut *self.latent, guide.n_particles, &mut z, rng);
        // written so that what is not a number is refused
        if !(rng.random::<f64>().ln() < value - *present + ln_ratio) {
            return false;
        }
        self.trial.coefficients(&z, &mut self.w);
        if !self.trial.prepare(&self.shared.stand_in) {
            return false;
        }
        mem::swap(&mut self.whitening, &mut self.trial);
        mem::swap(&mut self.outer, &mut self.trial_outer);
        self.ln_prior = ln_prior;
        let (z, free) = position.split_at_mut(z.len());
        self.whitening.whitened(&self.w, z);
        free.iter_mut().zip(&self.free).for_each(|(x, i)| *x = self.outer[*i]);
        *present = value;
        true
    }

    /// Proposes to add `swap` to the values of its places, or to take it away, a few times; whether it has changed
    /// `position`. Its free unknowns must have been taken.
    pub(super) fn swap(&mut self, swap: &Swap, position: &mut [f64], rng: &mut impl Rng) -> bool {
        let Some((coefficients, step)) = swap.step(&self.whitening, self.layout) else {
            return false;
        };
        let n = self.w.len();
        let mut present = self.ln_given_outer(&position[..n]);
        let mut moved = false;
        for _ in 0..SWAPS {
            let sign = if rng.random() { 1.0 } else { -1.0 };
            let mut z = position[..n].to_vec();
            z[coefficients.clone()].iter_mut().zip(&step).for_each(|(z, step)| *z += sign * step);
            let proposed = self.ln_given_outer(&z);
            // what is not a number is refused
            if rng.random::<f64>().ln() < proposed - present {
                position[..n].copy_from_slice(&z);
                (present, moved) = (proposed, true);
            }
        }
        moved
    }

    /// ln π at z, given the present outer unknowns, up to a constant.
    fn ln_given_outer(&mut self, z: &[f64]) -> f64 {
        self.n_trials += 1;
        self.whitening.latent_at(z, &mut self.theta);
        self.latent.ln_likelihood(&self.theta) + self.stand_in_quadratic() - 0.5 * dot::<4>(z, z)
    }

    /// ½ (θ − y)ᵀW(θ − y), and adds W(θ − y) to the slope.
    fn stand_in_quadratic(&mut self) -> f64 {
        self.shared.stand_in.add_quadratic(&self.theta, &mut self.scratch, &mut self.slope)
    }

    /// After hyperparameter moves and before the next inner one.
    pub(super) fn settle(&mut self, moved: bool) {
        self.latent.set_outer(&self.outer, &mut self.trial.designs);
        if moved {
            self.whitening.set_basis();
        }
    }

    /// Latent values and the likelihood's gradient at an inner position.
    pub(super) fn sample(&mut self, position: &[f64]) -> Sample {
        self.whitening.latent_at(&position[..self.w.len()], &mut self.theta);
        self.latent.slope(&self.theta, &mut self.slope);
        Sample { theta: self.theta.clone(), slope: self.slope.clone() }
    }

    /// The density's own position for an inner one, and its log density there.
    pub(super) fn join(&mut self, position: &[f64], rng: &mut dyn Rng, out: &mut [f64]) -> f64 {
        let n = self.w.len();
        self.whitening.coefficients(&position[..n], &mut self.w);
        self.trial_outer.copy_from_slice(&self.outer);
        for (i, x) in self.free.iter().zip(&position[n..]) {
            self.trial_outer[*i] = *x;
        }
        self.latent.join(&self.trial_outer, &self.w, rng, out)
    }

    /// Takes the free unknowns of an inner position as the chain's own.
    pub(super) fn take(&mut self, position: &[f64]) {
        for (i, x) in self.free.iter().zip(&position[self.w.len()..]) {
            self.outer[*i] = *x;
        }
    }

    /// ln π of the inner conditional. No constant is left out: it is the whole density in these
    /// coordinates.
    fn inner(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        let (z, free) = position.split_at(self.w.len());
        let (z_bar, free_bar) = gradient.split_at_mut(z.len());
        self.whitening.latent_at(z, &mut self.theta);
        let value = if free.is_empty() {
            self.ln_prior + self.latent.slope(&self.theta, &mut self.slope)
        } else {
            self.trial_outer.copy_from_slice(&self.outer);
            for (i, x) in self.free.iter().zip(free) {
                self.trial_outer[*i] = *x;
            }
            let (theta, slope) = (&self.theta, &mut self.slope);
            let value = self.latent.slopes(&self.trial_outer, theta, slope, &mut self.outer_bar);
            for (bar, i) in free_bar.iter_mut().zip(&self.free) {
                *bar = self.outer_bar[*i];
            }
            value
        };
        let quadratic = self.stand_in_quadratic();
        self.whitening.pull(&self.slope, z_bar);
        z_bar.iter_mut().zip(z).for_each(|(bar, z)| *bar -= z);
        value + quadratic + self.whitening.ln_evidence - 0.5 * dot::<4>(z, z)
    }
}

impl Evaluator for Conditional<'_> {
    /// The inner conditional.
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        self.inner(position, gradient)
    }
}
