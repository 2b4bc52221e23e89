//! Transitions: one of the no-U-turn sampler, the tree of `tree.rs` over the steps of `flow.rs`, or one trajectory of a
//! given length.
//!
//! # Source
//! Hoffman & Gelman 2014; Betancourt 2017 for multinomial trajectories.

use super::curvature::Curvature;
use super::density::Evaluator;
use super::draws::Transition;
use super::flow::{Flow, Proposal, Span, Step};
use super::hamiltonian::{Hamiltonian, Metric, PhasePoint};
use super::kernel_state::KernelState;
use super::scales::move_scales;
use super::tree::{self, Stop, Subtree, Workspace};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Mean length of a trajectory that does not look for a U-turn, in standard deviations.
pub(super) const QUARTER_PERIOD: f64 = 1.6;

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
    /// Most steps of a trajectory that does not look for a U-turn. In the bulk of a posterior it takes some ten. At a poor
    /// place steps are tiny, and trajectories of full length would cost so much that the run does not end.
    const MOST_STEPS: u32 = 128;

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

    /// Moves the scales at the current point, and with them what they multiply; then all that the density itself knows how to.
    pub(super) fn move_scales(&mut self, curvature: &Curvature) {
        let Flow { hamiltonian, rng, .. } = &mut self.flow;
        let Hamiltonian { evaluator, n_evaluations, .. } = hamiltonian;
        *n_evaluations += move_scales(curvature, evaluator, &mut self.point, rng);
        let PhasePoint { position, gradient, .. } = &mut self.point;
        match evaluator.interweave(position, gradient, rng) {
            Some(ln_density) => {
                self.point.ln_density = ln_density;
                *n_evaluations += 1;
            }
            None => self.evaluate(),
        }
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
    /// random, 0.5 to 1.5 times `time`, or what [`Self::MOST_STEPS`] come to; its end is accepted or rejected.
    pub(super) fn static_transition(&mut self, step_size: f64, time: f64) -> Transition {
        self.flow.hamiltonian.refresh_force(&mut self.point);
        self.refresh_momentum();
        let energy = self.point.energy();
        let time = time * (0.5 + self.flow.rng.random::<f64>());
        let most = Self::MOST_STEPS.min(2u32.pow(self.max_depth));
        let n = (time / step_size).round().clamp(1.0, f64::from(most));
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
        // none where the first step cannot be made
        let depth = n_leapfrog.checked_ilog2().unwrap_or(0);
        // the step size is tuned to steps that are whole
        let accept = accept.min((-roughest).exp());
        Transition { accept, energy: drawn, depth, n_leapfrog, diverging }
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

#[cfg(test)]
#[path = "kernel_tests.rs"]
mod tests;
