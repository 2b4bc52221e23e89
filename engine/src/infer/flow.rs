//! Steps of a Hamiltonian trajectory, as `tree.rs` walks them: each made in smaller parts where it is too long.
//!
//! # Source
//! Betancourt 2017 for the generalised U-turn criterion p♯ · Σp > 0 at both ends of every subtree and across every join.

use super::density::Evaluator;
use super::hamiltonian::{Hamiltonian, PhasePoint};
use super::tree::{Direction, Stop, Trajectory};
use crate::num::vector::{axpy, dots_with_sum};
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

/// Energy error beyond which a trajectory counts as divergent.
const MAX_ENERGY_ERROR: f64 = 1000.0;

/// Difference of energies along one step beyond which the step is made in smaller parts.
const ROUGH: f64 = 4.0;
/// How often a step is halved.
const MOST_HALVINGS: u32 = 7;

/// The Hamiltonian flow as a trajectory, with the running statistics of one transition.
pub(super) struct Flow<E> {
    pub(super) hamiltonian: Hamiltonian<E>,
    pub(super) rng: ChaCha8Rng,
    pub(super) step_size: f64,
    /// Energy at the start of the transition.
    pub(super) energy: f64,
    /// Energy of the newest point.
    newest_energy: f64,
    /// Leapfrog steps.
    pub(super) n: u32,
    /// Points, and the sum of their acceptances.
    pub(super) n_points: u32,
    pub(super) accept: f64,
    /// Where the present step began, and a way back from where it ended.
    begun: PhasePoint,
    back: PhasePoint,
}

impl<E> Flow<E> {
    pub(super) fn new(hamiltonian: Hamiltonian<E>, dim: usize, rng: ChaCha8Rng) -> Self {
        Self {
            hamiltonian,
            rng,
            step_size: 0.0,
            energy: 0.0,
            newest_energy: 0.0,
            n: 0,
            n_points: 0,
            accept: 0.0,
            begun: PhasePoint::new(dim),
            back: PhasePoint::new(dim),
        }
    }

    pub(super) fn begin(&mut self, step_size: f64, energy: f64) {
        self.step_size = step_size;
        self.energy = energy;
        self.newest_energy = energy;
        self.n = 0;
        self.n_points = 0;
        self.accept = 0.0;
    }
}

/// What one step of a trajectory came to.
pub(super) struct Step {
    /// ln of the weight of its end: the energy at the trajectory's start less that of the end.
    pub(super) ln_weight: f64,
    /// Of a step that was halved: the difference of energies along the whole one.
    pub(super) whole: Option<f64>,
}

impl<E: Evaluator> Flow<E> {
    /// Moves `point` by `step_size` in 2^halvings leapfrog steps. Returns the difference between the
    /// highest energy and the lowest on the way; not finite where the density is not.
    fn parts(&mut self, point: &mut PhasePoint, step_size: f64, halvings: u32) -> f64 {
        let n = 1 << halvings;
        let [mut low, mut high] = [point.energy(); 2];
        for _ in 0..n {
            self.hamiltonian.leapfrog(point, step_size / f64::from(n));
            self.n += 1;
            let energy = point.energy();
            if !energy.is_finite() {
                return f64::INFINITY;
            }
            (low, high) = (low.min(energy), high.max(energy));
        }
        high - low
    }

    /// Moves `edge` by one step. A step along which energies differ by more than [`ROUGH`] is made
    /// again in twice as many parts. It counts only if the way back, chosen by the same rule, has as
    /// many: so the map from point to point stays its own inverse, and the draws stay exact.
    pub(super) fn advance(&mut self, edge: &mut PhasePoint, step_size: f64) -> Result<Step, Stop> {
        self.begun.copy_from(edge);
        let whole = self.parts(edge, step_size, 0);
        let (mut change, mut halvings) = (whole, 0);
        while change > ROUGH {
            if halvings == MOST_HALVINGS {
                return Err(Stop::Divergence);
            }
            halvings += 1;
            edge.copy_from(&self.begun);
            change = self.parts(edge, step_size, halvings);
        }
        for fewer in 0..halvings {
            let mut back = std::mem::take(&mut self.back);
            back.copy_from(edge);
            let change = self.parts(&mut back, -step_size, fewer);
            self.back = back;
            if change <= ROUGH {
                return Err(Stop::OneWay);
            }
        }
        self.newest_energy = edge.energy();
        let ln_weight = self.energy - self.newest_energy;
        // NaN, from an undefined density or gradient, is in no range and diverges.
        if !(-MAX_ENERGY_ERROR..f64::INFINITY).contains(&ln_weight) {
            return Err(Stop::Divergence);
        }
        Ok(Step { ln_weight, whole: (halvings > 0).then_some(whole) })
    }
}

/// What becomes the next point if chosen.
pub(super) struct Proposal {
    pub(super) position: Vec<f64>,
    pub(super) gradient: Vec<f64>,
    pub(super) ln_density: f64,
    pub(super) energy: f64,
}

impl Proposal {
    pub(super) fn new(dim: usize) -> Self {
        let zeros = vec![0.0; dim];
        Self { position: zeros.clone(), gradient: zeros, ln_density: 0.0, energy: 0.0 }
    }
}

/// Whitened momenta at both ends of a run of points, in order of travel, and their sum over it.
pub(super) struct Span {
    pub(super) first: Vec<f64>,
    pub(super) last: Vec<f64>,
    pub(super) sum: Vec<f64>,
}

impl Span {
    pub(super) fn new(dim: usize) -> Self {
        let zeros = vec![0.0; dim];
        Self { first: zeros.clone(), last: zeros.clone(), sum: zeros }
    }
}

impl<E: Evaluator> Trajectory for Flow<E> {
    type Edge = PhasePoint;
    type Proposal = Proposal;
    type Span = Span;

    fn step(&mut self, edge: &mut PhasePoint, direction: Direction) -> Result<f64, Stop> {
        let forward = direction == Direction::Forward;
        let step_size = if forward { self.step_size } else { -self.step_size };
        self.n_points += 1;
        let Step { ln_weight, whole } = self.advance(edge, step_size)?;
        // the step size is tuned to steps that are whole
        self.accept += whole.map_or(ln_weight.min(0.0), |change| -change).exp();
        Ok(ln_weight)
    }

    fn leaf(&mut self, edge: &PhasePoint, proposal: &mut Proposal, span: &mut Span) {
        proposal.position.copy_from_slice(&edge.position);
        proposal.gradient.copy_from_slice(&edge.gradient);
        proposal.ln_density = edge.ln_density;
        proposal.energy = self.newest_energy;
        span.first.copy_from_slice(&edge.momentum);
        span.last.copy_from_slice(&edge.momentum);
        span.sum.copy_from_slice(&edge.momentum);
    }

    fn choose(&mut self, current: &mut Proposal, other: &mut Proposal, probability: f64) {
        if self.rng.random::<f64>() < probability {
            std::mem::swap(current, other);
        }
    }

    fn join(&mut self, span: &mut Span, next: &Span) -> bool {
        let turns = |a: &[f64], b: &[f64], x: &[f64], y: &[f64]| {
            let [at_a, at_b] = dots_with_sum(a, b, x, y);
            at_a <= 0.0 || at_b <= 0.0
        };
        // The whole; then span with next's first point, and span's last point with next.
        let turning = turns(&span.first, &next.last, &span.sum, &next.sum)
            || turns(&span.first, &next.first, &span.sum, &next.first)
            || turns(&span.last, &next.last, &span.last, &next.sum);
        axpy(1.0, &next.sum, &mut span.sum);
        span.last.copy_from_slice(&next.last);
        turning
    }

    fn reverse(&mut self, span: &mut Span) {
        std::mem::swap(&mut span.first, &mut span.last);
    }
}
