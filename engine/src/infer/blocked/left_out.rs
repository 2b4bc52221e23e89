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
//! Each place is the last one in turn, but the ways to them begin alike. Particles first get values at one half of the
//! places, and know nothing of the other half. To go on they fork: some go through the first quarter to the second, others
//! through the second to the first; and so on, until a single place is left. So n places take n log n steps instead of n².
//!
//! [`particles`]: super::particles
//!
//! # Source
//! Vehtari, Mononen, Tolvanen, Sivula & Winther 2016, "Bayesian leave-one-out cross-validation approximations for
//! Gaussian latent variable models", for weights with the latent values integrated out.

use nalgebra::{DMatrix, DVector};
use rand::{Rng, RngExt as _};
use rayon::prelude::*;

use super::last::{self, Last};
use super::latent::{Latent, LatentGaussian, Layout};
use super::mixture::Student;
use super::order::Order;
use super::particles::{Here, Memory, Swarm, pick, sums};
use super::stand_in::{Sample, StandIn, Trust};
use crate::num::vector::{add_ln, axpy, exp_of_less};
use crate::random::Stream;

/// The lookahead is the stand-in with this share of its information: with all of it, what suits the rows at other
/// places less well would be given up too early.
const LOOKAHEAD: f64 = 0.5;
/// Particles up to the last place.
const PARTICLES: usize = 64;
/// How much wider half of the points at the last place are drawn than the posterior has the values.
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
    let lookahead = stand_in.times(LOOKAHEAD);
    let posterior = |at: &[usize; 2]| posterior(&samples, layout, *at);
    let posteriors: Vec<_> = places.iter().map(posterior).collect();
    let shared =
        Shared { layout, places, posteriors: &posteriors, lookahead: &lookahead, n_particles };
    let halves: Vec<Half> =
        (0..layout.groups.len()).flat_map(|group| shared.halves(group)).collect();
    let one = |memory: &mut Memory<'_>, (i, seen): (usize, &Seen)| {
        let rng = Stream::IntegratedOut { draw: i }.rng(seed);
        let ln_prior = memory.latent.set_outer(&seen.outer, &mut memory.whitening.designs);
        let mut told = vec![vec![]; places.len()];
        if let Some(sample) = seen.sample.as_ref().filter(|_| ln_prior.is_finite()) {
            shared.tell(&halves, memory, &sample.theta, rng, &mut told);
        }
        told
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
    Student::new(1.0, &mean, covariance * WIDER.powi(2), last::NU)
}

/// What all draws share.
struct Shared<'a> {
    layout: &'a Layout,
    /// `[group, place]` of each place with rows that are asked for.
    places: &'a [[usize; 2]],
    /// Where the posterior has the values of each.
    posteriors: &'a [Option<Student>],
    lookahead: &'a StandIn,
    n_particles: usize,
}

/// Some places of a group, and all others, which come before.
struct Half {
    group: usize,
    /// Their numbers among those asked for.
    wanted: Vec<usize>,
    before: Vec<usize>,
    /// What is known of the places before.
    lookahead: StandIn,
}

impl Shared<'_> {
    /// The two halves of the places of a group that are asked for, each with all its other places before.
    fn halves(&self, group: usize) -> Vec<Half> {
        let n_seen = self.layout.groups[group].n_seen;
        let of_group = |i: &usize| self.places[*i][0] == group;
        let wanted: Vec<usize> = (0..self.places.len()).filter(of_group).collect();
        let half = |wanted: &[usize]| {
            let comes_last = |place: &usize| wanted.iter().any(|i| self.places[*i][1] == *place);
            let (last, before): (Vec<usize>, Vec<usize>) = (0..n_seen).partition(comes_last);
            let without =
                |known: StandIn, place: &usize| known.without([group, *place], self.layout);
            let lookahead = last.iter().fold(self.lookahead.clone(), without);
            Half { group, wanted: wanted.to_vec(), before, lookahead }
        };
        let (first, second) = wanted.split_at(wanted.len() / 2);
        [first, second].into_iter().filter(|half| !half.is_empty()).map(half).collect()
    }

    /// Writes the rows of each place where a draw has these latent values, and none where they cannot be told.
    fn tell(
        &self,
        halves: &[Half],
        memory: &mut Memory<'_>,
        theta: &[f64],
        mut rng: impl Rng,
        told: &mut [Vec<RowWithout>],
    ) {
        let Memory { layout, latent, whitening, .. } = memory;
        for half in halves {
            let Some(here) = Here::new(layout, &half.lookahead, whitening) else { continue };
            let law = here.law(half.group);
            let mut order = Order::new(&law);
            half.before.iter().for_each(|place| order.append(*place));
            let first = layout.n_latent_before(half.group);
            let present = theta[first..][..layout.groups[half.group].n_latent()].to_vec();
            let mut swarm = Swarm::new(self.n_particles, Some(present));
            let mut branch = Branch {
                shared: self,
                group: half.group,
                latent: &mut **latent,
                rng: &mut rng,
                told,
            };
            if branch.run(&mut swarm, &order) {
                branch.tell(order, swarm, &half.wanted);
            }
        }
    }
}

/// The way of one draw's particles to the places of a group.
struct Branch<'a, R> {
    shared: &'a Shared<'a>,
    group: usize,
    latent: &'a mut dyn Latent,
    rng: &'a mut R,
    told: &'a mut [Vec<RowWithout>],
}

impl<R: Rng> Branch<'_, R> {
    /// Whether there is a particle with a weight at the end of the order.
    fn run(&mut self, swarm: &mut Swarm, order: &Order<'_>) -> bool {
        let stand_in = &self.shared.lookahead.groups[self.group];
        swarm.run(order, stand_in, self.group, self.latent, self.rng).is_finite()
    }

    /// Writes the rows of places that are not yet in the order, whose values the particles have. On the way to one half of
    /// them they go through the other, and look ahead no farther.
    fn tell(&mut self, mut order: Order<'_>, swarm: Swarm, wanted: &[usize]) {
        if let [last] = wanted {
            order.append(self.shared.places[*last][1]);
            self.told[*last] = self.rows(&order, &swarm, *last);
            return;
        }
        let (first, second) = wanted.split_at(wanted.len() / 2);
        self.fork(order.clone(), swarm.clone(), first, second);
        self.fork(order, swarm, second, first);
    }

    /// Goes through some places, and then to others.
    fn fork(&mut self, mut order: Order<'_>, mut swarm: Swarm, through: &[usize], to: &[usize]) {
        let n = order.n();
        for i in through {
            order.append(self.shared.places[*i][1]);
        }
        let stand_in = &self.shared.lookahead.groups[self.group];
        let Some((by, ahead)) = order.ahead(n, stand_in) else { return };
        swarm.look_ahead(&ahead, self.rng);
        if self.run(&mut swarm, &by) {
            swarm.change(n, &by, &order);
            self.tell(order, swarm, to);
        }
    }

    /// The rows of the last place of the order, where the particles have values at all before.
    fn rows(&mut self, order: &Order<'_>, swarm: &Swarm, wanted: usize) -> Vec<RowWithout> {
        let points = self.points(order, swarm, wanted);
        let lns = self.latent.ln_of_rows(self.shared.places[wanted], &points.theta);
        let n_blocks = order.n_blocks();
        let mut weights = vec![];
        let row = |own: usize| {
            let mut ln = points.ln_weights.clone();
            let others = lns.iter().enumerate().filter(|(other, _)| *other != own);
            others.for_each(|(_, lns)| axpy(1.0, lns, &mut ln));
            let most_without = exp_of_less(&ln, &mut weights);
            let sums = sums(&weights);
            let chosen = pick(&sums, self.rng);
            axpy(1.0, &lns[own], &mut ln);
            let most_with = exp_of_less(&ln, &mut weights);
            let with: f64 = weights.iter().sum();
            RowWithout {
                ln_density: most_with - most_without + (with / sums[sums.len() - 1]).ln(),
                theta: points.theta[chosen * n_blocks..][..n_blocks].to_vec(),
            }
        };
        (0..lns.len()).map(row).collect()
    }

    /// Values of this place, given those that the particles have at all others.
    fn points(&mut self, order: &Order<'_>, swarm: &Swarm, wanted: usize) -> Points {
        let mut last = Last::new(order, self.shared.posteriors[wanted].as_ref());
        let (present, given) = (swarm.present(order), swarm.given(order));
        let n = self.shared.n_particles * last.n_points();
        let mut points = Points {
            theta: Vec::with_capacity(n * order.n_blocks()),
            ln_weights: Vec::with_capacity(n),
        };
        let mut densities = Vec::with_capacity(n);
        for particle in 0..self.shared.n_particles {
            last.set_given(given.iter().skip(particle).step_by(self.shared.n_particles));
            let ln_particle = swarm.ln_weight(particle);
            // which half of the points the draw's own value belongs to follows from the densities of drawing it
            let own = (particle == 0).then(|| {
                last.set(&present[last.first()..]);
                let [others, posterior] = last.densities();
                usize::from(self.rng.random::<f64>() * (others + posterior) < posterior)
            });
            for point in 0..last.n_points() {
                if own == Some(point) {
                    last.set(&present[last.first()..]);
                } else {
                    last.draw(point % 2 == 1, self.rng);
                }
                points.ln_weights.push(ln_particle + last.ln_normal());
                densities.push(last.density());
                points.theta.extend_from_slice(last.theta());
            }
        }
        add_ln(-1.0, &densities, &mut points.ln_weights);
        points
    }
}

/// Values of a place `(n, n_blocks)`, and ln of their weights.
struct Points {
    theta: Vec<f64>,
    ln_weights: Vec<f64>,
}
