//! Coefficients drawn anew at given outer unknowns, with an unbiased estimate of the likelihood
//! there. So all unknowns can be proposed together.
//!
//! The *lookahead* is a Gaussian (W, y) for each place, of which q = exp(−½ (θ − y)ᵀW(θ − y)). With it the
//! latent values are normal, G, and
//!
//! ```text
//! ∫ p(w) L dw = e^κ E_G[∏ L/q]
//! ```
//! with κ as in [`whiten`](super::whiten). The expectation is estimated by particles. Place after place each
//! draws the values there given those at the places before, and its weight is multiplied by L/q. Where
//! weights become unequal, the particles are drawn anew from among them.
//!
//! To estimate it at a state of a chain, that state is one of the particles and stays (conditional
//! sequential Monte Carlo). Moving on to a particle of other outer unknowns by the ratio of the estimates
//! leaves the posterior as it is, for any lookahead and any number of particles.
//!
//! # Source
//! Andrieu, Doucet & Holenstein 2010, "Particle Markov chain Monte Carlo methods".

use super::groups::Whitening;
use super::latent::{Latent, LatentGaussian, Layout};
use super::mixture::student_scale;
use super::order::{Ahead, Law, Order};
use super::stand_in::{GroupStandIn, StandIn};
use crate::dist::ln_gamma;
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;

/// Degrees of freedom of what a particle draws at a place: heavier tails than G, since L/q may be large there.
const NU: usize = 4;
/// Particles are drawn anew where they are worth less than this share of them.
const WORTH: f64 = 0.5;
/// Where eˣ is zero.
const SMALLEST: f64 = -746.0;

/// What one thread writes over and over.
pub(super) struct Memory<'d> {
    pub(super) layout: &'d Layout,
    pub(super) latent: Box<dyn Latent + 'd>,
    pub(super) whitening: Whitening,
    pub(super) coefficients: Vec<f64>,
}

impl<'d> Memory<'d> {
    pub(super) fn new(density: &'d dyn LatentGaussian) -> Self {
        let layout = density.layout();
        let coefficients = vec![0.0; layout.n_coefficients()];
        Self { layout, latent: density.latent(), whitening: Whitening::new(layout), coefficients }
    }
}

/// Where coefficients are drawn: some outer unknowns.
pub(super) struct Here<'a> {
    layout: &'a Layout,
    lookahead: &'a StandIn,
    /// By the lookahead, with its basis set.
    pub(super) whitening: &'a Whitening,
}

impl<'a> Here<'a> {
    /// At the designs of `whitening`; `None` if one of them has no factor.
    pub(super) fn new(
        layout: &'a Layout,
        lookahead: &'a StandIn,
        whitening: &'a mut Whitening,
    ) -> Option<Self> {
        whitening.prepare_basis(lookahead)?;
        Some(Self { layout, lookahead, whitening })
    }

    /// G of a group.
    pub(super) fn law(&self, group: usize) -> Law {
        Law::new(&self.layout.groups[group], self.whitening.basis(group))
    }

    /// ln of an unbiased estimate of ∫ p(w) L dw. Of z, the whitened coefficients, it writes those of one particle.
    pub(super) fn draw(
        &self,
        latent: &mut dyn Latent,
        n_particles: usize,
        z: &mut [f64],
        rng: &mut impl Rng,
    ) -> f64 {
        let (mut first, mut sum) = (0, self.whitening.ln_evidence);
        for (group, stand_in) in self.lookahead.groups.iter().enumerate() {
            let law = self.law(group);
            let order = law.order();
            let mut swarm = Swarm::new(n_particles, None);
            sum += swarm.run(&order, stand_in, group, latent, rng);
            let z = &mut z[first..][..law.n_coefficients()];
            first += z.len();
            order.coefficients(&swarm.chosen(rng), rng, z);
        }
        sum
    }

    /// The same where these latent values are those of one of the particles.
    pub(super) fn at(
        &self,
        latent: &mut dyn Latent,
        n_particles: usize,
        theta: &[f64],
        rng: &mut impl Rng,
    ) -> f64 {
        let (mut first, mut sum) = (0, self.whitening.ln_evidence);
        for (group, stand_in) in self.lookahead.groups.iter().enumerate() {
            let law = self.law(group);
            let order = law.order();
            let present = theta[first..][..order.n()].to_vec();
            first += order.n();
            let mut swarm = Swarm::new(n_particles, Some(present));
            sum += swarm.run(&order, stand_in, group, latent, rng);
        }
        sum
    }
}

/// The particles of a group.
#[derive(Clone)]
pub(super) struct Swarm {
    /// ε of the places so far, `(n, particle)`.
    eps: Vec<f64>,
    /// Each particle's weight since they were last drawn anew is `factor e^ln`.
    factors: Vec<f64>,
    lns: Vec<f64>,
    /// The weights in units of a common one.
    weights: Vec<f64>,
    present: Option<Present>,
    /// ln of the estimate up to when the particles were last drawn anew.
    ln: f64,
}

/// What one of the particles must be, the first.
#[derive(Clone)]
struct Present {
    /// `(block, place)`
    theta: Vec<f64>,
    eps: Vec<f64>,
}

impl Swarm {
    /// Particles without values, of which the first must get these latent values `(block, place)`.
    pub(super) fn new(n_particles: usize, present: Option<Vec<f64>>) -> Self {
        Self {
            eps: vec![],
            factors: vec![1.0; n_particles],
            lns: vec![0.0; n_particles],
            weights: vec![1.0; n_particles],
            present: present.map(|theta| Present { theta, eps: vec![] }),
            ln: 0.0,
        }
    }

    /// Draws the values of further places, up to the last of the order, which has G by this stand-in for their likelihood.
    /// Returns ln of the estimate, of all places so far, and −∞ where no particle has a weight.
    pub(super) fn run(
        &mut self,
        order: &Order<'_>,
        stand_in: &GroupStandIn,
        group: usize,
        latent: &mut dyn Latent,
        rng: &mut impl Rng,
    ) -> f64 {
        let (d, n_particles) = (order.n_blocks(), self.weights.len());
        let mut values = vec![0.0; n_particles];
        let mut theta = vec![0.0; n_particles * d];
        let mut likelihoods = vec![0.0; n_particles];
        let mut ln_mean = 0.0;
        if let Some(Present { theta, eps }) = &mut self.present {
            order.complete(theta, eps);
        }
        let first = self.eps.len() / n_particles / d;
        for (step, place) in order.places.iter().copied().enumerate().skip(first) {
            self.ln += self.draw(order, step, rng);
            for f in 0..d {
                order.values(step * d + f, &self.eps, &mut values);
                theta.iter_mut().skip(f).step_by(d).zip(&values).for_each(|(to, x)| *to = *x);
            }
            latent.ln_likelihoods([group, place], &theta, &mut likelihoods);
            for ((ln, likelihood), theta) in
                self.lns.iter_mut().zip(&likelihoods).zip(theta.chunks_exact(d))
            {
                *ln += likelihood + stand_in.quadratic(place, theta);
            }
            ln_mean = self.weigh(step + 1 == order.places.len(), rng);
            if !ln_mean.is_finite() {
                break;
            }
        }
        self.ln + ln_mean
    }

    /// Weighs particles by what is known of further places.
    pub(super) fn look_ahead(&mut self, ahead: &Ahead, rng: &mut impl Rng) {
        ahead.add_ln(&self.eps, &mut self.lns);
        self.weigh(false, rng);
    }

    /// Writes the same values by ε of another order of the same places, which agrees with this one before number `first`.
    pub(super) fn change(&mut self, first: usize, from: &Order<'_>, to: &Order<'_>) {
        let n = self.weights.len();
        let mut values = vec![0.0; (from.n() - first) * n];
        for (i, values) in (first..).zip(values.chunks_exact_mut(n)) {
            from.values(i, &self.eps, values);
        }
        for (i, values) in (first..).zip(values.chunks_exact(n)) {
            let (before, own) = self.eps.split_at_mut(i * n);
            to.standard(i, before, values, &mut own[..n]);
        }
        if let Some(Present { theta, eps }) = &mut self.present {
            eps.truncate(first);
            to.complete(theta, eps);
        }
    }

    /// Draws ε of the place of a step from a Student distribution. The weights are multiplied by the standard normal density over
    /// that one, but for a constant, whose ln is returned. What the values before determine has no ε.
    fn draw(&mut self, order: &Order<'_>, step: usize, rng: &mut impl Rng) -> f64 {
        let n_particles = self.weights.len();
        let all = step * order.n_blocks()..(step + 1) * order.n_blocks();
        self.eps.resize(all.end * n_particles, 0.0);
        let open: Vec<usize> = all.filter(|i| order.row(*i)[*i] > 0.0).collect();
        let power = NU + open.len();
        for k in 0..n_particles {
            let given = self.present.as_ref().filter(|_| k == 0);
            let scale = if given.is_some() { 0.0 } else { student_scale(NU, rng) };
            let mut square = 0.0;
            for i in &open {
                let drawn = || scale * rng.sample::<f64, _>(StandardNormal);
                let eps = given.map_or_else(drawn, |given| given.eps[*i]);
                self.eps[i * n_particles + k] = eps;
                square += eps * eps;
            }
            let base = 1.0 + square / NU as f64;
            // base^(power/2)
            let root = if power.is_multiple_of(2) { 1.0 } else { base.sqrt() };
            self.factors[k] *= (0..power / 2).fold(root, |product, _| product * base);
            self.lns[k] -= 0.5 * square;
        }
        let half = 0.5 * NU as f64;
        0.5 * open.len() as f64 * half.ln() + ln_gamma(half) - ln_gamma(0.5 * power as f64)
    }

    /// Computes the weights. Where they are too unequal, draws the particles anew, unless this is the end. Returns ln of
    /// the mean of the weights that there are then.
    fn weigh(&mut self, is_end: bool, rng: &mut impl Rng) -> f64 {
        let n = self.weights.len();
        let most = self.lns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if !most.is_finite() {
            return f64::NEG_INFINITY;
        }
        for ((weight, ln), factor) in self.weights.iter_mut().zip(&self.lns).zip(&self.factors) {
            // the library is slow where the result is too small for a number
            let value = if ln - most < SMALLEST { 0.0 } else { factor * (ln - most).exp() };
            *weight = if value.is_finite() { value } else { 0.0 };
        }
        let total: f64 = self.weights.iter().sum();
        let squares: f64 = self.weights.iter().map(|w| w * w).sum();
        let ln_mean = most + (total / n as f64).ln();
        if is_end {
            return ln_mean;
        }
        if total * total > WORTH * n as f64 * squares {
            return ln_mean;
        }
        let stays = usize::from(self.present.is_some());
        let sums = sums(&self.weights);
        let from: Vec<usize> =
            (0..n).map(|k| if k < stays { k } else { pick(&sums, rng) }).collect();
        let mut old = vec![0.0; n];
        for row in self.eps.chunks_exact_mut(n) {
            old.copy_from_slice(row);
            row.iter_mut().zip(&from).for_each(|(x, from)| *x = old[*from]);
        }
        self.lns.fill(0.0);
        self.factors.fill(1.0);
        self.ln += ln_mean;
        0.0
    }

    /// ε of a particle, by their weights.
    fn chosen(&self, rng: &mut impl Rng) -> Vec<f64> {
        let chosen = pick(&sums(&self.weights), rng);
        self.eps.chunks_exact(self.weights.len()).map(|row| row[chosen]).collect()
    }

    /// What all values before the last place of the order say of it, `(block, particle)`.
    pub(super) fn given(&self, order: &Order<'_>) -> Vec<f64> {
        let (n, first) = (self.weights.len(), order.n() - order.n_blocks());
        let mut given = vec![0.0; order.n_blocks() * n];
        for (i, given) in (first..).zip(given.chunks_exact_mut(n)) {
            order.values(i, &self.eps, given);
        }
        given
    }

    /// ln of the weight of particle k. Their mean is the estimate.
    pub(super) fn ln_weight(&self, k: usize) -> f64 {
        self.ln + self.lns[k] + self.factors[k].ln()
    }
}

/// The sums of the first 1, 2, … weights.
pub(super) fn sums(weights: &[f64]) -> Vec<f64> {
    let next = |sum: &mut f64, weight: &f64| {
        *sum += weight;
        Some(*sum)
    };
    weights.iter().scan(0.0, next).collect()
}

/// A number by the weights that have these [`sums`].
pub(super) fn pick(sums: &[f64], rng: &mut impl Rng) -> usize {
    let at = sums.last().map_or(0.0, |total| total * rng.random::<f64>());
    let own = sums.iter().filter(|sum| **sum <= at).count();
    if own < sums.len() { own } else { 0 }
}
