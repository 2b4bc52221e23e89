//! One transition of the no-U-turn sampler: the tree of `tree.rs` on the dynamics of `hamiltonian.rs`.
//!
//! # Source
//! Hoffman & Gelman 2014; Betancourt 2017 for multinomial trajectories and the generalised U-turn
//! criterion p♯ · Σp > 0 at both ends of every subtree and across every join.

use super::curvature::Curvature;
use super::density::Evaluator;
use super::draws::Transition;
use super::hamiltonian::{Hamiltonian, Metric, PhasePoint};
use super::kernel_state::KernelState;
use super::scales::move_scales;
use super::tree::{self, Direction, Stop, Subtree, Trajectory, Workspace};
use crate::num::vector::{axpy, dots_with_sum};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Energy error beyond which a trajectory counts as divergent.
const MAX_ENERGY_ERROR: f64 = 1000.0;

/// Difference of energies along one step beyond which the step is made in smaller parts.
const ROUGH: f64 = 4.0;
/// Mean length of a trajectory that does not look for a U-turn, in standard deviations.
pub(super) const QUARTER_PERIOD: f64 = 1.6;
/// How often a step is halved.
const MOST_HALVINGS: u32 = 7;

/// What makes transitions: the current point, the random stream and the tree's memory.
pub(super) struct Kernel<E: Evaluator> {
    flow: Flow<E>,
    workspace: Workspace<Flow<E>>,
    edges: [PhasePoint; 2],
    max_depth: u32,
    /// The current point; its momentum is that of the last draw.
    pub(super) point: PhasePoint,
}

impl<E: Evaluator> Kernel<E> {
    /// A chain at `position`, whose density must be finite for the chain to move.
    pub(super) fn new(
        hamiltonian: Hamiltonian<E>,
        position: &[f64],
        max_depth: u32,
        rng: ChaCha8Rng,
    ) -> Self {
        let dim = position.len();
        let mut point = PhasePoint::new(dim);
        point.position.copy_from_slice(position);
        let mut flow = Flow::new(hamiltonian, dim, rng);
        flow.hamiltonian.evaluate(&mut point);
        let blank = || Subtree::new(Proposal::new(dim), Span::new(dim));
        Self {
            flow,
            workspace: Workspace::new(max_depth, blank),
            edges: [PhasePoint::new(dim), PhasePoint::new(dim)],
            max_depth,
            point,
        }
    }

    pub(super) fn hamiltonian(&mut self) -> &mut Hamiltonian<E> {
        &mut self.flow.hamiltonian
    }

    pub(super) fn metric(&self) -> &Metric {
        &self.flow.hamiltonian.metric
    }

    /// The density's evaluator.
    pub(super) fn evaluator(&self) -> &E {
        &self.flow.hamiltonian.evaluator
    }

    /// The density's evaluator and the point. The evaluator may be changed in what it depends on
    /// besides the point.
    pub(super) fn parts(&mut self) -> (&mut E, &mut PhasePoint) {
        (&mut self.flow.hamiltonian.evaluator, &mut self.point)
    }

    /// For [`Kernel::restore`].
    pub(super) fn state(&self) -> KernelState {
        let Hamiltonian { metric, n_evaluations, .. } = &self.flow.hamiltonian;
        KernelState {
            position: self.point.position.clone(),
            gradient: self.point.gradient.clone(),
            ln_density: self.point.ln_density,
            metric: metric.clone(),
            word: self.flow.rng.get_word_pos(),
            n_evaluations: *n_evaluations,
        }
    }

    /// Goes on from `state`, as if the chain had not been interrupted. The density and the random
    /// stream must be the same.
    pub(super) fn restore(&mut self, state: KernelState) {
        self.point.position = state.position;
        self.point.gradient = state.gradient;
        self.point.ln_density = state.ln_density;
        self.flow.hamiltonian.metric = state.metric;
        self.flow.hamiltonian.n_evaluations = state.n_evaluations;
        self.flow.rng.set_word_pos(state.word);
    }

    /// Whether density and gradient are finite at the current point.
    pub(super) fn is_usable(&self) -> bool {
        self.point.ln_density.is_finite() && self.point.gradient.iter().all(|g| g.is_finite())
    }

    /// Evaluates the current point anew, after the density has changed.
    pub(super) fn evaluate(&mut self) {
        self.flow.hamiltonian.evaluate(&mut self.point);
    }

    pub(super) fn n_evaluations(&self) -> u64 {
        self.flow.hamiltonian.n_evaluations
    }

    /// Draws p ~ N(0, I) at the current point; 0 where the metric lets nothing move.
    pub(super) fn refresh_momentum(&mut self) {
        let rng = &mut self.flow.rng;
        self.point.momentum.fill_with(|| rng.sample(StandardNormal));
        for (p, scale) in self.point.momentum.iter_mut().zip(&self.flow.hamiltonian.metric.scale) {
            if *scale == 0.0 {
                *p = 0.0;
            }
        }
    }

    /// Moves the current point as the density itself knows how to; then its scales, and with them what they multiply.
    pub(super) fn move_scales(&mut self, curvature: &Curvature) {
        let Flow { hamiltonian, rng, .. } = &mut self.flow;
        hamiltonian.evaluator.interweave(&mut self.point.position, rng);
        self.point.ln_density = hamiltonian.evaluator.value(&self.point.position);
        let n = move_scales(curvature, &mut hamiltonian.evaluator, &mut self.point, rng);
        hamiltonian.n_evaluations += 1 + n;
        self.evaluate();
    }

    /// Moves the current point by one transition with this step size.
    pub(super) fn transition(&mut self, step_size: f64) -> Transition {
        self.flow.hamiltonian.refresh_force(&mut self.point);
        self.refresh_momentum();
        self.flow.begin(step_size, self.point.energy());
        let directions = self.flow.rng.next_u32();
        for edge in &mut self.edges {
            edge.copy_from(&self.point);
        }
        let (depth, stop) = tree::transition(
            &mut self.flow,
            &mut self.edges,
            &mut self.workspace,
            directions,
            self.max_depth,
        );
        let drawn = self.workspace.chosen();
        self.point.position.copy_from_slice(&drawn.position);
        self.point.gradient.copy_from_slice(&drawn.gradient);
        self.point.ln_density = drawn.ln_density;
        Transition {
            accept: self.flow.accept / f64::from(self.flow.n_points.max(1)),
            energy: drawn.energy,
            depth,
            n_leapfrog: self.flow.n,
            diverging: stop == Stop::Divergence,
        }
    }

    /// Moves the current point by one trajectory of plain Hamiltonian Monte Carlo. Its length is
    /// random, 0.5 to 1.5 times `time`; its end is accepted or rejected.
    pub(super) fn static_transition(&mut self, step_size: f64, time: f64) -> Transition {
        self.flow.hamiltonian.refresh_force(&mut self.point);
        self.refresh_momentum();
        let energy = self.point.energy();
        let time = time * (0.5 + self.flow.rng.random::<f64>());
        let n = (time / step_size).round().clamp(1.0, f64::from(2u32.pow(self.max_depth)));
        self.flow.begin(step_size, energy);
        let [edge, _] = &mut self.edges;
        edge.copy_from(&self.point);
        let (mut ln_ratio, mut roughest, mut stop) = (0.0, 0.0_f64, None);
        for _ in 0..n as u32 {
            match self.flow.advance(edge, step_size) {
                Ok(Step { ln_weight, whole }) => {
                    ln_ratio = ln_weight;
                    roughest = roughest.max(whole.unwrap_or(0.0));
                }
                Err(why) => {
                    stop = Some(why);
                    break;
                }
            }
        }
        let accept = if stop.is_some() { 0.0 } else { f64::exp(ln_ratio).min(1.0) };
        let drawn = if self.flow.rng.random::<f64>() < accept {
            std::mem::swap(&mut self.point, edge);
            self.point.energy()
        } else {
            energy
        };
        let diverging = stop == Some(Stop::Divergence);
        if diverging {
            // the other end of the trajectory is where it began
            let [backward, forward] = &mut self.edges;
            forward.copy_from(backward);
        }
        let n_leapfrog = self.flow.n;
        // the step size is tuned to steps that are whole
        let accept = accept.min((-roughest).exp());
        Transition { accept, energy: drawn, depth: n_leapfrog.ilog2(), n_leapfrog, diverging }
    }

    /// Where the last transition diverged: the edge of its trajectory at the highest energy.
    pub(super) fn divergent_position(&self) -> &[f64] {
        let badness = |edge: &PhasePoint| {
            let energy = edge.energy();
            if energy.is_finite() { energy } else { f64::INFINITY }
        };
        let [backward, forward] = &self.edges;
        &if badness(forward) > badness(backward) { forward } else { backward }.position
    }

    /// min(1, exp(−energy error)) of a single leapfrog step with fresh momentum; 0 for NaN.
    pub(super) fn trial_acceptance(&mut self, step_size: f64) -> f64 {
        self.flow.hamiltonian.refresh_force(&mut self.point);
        self.refresh_momentum();
        let [trial, _] = &mut self.edges;
        trial.copy_from(&self.point);
        self.flow.hamiltonian.leapfrog(trial, step_size);
        let ratio = (self.point.energy() - trial.energy()).exp();
        // f64::min would turn NaN, a trial beyond the support, into 1.
        if ratio.is_nan() { 0.0 } else { ratio.min(1.0) }
    }
}

/// The Hamiltonian flow as a trajectory, with the running statistics of one transition.
struct Flow<E> {
    hamiltonian: Hamiltonian<E>,
    rng: ChaCha8Rng,
    step_size: f64,
    /// Energy at the start of the transition.
    energy: f64,
    /// Energy of the newest point.
    newest_energy: f64,
    /// Leapfrog steps.
    n: u32,
    /// Points, and the sum of their acceptances.
    n_points: u32,
    accept: f64,
    /// Where the present step began, and a way back from where it ended.
    begun: PhasePoint,
    back: PhasePoint,
}

impl<E> Flow<E> {
    fn new(hamiltonian: Hamiltonian<E>, dim: usize, rng: ChaCha8Rng) -> Self {
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

    fn begin(&mut self, step_size: f64, energy: f64) {
        self.step_size = step_size;
        self.energy = energy;
        self.newest_energy = energy;
        self.n = 0;
        self.n_points = 0;
        self.accept = 0.0;
    }
}

/// What one step of a trajectory came to.
struct Step {
    /// ln of the weight of its end: the energy at the trajectory's start less that of the end.
    ln_weight: f64,
    /// Of a step that was halved: the difference of energies along the whole one.
    whole: Option<f64>,
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
    fn advance(&mut self, edge: &mut PhasePoint, step_size: f64) -> Result<Step, Stop> {
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
struct Proposal {
    position: Vec<f64>,
    gradient: Vec<f64>,
    ln_density: f64,
    energy: f64,
}

impl Proposal {
    fn new(dim: usize) -> Self {
        let zeros = vec![0.0; dim];
        Self { position: zeros.clone(), gradient: zeros, ln_density: 0.0, energy: 0.0 }
    }
}

/// Whitened momenta at both ends of a run of points, in order of travel, and their sum over it.
struct Span {
    first: Vec<f64>,
    last: Vec<f64>,
    sum: Vec<f64>,
}

impl Span {
    fn new(dim: usize) -> Self {
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

#[cfg(test)]
#[path = "kernel_tests.rs"]
mod tests;
