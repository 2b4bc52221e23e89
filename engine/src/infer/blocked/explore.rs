//! Which outer unknowns to propose together with all coefficients: adaptive importance sampling of
//! them, by the estimates of [`particles`](super::particles).
//!
//! # Source
//! Cornuet, Marin, Mira & Robert 2012, "Adaptive multiple importance sampling".

use super::anchors::{Anchors, Spots};
use super::latent::{LatentGaussian, Layout};
use super::mixture::{Mixture, Tails};
use super::particles::{Here, Memory};
use super::stand_in::StandIn;
use crate::random::Stream;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// After each round the proposal is fitted to the prior times the likelihood to this power. A small power keeps the
/// points spread out, so that a regime is found that no chain has met.
const POWERS: [f64; 3] = [0.25, 0.5, 1.0];
/// This share of the last fit is to the likelihood to the power before the last. Where the posterior is thin, few points
/// tell of it, and a fit to it alone may be thinner still. A chain that comes to such a place does not leave it for long.
const SPREAD: f64 = 0.25;
/// Points of a round.
const POINTS: usize = 1000;
/// A thread takes at least so many of them at a time.
const AT_ONCE: usize = 50;
/// Share of proposals with one number from where its prior lies, while exploring and when it is done.
const FAR: [f64; 2] = [0.3, 0.1];
/// All unknowns move together where there are at most so many latent values: with 80 it took twice
/// as long as all other moves, and brought nothing (docs/experiments.md).
const MOST_LATENT: usize = 40;
/// And so many outer unknowns.
const MOST_OUTER: usize = 12;
/// Draws of the prior. Half of the first round's points are from where it lies.
const PRIOR_DRAWS: usize = 400;

/// Whether estimates by particles tell of all outer unknowns, and these are few enough to be proposed at once.
pub(super) fn has_few_unknowns(layout: &Layout) -> bool {
    layout.n_latent() <= MOST_LATENT && layout.outer.len() <= MOST_OUTER
}

/// How to look for regimes at the end of the warm-up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exploring {
    /// Whether draws of an earlier run, which has looked for regimes, have told where the hyperparameters are.
    pub(super) knows_hyper: bool,
    /// Of the run.
    pub(super) seed: u64,
}

/// What is proposed where all unknowns move together.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Leaps {
    pub(super) mixture: Mixture,
    spots: Spots,
    /// Not kept: a chain that is restored makes them again, by [`Leaps::ready`].
    #[serde(skip)]
    pub(super) anchors: Anchors,
}

impl Leaps {
    /// Whether they are of this layout.
    pub(super) fn fits(&self, layout: &Layout) -> bool {
        self.mixture.fits(layout.outer.len()) && self.spots.fits(layout)
    }

    /// With the anchors at its spots; `None` if there can be none.
    pub(super) fn ready(
        self,
        density: &dyn LatentGaussian,
        stand_in: &StandIn,
        seed: u64,
    ) -> Option<Self> {
        let anchors = Anchors::new(density, stand_in, &self.spots, seed)?;
        Some(Self { anchors, ..self })
    }
}

/// A mixture fitted to the outer unknowns given the measurements, and anchors for estimates. The first round draws
/// from mixtures fitted to `met`, the outer unknowns of the chains' draws, and to draws of the prior. `None` where the
/// prior cannot be drawn from, or nothing was found.
pub(super) fn explore(
    density: &dyn LatentGaussian,
    stand_in: &StandIn,
    met: &[Vec<f64>],
    Exploring { knows_hyper, seed }: Exploring,
) -> Option<Leaps> {
    let rng = &mut Stream::Leap.rng(seed);
    let prior = density.prior_outer(PRIOR_DRAWS, rng)?;
    let tails = tails_of(&prior, density.layout());
    let equal = vec![1.0; met.len()];
    let mut mixtures = vec![
        Mixture::fit(met, &equal, (FAR[0], &tails), rng)?,
        Mixture::fit(&prior, &vec![1.0; prior.len()], (FAR[0], &tails), rng)?,
    ];
    let mut spots = Spots::new(met, &equal);
    let mut anchors = Anchors::new(density, stand_in, &spots, seed)?;
    let mut points = Points::default();
    let [.., before_last, last] = POWERS;
    let powers = if knows_hyper { &[last][..] } else { &POWERS };
    for (round, power) in powers.iter().copied().enumerate() {
        let mut begin = |k: usize| {
            let mut point = vec![0.0; tails.len()];
            mixtures[k % mixtures.len()].draw(rng, &mut point);
            (point, ChaCha8Rng::from_rng(rng))
        };
        let begun: Vec<(Vec<f64>, ChaCha8Rng)> = (0..POINTS).map(&mut begin).collect();
        let estimated: Vec<Option<(Vec<f64>, [f64; 2])>> = begun
            .into_par_iter()
            .with_min_len(AT_ONCE)
            .map_init(
                || Memory::new(density),
                |memory, (point, mut rng)| {
                    let ln = estimate(memory, &anchors, &point, &mut rng)?;
                    Some((point, ln))
                },
            )
            .collect();
        estimated.into_iter().flatten().for_each(|(point, ln)| points.push(point, ln));
        points.drawn_from(mixtures);
        let mut weights = points.weights(power);
        if round + 1 == powers.len() {
            for (own, spread) in weights.iter_mut().zip(points.weights(before_last)) {
                *own += SPREAD * (spread - *own);
            }
        }
        mixtures = vec![Mixture::fit(&points.all, &weights, (FAR[1], &tails), rng)?];
        spots = Spots::new(&points.all, &weights);
        anchors = Anchors::new(density, stand_in, &spots, seed)?;
    }
    Some(Leaps { mixture: mixtures.swap_remove(0), spots, anchors })
}

/// Where the prior of each outer unknown lies; `None` where it cannot be drawn from.
pub(super) fn prior_tails(
    density: &dyn LatentGaussian,
    rng: &mut ChaCha8Rng,
) -> Option<Vec<Tails>> {
    Some(tails_of(&density.prior_outer(PRIOR_DRAWS, rng)?, density.layout()))
}

fn tails_of(prior: &[Vec<f64>], layout: &Layout) -> Vec<Tails> {
    let tail = |i: usize| Tails::of(prior.iter().map(|outer| outer[i]).collect());
    (0..layout.outer.len()).map(tail).collect()
}

/// ln of the prior density of these outer unknowns, and of the estimated likelihood; `None` where it is 0 or cannot be told.
fn estimate(
    memory: &mut Memory<'_>,
    anchors: &Anchors,
    outer: &[f64],
    rng: &mut ChaCha8Rng,
) -> Option<[f64; 2]> {
    let Memory { layout, latent, whitening, coefficients } = memory;
    let ln_prior = latent.set_outer(outer, &mut whitening.designs);
    if !ln_prior.is_finite() {
        return None;
    }
    let guide = anchors.at(outer, layout)?;
    let here = Here::new(layout, &guide.lookahead, whitening)?;
    let ln_likelihood = here.draw(&mut **latent, guide.n_particles, coefficients, rng);
    ln_likelihood.is_finite().then_some([ln_prior, ln_likelihood])
}

/// Points of all rounds.
#[derive(Default)]
struct Points {
    all: Vec<Vec<f64>>,
    /// ln of the prior density and of the estimated likelihood.
    ln: Vec<[f64; 2]>,
    /// The sum over all rounds of the density of drawing a point.
    drawn: Vec<f64>,
    /// What each round has drawn from, in equal parts.
    rounds: Vec<Vec<Mixture>>,
}

impl Points {
    /// Adds a point of the present round.
    fn push(&mut self, point: Vec<f64>, ln: [f64; 2]) {
        self.drawn.push(self.rounds.iter().map(|mixtures| density_of(mixtures, &point)).sum());
        self.all.push(point);
        self.ln.push(ln);
    }

    /// Ends a round.
    fn drawn_from(&mut self, mixtures: Vec<Mixture>) {
        for (point, sum) in self.all.iter().zip(&mut self.drawn) {
            *sum += density_of(&mixtures, point);
        }
        self.rounds.push(mixtures);
    }

    /// The weights for the prior times this power of the likelihood, in all 1.
    fn weights(&self, power: f64) -> Vec<f64> {
        let ln_weight =
            |([prior, likelihood], sum): (&[f64; 2], &f64)| prior + power * likelihood - sum.ln();
        normalised(&self.ln.iter().zip(&self.drawn).map(ln_weight).collect::<Vec<f64>>())
    }
}

/// Weights of these logarithms, in all 1; none is a number if all are 0.
pub(super) fn normalised(ln: &[f64]) -> Vec<f64> {
    let most = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = ln.iter().map(|ln| (ln - most).exp()).collect();
    let total: f64 = weights.iter().sum();
    weights.iter().map(|weight| weight / total).collect()
}

/// The mean density.
fn density_of(mixtures: &[Mixture], point: &[f64]) -> f64 {
    let sum: f64 = mixtures.iter().map(|q| q.ln_density(point).exp()).sum();
    sum / mixtures.len() as f64
}
