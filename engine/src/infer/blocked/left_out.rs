//! How measurements are predicted from the others.
//!
//! What one measurement tells of its place, and through the fields of other places, moves the posterior so far that no
//! draw shows what it would be without it. So the coefficients integrate out, at points of the outer unknowns h:
//!
//! ```text
//! p(yᵢ | other y, h) = Z / Z₋ᵢ      Z = ∫ p(w) L dw,  Z₋ᵢ the same without Lᵢ
//! ```
//! Both are estimated by the same particles ([`forks`](super::forks)). Importance weights make the points those of the
//! posterior without the measurement, exactly for any number of particles. There are two ways to come to points:
//!
//! - A mixture q is fitted to draws of the posterior. Its points have the weights p(h) Ẑ₋ᵢ / q(h). They are wider spread than
//!   the draws. Where they still tell little of some rows, another mixture is fitted to those of the posteriors without
//!   them, and gives further points for these rows.
//! - With many latent values Ẑ₋ᵢ varies by many nats. There draws of the posterior themselves are the points, and the
//!   draw's own coefficients are one of the particles. Then the mean of Ẑ₋ᵢ/Ẑ is Z₋ᵢ/Z, and these are the weights.
//!
//! # Source
//! Vehtari, Mononen, Tolvanen, Sivula & Winther 2016, "Bayesian leave-one-out cross-validation approximations for
//! Gaussian latent variable models", for weights with the latent values integrated out; Cornuet, Marin, Mira & Robert
//! 2012, "Adaptive multiple importance sampling".

use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::explore::{has_few_unknowns, prior_tails};
use super::forks::Forks;
use super::latent::LatentGaussian;
use super::mixture::{Mixture, Tails};
use super::particles::Memory;
use super::stand_in::Sample;
use crate::random::Stream;

/// Particles up to the last place.
const PARTICLES: usize = 64;
/// Places of a part, with points of a mixture.
const TOGETHER: usize = 4;
/// Most mixtures, one after the other.
const ROUNDS: usize = 3;
/// Points tell little of a row where they are worth fewer equally weighted ones than this share of a round's.
const WORTH: f64 = 0.125;
/// Share of points with one number from where its prior lies.
const FAR: f64 = 0.1;

/// A row at one point of the outer unknowns.
#[derive(Clone, Debug)]
pub struct RowWithout {
    /// ln of the density that is predicted of it from the other rows.
    pub ln_density: f64,
    /// ln of the weight that makes points those of the posterior without the row, but for a constant.
    pub ln_weight: f64,
    /// Values of the blocks at its place, drawn given the other rows.
    pub theta: Vec<f64>,
}

/// Rows told from the others.
#[derive(Clone, Debug)]
pub struct WithoutRows {
    /// The outer unknowns of each point.
    pub outer: Vec<Vec<f64>>,
    /// `(point, place, row)`. The rows of a place are missing at points that have no weight or were not made for them, and
    /// everywhere if they cannot be told.
    pub rows: Vec<Vec<Vec<RowWithout>>>,
}

/// Each row of these places, `[group, place]`, told from `draws` of the posterior, which are of the density's unknowns
/// `(dim)`.
pub fn without_rows(
    density: &dyn LatentGaussian,
    draws: &[Vec<f64>],
    places: &[[usize; 2]],
    seed: u64,
) -> WithoutRows {
    with_particles(density, draws, places, PARTICLES, seed)
}

/// The same with so many particles.
pub(super) fn with_particles(
    density: &dyn LatentGaussian,
    draws: &[Vec<f64>],
    places: &[[usize; 2]],
    n_particles: usize,
    seed: u64,
) -> WithoutRows {
    let seen: Vec<Seen> = draws
        .par_iter()
        .map_init(|| Memory::new(density), |memory, draw| memory.seen(draw))
        .collect();
    let samples: Vec<Sample> = seen.iter().filter_map(|seen| seen.sample.clone()).collect();
    let outer: Vec<Vec<f64>> = seen.iter().map(|seen| seen.outer.clone()).collect();
    let mut leaving = Leaving { density, samples: &samples, n_particles, seed, n_points: 0 };
    let rng = &mut Stream::LeftOutPoints.rng(seed);
    let layout = density.layout();
    let may_propose = has_few_unknowns(layout) && !layout.outer.is_empty();
    let tails = may_propose.then(|| prior_tails(density, rng)).flatten();
    let by_mixtures = tails.and_then(|tails| leaving.by_mixtures(&outer, places, &tails, rng));
    by_mixtures.unwrap_or_else(|| leaving.by_draws(outer, &seen, places))
}

/// How rows are told.
struct Leaving<'a> {
    density: &'a dyn LatentGaussian,
    /// Of the posterior.
    samples: &'a [Sample],
    n_particles: usize,
    seed: u64,
    /// Points so far.
    n_points: usize,
}

impl Leaving<'_> {
    /// The rows of these places at these points, `(point, place, row)`, with p(h) Ẑ₋ᵢ for their weights. `theta` are latent
    /// values that one of a point's particles has; a point without them has no rows.
    fn tell(
        &mut self,
        outer: &[Vec<f64>],
        theta: impl Fn(usize) -> Option<Option<Vec<f64>>> + Sync,
        (places, together): (&[[usize; 2]], usize),
    ) -> Vec<Vec<Vec<RowWithout>>> {
        let layout = self.density.layout();
        let forks = Forks::new(layout, places, self.samples, (together, self.n_particles));
        let (first, seed) = (self.n_points, self.seed);
        self.n_points += outer.len();
        let one = |memory: &mut Memory<'_>, (i, outer): (usize, &Vec<f64>)| {
            let rng = Stream::IntegratedOut { point: first + i }.rng(seed);
            let ln_prior = memory.latent.set_outer(outer, &mut memory.whitening.designs);
            let mut told = vec![vec![]; places.len()];
            if let Some(theta) = theta(i).filter(|_| ln_prior.is_finite()) {
                forks.tell(memory, theta, rng, &mut told);
            }
            told.iter_mut().flatten().for_each(|row| row.ln_weight += ln_prior);
            told
        };
        outer
            .par_iter()
            .enumerate()
            .map_init(|| Memory::new(self.density), |memory, at| one(memory, at))
            .collect()
    }

    /// At draws of the posterior.
    fn by_draws(
        &mut self,
        outer: Vec<Vec<f64>>,
        seen: &[Seen],
        places: &[[usize; 2]],
    ) -> WithoutRows {
        let theta = |i: usize| seen[i].sample.as_ref().map(|sample| Some(sample.theta.clone()));
        let mut rows = self.tell(&outer, theta, (places, places.len().div_ceil(2)));
        for place in 0..places.len() {
            // weights are those of all draws, or of none
            let cannot = rows.iter().any(|told| told[place].is_empty());
            rows.iter_mut().filter(|_| cannot).for_each(|told| told[place].clear());
        }
        rows.iter_mut().flatten().flatten().for_each(|row| row.ln_weight = -row.ln_density);
        WithoutRows { outer, rows }
    }

    /// At points of mixtures, in each round as many as there are draws; `None` where no mixture can be fitted to them.
    fn by_mixtures(
        &mut self,
        draws: &[Vec<f64>],
        places: &[[usize; 2]],
        tails: &[Tails],
        rng: &mut ChaCha8Rng,
    ) -> Option<WithoutRows> {
        let mut mixture = Mixture::fit(draws, &vec![1.0; draws.len()], (FAR, tails), rng)?;
        let mut points = Points::new(draws.len(), places.len());
        let mut asked: Vec<usize> = (0..places.len()).collect();
        while !asked.is_empty() {
            let drawn = mixture.draws(draws.len(), rng);
            let own: Vec<[usize; 2]> = asked.iter().map(|i| places[*i]).collect();
            let rows = self.tell(&drawn, |_| Some(None), (&own, TOGETHER));
            points.add(mixture, drawn, (&asked, rows));
            if points.mixtures.len() == ROUNDS {
                break;
            }
            let weights: Vec<f64>;
            (asked, weights) = points.poor(&asked);
            let Some(next) = Mixture::fit(&points.outer, &weights, (FAR, tails), rng) else {
                break;
            };
            mixture = next;
        }
        Some(points.weighted())
    }
}

/// Points of several rounds. In each but the first some of the places of the round before are asked for again.
pub(super) struct Points {
    n_each: usize,
    mixtures: Vec<Mixture>,
    pub(super) outer: Vec<Vec<f64>>,
    /// ln of the density by which the points so far have been drawn, after each round: `(round, point)`.
    ln_drawn: Vec<Vec<f64>>,
    /// `(point, place, row)`
    rows: Vec<Vec<Vec<RowWithout>>>,
    /// In how many rounds each place was asked for.
    n_rounds: Vec<usize>,
}

impl Points {
    pub(super) fn new(n_each: usize, n_places: usize) -> Self {
        let n_rounds = vec![0; n_places];
        Self { n_each, mixtures: vec![], outer: vec![], ln_drawn: vec![], rows: vec![], n_rounds }
    }

    /// Adds a round, with the rows of the places that were asked for.
    pub(super) fn add(
        &mut self,
        mixture: Mixture,
        outer: Vec<Vec<f64>>,
        (asked, rows): (&[usize], Vec<Vec<Vec<RowWithout>>>),
    ) {
        let n_places = self.n_rounds.len();
        self.mixtures.push(mixture);
        self.outer.extend(outer);
        for told in rows {
            let mut all = vec![vec![]; n_places];
            asked.iter().zip(told).for_each(|(place, rows)| all[*place] = rows);
            self.rows.push(all);
        }
        asked.iter().for_each(|place| self.n_rounds[*place] += 1);
        let density = |point: &Vec<f64>| {
            self.mixtures.iter().map(|q| q.ln_density(point).exp()).sum::<f64>().ln()
        };
        self.ln_drawn.push(self.outer.iter().map(density).collect());
    }

    /// ln of the weights of a row, at the points of the rounds that asked for it; −∞ where it is missing.
    fn ln_weights(&self, place: usize, row: usize) -> Vec<f64> {
        let n_rounds = self.n_rounds[place];
        let ln_drawn = &self.ln_drawn[n_rounds - 1];
        let ln = |(told, ln_drawn): (&Vec<Vec<RowWithout>>, &f64)| {
            told[place].get(row).map_or(f64::NEG_INFINITY, |row| row.ln_weight - ln_drawn)
        };
        self.rows.iter().zip(ln_drawn).map(ln).collect()
    }

    /// Those of these places with a row of which the points tell little, and the mean of the weights of such rows, one for
    /// each point.
    pub(super) fn poor(&self, places: &[usize]) -> (Vec<usize>, Vec<f64>) {
        let (mut poor, mut weights) = (vec![], vec![0.0; self.outer.len()]);
        for place in places {
            let n_rows = self.rows.iter().map(|told| told[*place].len()).max().unwrap_or(0);
            let of_rows = (0..n_rows).filter_map(|row| normalised(&self.ln_weights(*place, row)));
            let is_poor = |own: &Vec<f64>| {
                own.iter().map(|w| w * w).sum::<f64>() * WORTH * self.n_each as f64 > 1.0
            };
            let of_poor: Vec<Vec<f64>> = of_rows.filter(is_poor).collect();
            if !of_poor.is_empty() {
                poor.push(*place);
            }
            for own in of_poor {
                weights.iter_mut().zip(&own).for_each(|(sum, w)| *sum += w);
            }
        }
        (poor, weights)
    }

    /// With the weights of all rounds.
    pub(super) fn weighted(mut self) -> WithoutRows {
        for (place, n_rounds) in self.n_rounds.iter().enumerate() {
            for (told, ln_drawn) in self.rows.iter_mut().zip(&self.ln_drawn[n_rounds - 1]) {
                told[place].iter_mut().for_each(|row| row.ln_weight -= ln_drawn);
            }
        }
        WithoutRows { outer: self.outer, rows: self.rows }
    }
}

/// Weights of these logarithms, in all 1; `None` if they are all 0.
fn normalised(ln: &[f64]) -> Option<Vec<f64>> {
    let most = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = ln.iter().map(|ln| (ln - most).exp()).collect();
    let total: f64 = weights.iter().sum();
    total.is_finite().then(|| weights.iter().map(|weight| weight / total).collect())
}

/// A draw: its outer unknowns, and its latent values with their slopes, unless these are not finite.
struct Seen {
    outer: Vec<f64>,
    sample: Option<Sample>,
}

impl Memory<'_> {
    fn seen(&mut self, draw: &[f64]) -> Seen {
        self.latent.coefficients(draw, &mut self.coefficients);
        let outer = self.layout.outer_of(draw);
        self.latent.set_outer(&outer, &mut self.whitening.designs);
        let mut theta = vec![0.0; self.layout.n_latent()];
        let mut slope = theta.clone();
        self.whitening.latent(&self.coefficients, &mut theta);
        self.latent.slope(&theta, &mut slope);
        let is_finite = theta.iter().chain(&slope).all(|x| x.is_finite());
        Seen { outer, sample: is_finite.then_some(Sample { theta, slope }) }
    }
}
