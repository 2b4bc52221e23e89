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
use super::stand_in::StandIn;
use crate::dist::ln_gamma;
use crate::num::vector::{axpy, dot};
use rand::{Rng, RngExt as _};
use rand_distr::StandardNormal;

/// Degrees of freedom of what a particle draws at a place: heavier tails than G, since L/q may be large there.
const NU: usize = 4;
/// Particles are drawn anew where they are worth less than this share of them.
const WORTH: f64 = 0.5;
/// A latent value of which the values before leave less than this share of the variance is determined by them.
const ROUNDING: f64 = 1e-10;

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

    /// ln of an unbiased estimate of ∫ p(w) L dw. Of z, the whitened coefficients, it writes those of one particle.
    pub(super) fn draw(
        &self,
        latent: &mut dyn Latent,
        n_particles: usize,
        z: &mut [f64],
        rng: &mut impl Rng,
    ) -> f64 {
        let (mut first, mut sum) = (0, self.whitening.ln_evidence);
        for group in 0..self.layout.groups.len() {
            let order = Order::new(self, group, None);
            let mut swarm = Swarm::new(order.n(), n_particles, None);
            sum += swarm.run(self, group, &order, latent, rng);
            let z = &mut z[first..][..order.n_coefficients];
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
        for group in 0..self.layout.groups.len() {
            let order = Order::new(self, group, None);
            let present = order.standard(&theta[first..][..order.n()]);
            first += order.n();
            let mut swarm = Swarm::new(order.n(), n_particles, Some(present));
            sum += swarm.run(self, group, &order, latent, rng);
        }
        sum
    }
}

/// A group's latent values under G, place after place: θ = μ + B z = μ + L ε.
pub(super) struct Order {
    pub(super) n_blocks: usize,
    /// The places in their order.
    places: Vec<usize>,
    n_coefficients: usize,
    mean: Vec<f64>,
    /// B, row-major `(n, n_coefficients)`.
    basis: Vec<f64>,
    /// L, row-major `(n, n)`. The diagonal is zero where the values before determine one.
    lower: Vec<f64>,
}

impl Order {
    /// In the order of the places, but this one last.
    pub(super) fn new(here: &Here<'_>, group: usize, last: Option<usize>) -> Self {
        let layout = &here.layout.groups[group];
        let (n_blocks, n_seen, n) = (layout.blocks.len(), layout.n_seen, layout.n_latent());
        let (origin, columns) = here.whitening.basis(group);
        let n_coefficients = layout.n_coefficients();
        let places = (0..n_seen).filter(|place| Some(*place) != last).chain(last).collect();
        let mut order =
            Self { n_blocks, places, n_coefficients, mean: vec![], basis: vec![], lower: vec![] };
        let at = |i: usize| order.at(i);
        let mean = (0..n).map(|i| origin[at(i)]).collect();
        let mut basis = vec![0.0; n * n_coefficients];
        for (i, row) in basis.chunks_exact_mut(n_coefficients).enumerate() {
            for (b, column) in row.iter_mut().zip(columns.chunks_exact(n)) {
                *b = column[at(i)];
            }
        }
        let mut lower = vec![0.0; n * n];
        for i in 0..n {
            let row = |i: usize| &basis[i * n_coefficients..][..n_coefficients];
            let (done, own) = lower.split_at_mut(i * n);
            for (j, other) in done.chunks_exact(n).enumerate() {
                let left = dot::<4>(row(i), row(j)) - dot::<4>(&own[..j], &other[..j]);
                own[j] = if other[j] > 0.0 { left / other[j] } else { 0.0 };
            }
            let variance = dot::<4>(row(i), row(i));
            let left = variance - dot::<4>(&own[..i], &own[..i]);
            own[i] = if left > ROUNDING * variance { left.sqrt() } else { 0.0 };
        }
        (order.mean, order.basis, order.lower) = (mean, basis, lower);
        order
    }

    /// Which of the latent values `(block, place)` is number i.
    fn at(&self, i: usize) -> usize {
        (i % self.n_blocks) * self.places.len() + self.places[i / self.n_blocks]
    }

    pub(super) fn n(&self) -> usize {
        self.mean.len()
    }

    /// Row i of L up to its diagonal.
    pub(super) fn row(&self, i: usize) -> &[f64] {
        &self.lower[i * self.n()..][..=i]
    }

    /// θᵢ of each particle, from ε `(n, particle)`.
    pub(super) fn values(&self, i: usize, eps: &[f64], out: &mut [f64]) {
        out.fill(self.mean[i]);
        for (l, eps) in self.row(i).iter().zip(eps.chunks_exact(out.len())) {
            axpy(*l, eps, out);
        }
    }

    /// What the first `n` of ε say of θᵢ.
    pub(super) fn given_before(&self, i: usize, n: usize, eps: &[f64]) -> f64 {
        self.mean[i] + dot::<4>(&self.row(i)[..n], &eps[..n])
    }

    /// L⁻¹ x; 0 where L has no pivot.
    fn solve(&self, x: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut eps: Vec<f64> = Vec::with_capacity(self.n());
        for i in 0..self.n() {
            let row = self.row(i);
            let left = x(i) - dot::<4>(&row[..i], &eps);
            eps.push(if row[i] > 0.0 { left / row[i] } else { 0.0 });
        }
        eps
    }

    /// ε at θ `(block, place)`.
    pub(super) fn standard(&self, theta: &[f64]) -> Vec<f64> {
        self.solve(|i| theta[self.at(i)] - self.mean[i])
    }

    /// Draws z given ε: `z = ξ + Bᵀ L⁻ᵀ (ε − L⁻¹ B ξ)` for ξ standard normal.
    fn coefficients(&self, eps: &[f64], rng: &mut impl Rng, z: &mut [f64]) {
        z.fill_with(|| rng.sample(StandardNormal));
        let rows = || self.basis.chunks_exact(self.n_coefficients);
        let products: Vec<f64> = rows().map(|row| dot::<4>(row, z)).collect();
        let seen = self.solve(|i| products[i]);
        let mut d: Vec<f64> = eps.iter().zip(seen).map(|(eps, seen)| eps - seen).collect();
        for i in (0..self.n()).rev() {
            let row = self.row(i);
            d[i] = if row[i] > 0.0 { d[i] / row[i] } else { 0.0 };
            let (before, own) = d.split_at_mut(i);
            before.iter_mut().zip(row).for_each(|(d, l)| *d -= l * own[0]);
        }
        for (row, d) in rows().zip(&d) {
            z.iter_mut().zip(row).for_each(|(z, b)| *z += b * d);
        }
    }
}

/// The particles of a group.
pub(super) struct Swarm {
    /// ε `(n, particle)`
    eps: Vec<f64>,
    /// Each particle's weight since they were last drawn anew is `factor e^ln`.
    factors: Vec<f64>,
    lns: Vec<f64>,
    /// The weights in units of a common one.
    weights: Vec<f64>,
    /// What one of the particles must be, the first.
    present: Option<Vec<f64>>,
}

impl Swarm {
    pub(super) fn new(n: usize, n_particles: usize, present: Option<Vec<f64>>) -> Self {
        Self {
            eps: vec![0.0; n * n_particles],
            factors: vec![1.0; n_particles],
            lns: vec![0.0; n_particles],
            weights: vec![1.0; n_particles],
            present,
        }
    }

    /// ln of the estimate.
    fn run(
        &mut self,
        here: &Here<'_>,
        group: usize,
        order: &Order,
        latent: &mut dyn Latent,
        rng: &mut impl Rng,
    ) -> f64 {
        self.run_until(here, group, (order, order.places.len()), latent, rng)
    }

    /// The same up to so many places. It is not the whole estimate before the last of all.
    pub(super) fn run_until(
        &mut self,
        here: &Here<'_>,
        group: usize,
        (order, n_places): (&Order, usize),
        latent: &mut dyn Latent,
        rng: &mut impl Rng,
    ) -> f64 {
        let (d, n_particles) = (order.n_blocks, self.weights.len());
        let mut values = vec![0.0; n_particles];
        let mut theta = vec![0.0; n_particles * d];
        let mut likelihoods = vec![0.0; n_particles];
        let stand_in = &here.lookahead.groups[group];
        let mut sum = 0.0;
        for (step, place) in order.places.iter().copied().enumerate().take(n_places) {
            sum += self.draw(order, step, rng);
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
            let n_drawn = (step + 1) * d;
            sum += self.weigh((n_drawn < order.n()).then_some(n_drawn), rng);
            if !sum.is_finite() {
                break;
            }
        }
        sum
    }

    /// Draws ε of the place of a step from a Student distribution. The weights are multiplied by the standard normal density over
    /// that one, but for a constant, whose ln is returned. What the values before determine has no ε.
    fn draw(&mut self, order: &Order, step: usize, rng: &mut impl Rng) -> f64 {
        let n_particles = self.weights.len();
        let all = step * order.n_blocks..(step + 1) * order.n_blocks;
        let open: Vec<usize> = all.filter(|i| order.row(*i)[*i] > 0.0).collect();
        let power = NU + open.len();
        for k in 0..n_particles {
            let given = self.present.as_ref().filter(|_| k == 0);
            let scale = if given.is_some() { 0.0 } else { student_scale(NU, rng) };
            let mut square = 0.0;
            for i in &open {
                let drawn = || scale * rng.sample::<f64, _>(StandardNormal);
                let eps = given.map_or_else(drawn, |given| given[*i]);
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

    /// Computes the weights. Where they are too unequal, draws the particles anew, of which `n_drawn` numbers are
    /// drawn so far, and returns ln of the mean weight: at the end (`None`) always, else 0 as long as they go on.
    fn weigh(&mut self, n_drawn: Option<usize>, rng: &mut impl Rng) -> f64 {
        let n = self.weights.len();
        let most = self.lns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if !most.is_finite() {
            return f64::NEG_INFINITY;
        }
        for ((weight, ln), factor) in self.weights.iter_mut().zip(&self.lns).zip(&self.factors) {
            let value = factor * (ln - most).exp();
            *weight = if value.is_finite() { value } else { 0.0 };
        }
        let total: f64 = self.weights.iter().sum();
        let squares: f64 = self.weights.iter().map(|w| w * w).sum();
        let ln_mean = most + (total / n as f64).ln();
        let Some(n_drawn) = n_drawn else { return ln_mean };
        if total * total > WORTH * n as f64 * squares {
            return 0.0;
        }
        let stays = usize::from(self.present.is_some());
        let from: Vec<usize> = (0..n).map(|k| if k < stays { k } else { self.pick(rng) }).collect();
        let mut old = vec![0.0; n];
        for row in self.eps.chunks_exact_mut(n).take(n_drawn) {
            old.copy_from_slice(row);
            row.iter_mut().zip(&from).for_each(|(x, from)| *x = old[*from]);
        }
        self.lns.fill(0.0);
        self.factors.fill(1.0);
        ln_mean
    }

    /// A particle, by their weights.
    fn pick(&self, rng: &mut impl Rng) -> usize {
        let mut left = self.weights.iter().sum::<f64>() * rng.random::<f64>();
        let own = self.weights.iter().position(|w| {
            left -= w;
            left < 0.0
        });
        own.unwrap_or(0)
    }

    /// ε of a particle, by their weights.
    fn chosen(&self, rng: &mut impl Rng) -> Vec<f64> {
        self.particle(self.pick(rng))
    }

    /// ε of particle k.
    pub(super) fn particle(&self, k: usize) -> Vec<f64> {
        self.eps.chunks_exact(self.weights.len()).map(|row| row[k]).collect()
    }

    /// ln of the weight of particle k since they were last drawn anew.
    pub(super) fn ln_weight(&self, k: usize) -> f64 {
        self.lns[k] + self.factors[k].ln()
    }
}
