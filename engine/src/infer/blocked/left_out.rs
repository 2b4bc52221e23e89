//! How measurements are predicted from the others.
//!
//! What one measurement tells of its place, and through the fields of other places, moves the posterior so far that no
//! draw shows what it would be without it. So the coefficients integrate out, at points of the outer unknowns h:
//!
//! ```text
//! p(yᵢ | other y, h) = Z / Z₋ᵢ      Z = ∫ p(w) L dw,  Z₋ᵢ the same without Lᵢ
//! ```
//! Importance weights make the points those of the posterior without the measurement. There are two ways:
//!
//! - With few unknowns, Z and Z₋ᵢ are estimated by particles ([`forks`](super::forks)), at points of a mixture q that is fitted to
//!   draws of the posterior. Their weights are p(h) Ẑ₋ᵢ / q(h). They are wider spread than the draws. Where they still
//!   tell little of some rows, another mixture is fitted to the posteriors without these, and gives further points for them.
//! - With many latent values such estimates vary by many nats. There draws of the posterior themselves are the points,
//!   and only what the measurement's own place determines integrates out ([`planes`]). The weights are Ẑ₋ᵢ/Ẑ.
//!
//! Both are exact for any number of particles or points.
//!
//! # Source
//! Vehtari, Mononen, Tolvanen, Sivula & Winther 2016, "Bayesian leave-one-out cross-validation approximations for
//! Gaussian latent variable models", for weights with the latent values integrated out; Cornuet, Marin, Mira & Robert
//! 2012, "Adaptive multiple importance sampling".

use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::explore::{has_few_unknowns, normalised, prior_tails};
use super::forks::Forks;
use super::latent::LatentGaussian;
use super::mixture::{Mixture, Tails};
use super::particles::Memory;
use super::planes;
use super::stand_in::{Sample, StandIn, Trust};
use super::told::RowWithout;
use crate::random::Stream;

/// Particles up to the last place, and points of a plane of one dimension.
const NUMBERS: [usize; 2] = [64, 8];
/// Places of a part, with points of a mixture.
const TOGETHER: usize = 4;
/// A mixture that was fitted to more outer unknowns than this would miss most of the posterior.
const MOST_OUTER: usize = 8;
/// Most mixtures, one after the other.
const ROUNDS: usize = 3;
/// Points tell little of a row where they are worth fewer equally weighted ones than this share of a round's.
const WORTH: f64 = 0.125;
/// Share of points with one number from where its prior lies.
const FAR: f64 = 0.1;

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
    with_numbers(density, draws, places, NUMBERS, seed)
}

/// The same with so many particles and points.
pub(super) fn with_numbers(
    density: &dyn LatentGaussian,
    draws: &[Vec<f64>],
    places: &[[usize; 2]],
    numbers: [usize; 2],
    seed: u64,
) -> WithoutRows {
    let seen: Vec<Seen> = draws
        .par_iter()
        .map_init(|| Memory::new(density), |memory, draw| memory.seen(draw))
        .collect();
    let layout = density.layout();
    let samples: Vec<Sample> = seen.iter().filter_map(|seen| seen.sample.clone()).collect();
    let mut stand_in = StandIn::new(layout);
    stand_in.fit(&samples, Trust::FULL, layout);
    let known = (&samples[..], &stand_in);
    let mut leaving = Leaving { density, known, numbers, seed, n_points: 0 };
    let rng = &mut Stream::LeftOutPoints.rng(seed);
    let may_propose = has_few_unknowns(layout) && (1..=MOST_OUTER).contains(&layout.outer.len());
    let tails = may_propose.then(|| prior_tails(density, rng)).flatten();
    let by_mixtures = tails.and_then(|tails| {
        let outer: Vec<Vec<f64>> = seen.iter().map(|seen| seen.outer.clone()).collect();
        leaving.by_mixtures(&outer, places, &tails, rng)
    });
    by_mixtures.unwrap_or_else(|| leaving.by_draws(seen, places))
}

/// How rows are told.
struct Leaving<'a> {
    density: &'a dyn LatentGaussian,
    /// Samples of the posterior, and the stand-in fitted to them.
    known: (&'a [Sample], &'a StandIn),
    /// Particles up to the last place, and points of a plane of one dimension.
    numbers: [usize; 2],
    seed: u64,
    /// Points so far.
    n_points: usize,
}

impl Leaving<'_> {
    /// The rows of these places at these points, `(point, place, row)`, with p(h) Ẑ₋ᵢ for their weights.
    fn at(&mut self, outer: &[Vec<f64>], places: &[[usize; 2]]) -> Vec<Vec<Vec<RowWithout>>> {
        let layout = self.density.layout();
        let forks = Forks::new(layout, places, self.known, (TOGETHER, self.numbers[0]));
        let (first, seed) = (self.n_points, self.seed);
        self.n_points += outer.len();
        let one = |memory: &mut Memory<'_>, (i, outer): (usize, &Vec<f64>)| {
            let rng = Stream::IntegratedOut { point: first + i }.rng(seed);
            let ln_prior = memory.latent.set_outer(outer, &mut memory.whitening.designs);
            let mut told = vec![vec![]; places.len()];
            if ln_prior.is_finite() {
                forks.tell(memory, rng, &mut told);
            }
            for row in told.iter_mut().flatten() {
                let ln_weight = row.ln_weight + ln_prior;
                // where no particle has a weight, the mean of these is no number
                row.ln_weight = if ln_weight.is_nan() { f64::NEG_INFINITY } else { ln_weight };
            }
            told
        };
        outer
            .par_iter()
            .enumerate()
            .map_init(|| Memory::new(self.density), |memory, at| one(memory, at))
            .collect()
    }

    /// At draws of the posterior.
    fn by_draws(&self, seen: Vec<Seen>, places: &[[usize; 2]]) -> WithoutRows {
        let one = |memory: &mut Memory<'_>, (i, seen): (usize, &Seen)| {
            let mut rng = Stream::IntegratedOut { point: i }.rng(self.seed);
            let mut told = vec![vec![]; places.len()];
            memory.latent.set_outer(&seen.outer, &mut memory.whitening.designs);
            let at = (self.known.1, &seen.coefficients[..]);
            planes::tell(memory, at, (places, self.numbers[1]), &mut rng, &mut told);
            told
        };
        let mut rows: Vec<Vec<Vec<RowWithout>>> = seen
            .par_iter()
            .enumerate()
            .map_init(|| Memory::new(self.density), |memory, at| one(memory, at))
            .collect();
        for place in 0..places.len() {
            // weights are those of all draws, or of none
            let cannot = rows.iter().any(|told| told[place].is_empty());
            rows.iter_mut().filter(|_| cannot).for_each(|told| told[place].clear());
        }
        WithoutRows { outer: seen.into_iter().map(|seen| seen.outer).collect(), rows }
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
            let rows = self.at(&drawn, &own);
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
        for place in asked {
            self.n_rounds[*place] += 1;
        }
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

    /// Those of these places with a row of which the points tell little, and the sum of the weights of such rows, one for
    /// each point.
    pub(super) fn poor(&self, places: &[usize]) -> (Vec<usize>, Vec<f64>) {
        let (mut poor, mut weights) = (vec![], vec![0.0; self.outer.len()]);
        for place in places {
            let n_rows = self.rows.iter().map(|told| told[*place].len()).max().unwrap_or(0);
            let of_rows = (0..n_rows).map(|row| normalised(&self.ln_weights(*place, row)));
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

/// A draw: its outer unknowns and coefficients, and its latent values with their slopes, unless these are not finite.
struct Seen {
    outer: Vec<f64>,
    coefficients: Vec<f64>,
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
        let coefficients = self.coefficients.clone();
        Seen { outer, coefficients, sample: is_finite.then_some(Sample { theta, slope }) }
    }
}
