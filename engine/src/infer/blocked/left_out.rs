//! How measurements are predicted from the others, from draws of the posterior that has seen them.
//!
//! What one measurement tells of its place, and through the fields of other places, moves the posterior so far that no
//! draw shows what it would be without it. So the coefficients integrate out, at the hyperparameters and free
//! unknowns of each draw:
//!
//! ```text
//! p(yᵢ | other y, outer) = Z / Z₋ᵢ      Z = ∫ p(w) L dw,  Z₋ᵢ the same without Lᵢ
//! ```
//! Both are estimated by the same particles, of which the draw's own coefficients are one ([`particles`]). The place of
//! the measurement comes last, and the lookahead knows nothing of it. Then the mean of Ẑ₋ᵢ/Ẑ is Z₋ᵢ/Z for any number
//! of particles, so that importance weights Ẑ₋ᵢ/Ẑ make draws those of the posterior without the measurement.
//!
//! [`particles`]: super::particles
//!
//! # Source
//! Vehtari, Mononen, Tolvanen, Sivula & Winther 2016, "Bayesian leave-one-out cross-validation approximations for
//! Gaussian latent variable models", for weights with the latent values integrated out.

use nalgebra::{DMatrix, DVector};
use rand::{Rng, RngExt as _};
use rayon::prelude::*;
use std::f64::consts::PI;

use super::latent::{LatentGaussian, Layout};
use super::mixture::Student;
use super::particles::{Here, Memory, Order, Swarm};
use super::stand_in::{Sample, StandIn, Trust};
use crate::num::ln_mean_exp;
use crate::num::vector::{axpy, dot};
use crate::random::Stream;

/// The lookahead is the stand-in with this share of its information: with all of it, what suits the rows at other
/// places less well would be given up too early.
const LOOKAHEAD: f64 = 0.5;
/// Particles up to the last place, and points of each there.
const PARTICLES: usize = 64;
const POINTS: usize = 4;
/// Degrees of freedom of what half of the points are drawn from, given the other places.
const NU: usize = 4;
/// How much wider the other half are drawn than the posterior has the values.
const WIDER: f64 = 1.25;

/// A row in one draw.
#[derive(Clone, Debug)]
pub struct RowWithout {
    /// ln of the density that is predicted of it from the other rows.
    pub ln_density: f64,
    /// Values of the blocks at its place, drawn given the other rows.
    pub theta: Vec<f64>,
}

/// Each row of these places, `[group, place]`, in each of `draws` of the density's unknowns `(dim)`: `(draw, place,
/// row)`. The rows of a place are missing in a draw from which they cannot be told.
pub fn without_rows(
    density: &dyn LatentGaussian,
    draws: &[Vec<f64>],
    places: &[[usize; 2]],
    seed: u64,
) -> Vec<Vec<Vec<RowWithout>>> {
    with_particles(density, draws, places, PARTICLES, seed)
}

/// The same with so many particles.
pub(super) fn with_particles(
    density: &dyn LatentGaussian,
    draws: &[Vec<f64>],
    places: &[[usize; 2]],
    n_particles: usize,
    seed: u64,
) -> Vec<Vec<Vec<RowWithout>>> {
    let layout = density.layout();
    let seen: Vec<Seen> = draws
        .par_iter()
        .map_init(|| Memory::new(density), |memory, draw| memory.seen(draw))
        .collect();
    let samples: Vec<Sample> = seen.iter().filter_map(|seen| seen.sample.clone()).collect();
    let mut stand_in = StandIn::new(layout);
    stand_in.fit(&samples, Trust::FULL, layout);
    let stand_in = stand_in.times(LOOKAHEAD);
    let place = |at: &[usize; 2]| Place {
        at: *at,
        n_particles,
        lookahead: stand_in.without(*at, layout),
        posterior: posterior(&samples, layout, *at),
    };
    let places: Vec<Place> = places.iter().map(place).collect();
    let one = |memory: &mut Memory<'_>, (i, seen): (usize, &Seen)| {
        let mut rng = Stream::IntegratedOut { draw: i }.rng(seed);
        let ln_prior = memory.latent.set_outer(&seen.outer, &mut memory.whitening.designs);
        let all = places.iter().map(|place| {
            let theta = seen.sample.as_ref().filter(|_| ln_prior.is_finite());
            theta.and_then(|sample| place.rows(memory, &sample.theta, &mut rng)).unwrap_or_default()
        });
        all.collect()
    };
    seen.par_iter()
        .enumerate()
        .map_init(|| Memory::new(density), |memory, at| one(memory, at))
        .collect()
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

/// Where the posterior has the values of a place; `None` if they do not vary.
fn posterior(samples: &[Sample], layout: &Layout, [group, place]: [usize; 2]) -> Option<Student> {
    let first = layout.n_latent_before(group);
    let own = &layout.groups[group];
    let n = own.blocks.len();
    let at =
        |sample: &Sample| DVector::from_fn(n, |f, _| sample.theta[first + f * own.n_seen + place]);
    let count = samples.len() as f64;
    let mean = samples.iter().fold(DVector::zeros(n), |sum, sample| sum + at(sample)) / count;
    let square = |sum, sample| {
        let d = at(sample) - &mean;
        sum + &d * d.transpose()
    };
    let covariance = samples.iter().fold(DMatrix::zeros(n, n), square) / count;
    Student::new(1.0, &mean, covariance * WIDER.powi(2), NU)
}

/// A place with a row that is asked for.
struct Place {
    /// `[group, place]`
    at: [usize; 2],
    n_particles: usize,
    lookahead: StandIn,
    posterior: Option<Student>,
}

impl Place {
    /// The rows of the place where a draw has these latent values; `None` where they cannot be told.
    fn rows(
        &self,
        memory: &mut Memory<'_>,
        theta: &[f64],
        rng: &mut impl Rng,
    ) -> Option<Vec<RowWithout>> {
        let Memory { layout, latent, whitening, .. } = memory;
        let here = Here::new(layout, &self.lookahead, whitening)?;
        let [group, _] = self.at;
        let order = Order::new(&here, group, Some(self.at[1]));
        let first = layout.n_latent_before(group);
        let present = order.standard(&theta[first..][..order.n()]);
        let n_before = layout.groups[group].n_seen - 1;
        let mut swarm = Swarm::new(order.n(), self.n_particles, Some(present.clone()));
        let before = swarm.run_until(&here, group, (&order, n_before), &mut **latent, rng);
        let points = self.points(&order, &swarm, &present, rng);
        let lns = latent.ln_of_rows(self.at, &points.theta);
        let n_blocks = layout.groups[group].blocks.len();
        let row = |own: usize| {
            let mut without = points.ln_weights.clone();
            let others = lns.iter().enumerate().filter(|(other, _)| *other != own);
            others.for_each(|(_, lns)| axpy(1.0, lns, &mut without));
            let with: Vec<f64> = without.iter().zip(&lns[own]).map(|(a, b)| a + b).collect();
            let [ln_with, ln_without] = [&with, &without].map(|lns| ln_mean_exp(lns));
            let chosen = pick(&without, rng);
            RowWithout {
                ln_density: ln_with - ln_without,
                theta: points.theta[chosen * n_blocks..][..n_blocks].to_vec(),
            }
        };
        before.is_finite().then(|| (0..lns.len()).map(row).collect())
    }

    /// Values of this place, given those that the particles have at all others.
    fn points(&self, order: &Order, swarm: &Swarm, present: &[f64], rng: &mut impl Rng) -> Points {
        let mut last = Last::new(order, self.posterior.as_ref());
        let mut points = Points::default();
        for particle in 0..self.n_particles {
            last.set_given(order, swarm, particle);
            let ln_particle = swarm.ln_weight(particle);
            // which half of the points the draw's own value belongs to follows from the densities of drawing it
            let own = (particle == 0).then(|| {
                last.set(&present[last.first..]);
                let [others, posterior] = last.densities();
                usize::from(rng.random::<f64>() * (others + posterior) < posterior)
            });
            for point in 0..last.n_points() {
                if own == Some(point) {
                    last.set(&present[last.first..]);
                } else {
                    last.draw(point % 2 == 1, rng);
                }
                points.ln_weights.push(ln_particle + last.ln_weight());
                points.theta.extend_from_slice(&last.theta);
            }
        }
        points
    }
}

/// Values of a place `(n, n_blocks)`, and ln of their weights.
#[derive(Default)]
struct Points {
    theta: Vec<f64>,
    ln_weights: Vec<f64>,
}

/// The last place of an order, whose values are θ = given + L ε, and one point there.
struct Last<'a> {
    first: usize,
    /// The rows of L.
    rows: Vec<&'a [f64]>,
    /// Blocks whose values the other places do not determine.
    open: Vec<usize>,
    /// The determinant of L.
    scale: f64,
    from_others: Student,
    from_posterior: Option<&'a Student>,
    given: Vec<f64>,
    theta: Vec<f64>,
    /// ε of every block, and of those that are open.
    eps: [Vec<f64>; 2],
    scratch: Vec<f64>,
}

impl<'a> Last<'a> {
    fn new(order: &'a Order, posterior: Option<&'a Student>) -> Self {
        let first = order.n() - order.n_blocks;
        let rows: Vec<&[f64]> = (first..order.n()).map(|i| &order.row(i)[first..]).collect();
        let open: Vec<usize> = (0..rows.len()).filter(|f| rows[*f][*f] > 0.0).collect();
        let n = rows.len();
        Self {
            first,
            scale: open.iter().map(|f| rows[*f][*f]).product(),
            from_others: Student::standard(open.len(), NU),
            from_posterior: posterior.filter(|_| open.len() == n),
            given: vec![0.0; n],
            theta: vec![0.0; n],
            eps: [vec![0.0; n], vec![0.0; open.len()]],
            scratch: vec![],
            rows,
            open,
        }
    }

    fn n_points(&self) -> usize {
        if self.open.is_empty() { 1 } else { POINTS }
    }

    /// What the other places say of this one in a particle.
    fn set_given(&mut self, order: &Order, swarm: &Swarm, particle: usize) {
        let eps = swarm.particle(particle);
        for (f, given) in self.given.iter_mut().enumerate() {
            *given = order.given_before(self.first + f, self.first, &eps);
        }
    }

    /// Takes up ε of each block.
    fn set(&mut self, eps: &[f64]) {
        self.eps[0].copy_from_slice(eps);
        self.open.iter().zip(&mut self.eps[1]).for_each(|(f, x)| *x = eps[*f]);
        self.set_theta();
    }

    fn set_theta(&mut self) {
        for ((theta, given), row) in self.theta.iter_mut().zip(&self.given).zip(&self.rows) {
            *theta = given + dot::<1>(row, &self.eps[0][..row.len()]);
        }
    }

    /// Takes up a random value: from where the posterior has it, or from what the other places say.
    fn draw(&mut self, from_posterior: bool, rng: &mut impl Rng) {
        let [eps, open] = &mut self.eps;
        if let Some(posterior) = self.from_posterior.filter(|_| from_posterior) {
            posterior.draw(rng, &mut self.theta);
            for (f, row) in self.rows.iter().enumerate() {
                eps[f] = (self.theta[f] - self.given[f] - dot::<1>(&row[..f], &eps[..f])) / row[f];
            }
            open.copy_from_slice(eps);
        } else {
            self.from_others.draw(rng, open);
            self.open.iter().zip(open).for_each(|(f, x)| eps[*f] = *x);
            self.set_theta();
        }
    }

    /// The densities of drawing ε from what the other places say, and from where the posterior has it.
    fn densities(&mut self) -> [f64; 2] {
        let others = self.from_others.density(&self.eps[1], &mut self.scratch);
        let posterior =
            |student: &Student| self.scale * student.density(&self.theta, &mut self.scratch);
        [others, self.from_posterior.map_or(0.0, posterior)]
    }

    /// ln of the standard normal density of ε over that of drawing it.
    fn ln_weight(&mut self) -> f64 {
        let square: f64 = self.eps[1].iter().map(|x| x * x).sum();
        let ln_normal = -0.5 * (square + (2.0 * PI).ln() * self.open.len() as f64);
        let [others, posterior] = self.densities();
        let share = if self.from_posterior.is_some() { 0.5 } else { 1.0 };
        ln_normal - (share * (others + posterior)).ln()
    }
}

/// A number among these, by weights of which these are the logarithms.
fn pick(ln_weights: &[f64], rng: &mut impl Rng) -> usize {
    let most = ln_weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights = || ln_weights.iter().map(|ln| (ln - most).exp());
    let mut left = weights().sum::<f64>() * rng.random::<f64>();
    let own = weights().position(|weight| {
        left -= weight;
        left < 0.0
    });
    own.unwrap_or(0)
}
