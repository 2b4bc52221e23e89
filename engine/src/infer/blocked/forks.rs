//! How rows of each place are told from those at all others, at one point of the outer unknowns: the place comes last in
//! an order, and the lookahead knows nothing of it.
//!
//! Each place is the last one in turn, but the ways to them begin alike. The places are in parts. On the way to a part
//! particles first get values at all places that are not in it, and know nothing of the part. To go on they fork: some go
//! through the first half of it to the second, others through the second to the first; and so on, until a single place
//! is left.

use nalgebra::{DMatrix, DVector};
use rand::Rng;

use super::last::{self, Last};
use super::latent::{Latent, Layout};
use super::mixture::Student;
use super::order::Order;
use super::particles::{Here, Memory, Swarm};
use super::stand_in::{Sample, StandIn};
use super::told::{RowWithout, Values};
use crate::num::vector::add_ln;

/// The lookahead is the stand-in with this share of its information: with all of it, what suits the rows at other
/// places less well would be given up too early.
const LOOKAHEAD: f64 = 0.5;
/// How much wider half of the points at the last place are drawn than the posterior has the values.
const WIDER: f64 = 1.25;

/// The ways to all places that are asked for: what all points of the outer unknowns share.
pub(super) struct Forks<'a> {
    layout: &'a Layout,
    /// `[group, place]` of each.
    places: &'a [[usize; 2]],
    /// Where the posterior has the values of each; `None` if they do not vary.
    posteriors: Vec<Option<Student>>,
    lookahead: StandIn,
    parts: Vec<Part>,
    n_particles: usize,
}

/// Some places of a group, and all others, which come before.
struct Part {
    group: usize,
    /// Their numbers among those asked for.
    wanted: Vec<usize>,
    before: Vec<usize>,
    /// What is known of the places before.
    lookahead: StandIn,
}

impl<'a> Forks<'a> {
    /// To these places, `most` to a part, by samples of the posterior and the stand-in fitted to them.
    pub(super) fn new(
        layout: &'a Layout,
        places: &'a [[usize; 2]],
        (samples, stand_in): (&[Sample], &StandIn),
        (most, n_particles): (usize, usize),
    ) -> Self {
        let posteriors = places.iter().map(|at| posterior(samples, layout, *at)).collect();
        let lookahead = stand_in.times(LOOKAHEAD);
        let mut new = Self { layout, places, posteriors, lookahead, parts: vec![], n_particles };
        new.parts = (0..layout.groups.len()).flat_map(|group| new.parts_of(group, most)).collect();
        new
    }

    /// The parts of a group, of nearly equal size.
    fn parts_of(&self, group: usize, most: usize) -> Vec<Part> {
        let n_seen = self.layout.groups[group].n_seen;
        let of_group = |i: &usize| self.places[*i][0] == group;
        let wanted: Vec<usize> = (0..self.places.len()).filter(of_group).collect();
        let part = |wanted: &[usize]| {
            let comes_last = |place: &usize| wanted.iter().any(|i| self.places[*i][1] == *place);
            let (last, before): (Vec<usize>, Vec<usize>) = (0..n_seen).partition(comes_last);
            let lookahead = self.lookahead.without(group, &last, self.layout);
            Part { group, wanted: wanted.to_vec(), before, lookahead }
        };
        let n_parts = wanted.len().div_ceil(most.max(1));
        wanted.chunks(wanted.len().div_ceil(n_parts.max(1)).max(1)).map(part).collect()
    }

    /// Writes the rows of each place at the designs of `memory`, and none where they cannot be told. The weight of a row is
    /// an estimate of ∫ p(w) L dw without it.
    pub(super) fn tell(
        &self,
        memory: &mut Memory<'_>,
        mut rng: impl Rng,
        told: &mut [Vec<RowWithout>],
    ) {
        let evidence = self.evidence(memory, &mut rng);
        let Memory { layout, latent, whitening, .. } = memory;
        for part in &self.parts {
            let Some(here) = Here::new(layout, &part.lookahead, whitening) else { continue };
            let others: f64 = evidence
                .iter()
                .enumerate()
                .filter(|(g, _)| *g != part.group)
                .map(|(_, ln)| ln)
                .sum();
            let law = here.law(part.group);
            let mut order = Order::new(&law);
            part.before.iter().for_each(|place| order.append(*place));
            let mut swarm = Swarm::new(self.n_particles, None);
            let mut branch = Branch {
                forks: self,
                part,
                ln_evidence: here.whitening.ln_evidence + others,
                latent: &mut **latent,
                rng: &mut rng,
                told,
            };
            if branch.run(&mut swarm, &order) {
                branch.tell(order, swarm, &part.wanted);
            }
        }
    }

    /// ln of what each group adds to the evidence of the lookahead, where there are several.
    fn evidence(&self, memory: &mut Memory<'_>, rng: &mut impl Rng) -> Vec<f64> {
        let Memory { layout, latent, whitening, .. } = memory;
        let n_groups = layout.groups.len();
        if n_groups < 2 {
            return vec![];
        }
        let Some(here) = Here::new(layout, &self.lookahead, whitening) else {
            return vec![f64::NEG_INFINITY; n_groups];
        };
        let of_group = |(group, stand_in)| {
            let law = here.law(group);
            let mut swarm = Swarm::new(self.n_particles, None);
            swarm.run(&law.order(), stand_in, group, &mut **latent, rng)
        };
        self.lookahead.groups.iter().enumerate().map(of_group).collect()
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

/// The way of the particles to the places of a part.
struct Branch<'a, R> {
    forks: &'a Forks<'a>,
    part: &'a Part,
    /// ln of the evidence of the lookahead, and of what other groups add to it.
    ln_evidence: f64,
    latent: &'a mut dyn Latent,
    rng: &'a mut R,
    told: &'a mut [Vec<RowWithout>],
}

impl<R: Rng> Branch<'_, R> {
    /// Whether there is a particle with a weight at the end of the order.
    fn run(&mut self, swarm: &mut Swarm, order: &Order<'_>) -> bool {
        let stand_in = &self.forks.lookahead.groups[self.part.group];
        swarm.run(order, stand_in, self.part.group, self.latent, self.rng).is_finite()
    }

    /// Writes the rows of places that are not yet in the order, whose values the particles have. On the way to one half of
    /// them they go through the other, and look ahead no farther.
    fn tell(&mut self, mut order: Order<'_>, swarm: Swarm, wanted: &[usize]) {
        if let [last] = wanted {
            order.append(self.forks.places[*last][1]);
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
            order.append(self.forks.places[*i][1]);
        }
        let stand_in = &self.forks.lookahead.groups[self.part.group];
        let Some((by, ahead)) = order.ahead(n, stand_in) else { return };
        swarm.look_ahead(&ahead, self.rng);
        if self.run(&mut swarm, &by) {
            swarm.change(n, &by, &order);
            self.tell(order, swarm, to);
        }
    }

    /// The rows of the last place of the order, where the particles have values at all before.
    fn rows(&mut self, order: &Order<'_>, swarm: &Swarm, wanted: usize) -> Vec<RowWithout> {
        let values = self.values(order, swarm, wanted);
        let lns = self.latent.ln_of_rows(self.forks.places[wanted], &values.theta);
        let mut rows = values.rows(&lns, self.rng);
        for row in &mut rows {
            row.ln_weight += self.ln_evidence;
        }
        rows
    }

    /// Values of this place, given those that the particles have at all others.
    fn values(&mut self, order: &Order<'_>, swarm: &Swarm, wanted: usize) -> Values {
        let mut last = Last::new(order, self.forks.posteriors[wanted].as_ref());
        let given = swarm.given(order);
        let n = self.forks.n_particles * last.n_points();
        let mut values = Values {
            theta: Vec::with_capacity(n * order.n_blocks()),
            ln_weights: Vec::with_capacity(n),
        };
        let mut densities = Vec::with_capacity(n);
        for particle in 0..self.forks.n_particles {
            last.set_given(given.iter().skip(particle).step_by(self.forks.n_particles));
            let ln_particle = swarm.ln_weight(particle);
            for point in 0..last.n_points() {
                last.draw(point % 2 == 1, self.rng);
                values.ln_weights.push(ln_particle + last.ln_normal());
                densities.push(last.density());
                values.theta.extend_from_slice(last.theta());
            }
        }
        add_ln(-1.0, &densities, &mut values.ln_weights);
        values
    }
}
