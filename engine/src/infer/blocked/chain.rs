//! One chain of the blocked sampler.

use super::conditional::Conditional;
use super::explore::Leaps;
use super::latent::LatentGaussian;
use super::meeting::{Lesson, Link, Shared, first_link};
use super::proposal::Proposal;
use crate::infer::draws::{Draw, Transition};
use crate::infer::error::{ChainError, ChainFailure, InferError};
use crate::infer::hamiltonian::{Hamiltonian, Metric};
use crate::infer::kernel::{Kernel, QUARTER_PERIOD};
use crate::infer::markov::{MarkovChain, Together};
use crate::infer::moments::DrawMoments;
use crate::infer::progress::Phase;
use crate::infer::settings::{MetricKind, Settings, check_starts};
use crate::infer::stages::{Stage, WarmUp};
use crate::infer::warmup::Adaptation;
use crate::random::{Part, Stream};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// After each trajectory there are this many steps of the hyperparameters for each of them. The
/// more there are, the shorter they are.
const STEPS_EACH: usize = 2;
/// How often both moves are made between two kept draws. Hyperparameters move by slow random steps,
/// and a sweep costs less than a kept draw.
const SWEEPS: usize = 3;
/// Proposals of all unknowns together between two kept draws.
const LEAPS: usize = 2;

/// What does not change in a chain.
#[derive(Clone, Copy)]
pub(super) struct Fixed<'d> {
    pub(super) density: &'d dyn LatentGaussian,
    chain: usize,
    pub(super) seed: u64,
    /// Whether draws of an earlier run have told where the hyperparameters are.
    pub(super) knows_hyper: bool,
    max_depth: u32,
    target_accept: f64,
}

/// A chain of the blocked sampler. A single chain learns from its own draws, a chain of a run from
/// the draws of all chains.
pub struct Blocked<'d> {
    pub(super) fixed: Fixed<'d>,
    pub(super) shared: Arc<Shared>,
    pub(super) warm_up: WarmUp,
    pub(super) kernel: Kernel<Conditional<'d>>,
    /// Random numbers for moves of the hyperparameters, and for what a draw does not determine.
    pub(super) rng: ChaCha8Rng,
    /// ln of the length of the hyperparameters' steps.
    pub(super) ln_length: f64,
    /// What the chain learns in this round of the warm-up; `None` once the warm-up is over.
    pub(super) learning: Option<(Adaptation, Lesson)>,
    pub(super) step_size: f64,
    /// Evaluations of the likelihood in earlier rounds.
    pub(super) n_evaluations: u64,
    pub(super) hyper: [Vec<f64>; 2],
    pub(super) position: Vec<f64>,
}

impl<'d> Blocked<'d> {
    /// Mean acceptance that the step size is tuned to where none is asked for.
    pub const TARGET_ACCEPT: f64 = 0.95;

    /// A chain from `start`, `(dim)`. The settings `chains`, `draws`, `threads` and `metric` are
    /// not used.
    ///
    /// # Errors
    /// Those of [`sample_blocked`](super::sample_blocked); [`InferError::Chain`] where the chain cannot
    /// begin.
    pub fn new(
        density: &'d dyn LatentGaussian,
        start: &[f64],
        settings: &Settings,
    ) -> Result<Self, InferError> {
        let (starts, settings) = ([start.to_vec()], Settings { chains: 1, ..settings.clone() });
        check_starts(density, &starts, &settings)?;
        let mut chains = Self::together(density, &starts, &settings);
        Ok(chains.swap_remove(0)?)
    }

    /// The chains of a run.
    pub(super) fn together(
        density: &'d dyn LatentGaussian,
        starts: &[Vec<f64>],
        settings: &Settings,
    ) -> Vec<Result<Self, ChainError>> {
        let links: Vec<Link> = starts.iter().map(|start| first_link(density, start)).collect();
        let shared = Arc::new(Shared::first(density, starts, &links, settings));
        let knows_hyper = Shared::knows_hyper(density, settings);
        let mut warm_up = WarmUp::new(Stage::blocked(settings.warmup, knows_hyper));
        if knows_hyper {
            warm_up.met();
        }
        let Settings { seed, max_depth, .. } = *settings;
        let target_accept = settings.target_accept.unwrap_or(Self::TARGET_ACCEPT);
        let begin = |(chain, link): (usize, Link)| {
            let fixed = Fixed { density, chain, seed, knows_hyper, max_depth, target_accept };
            Self::begin(fixed, &shared, warm_up.clone(), &link)
        };
        links.into_iter().enumerate().map(begin).collect()
    }

    /// Takes up `link` at the beginning of a round.
    pub(super) fn begin(
        fixed: Fixed<'d>,
        shared: &Arc<Shared>,
        warm_up: WarmUp,
        link: &Link,
    ) -> Result<Self, ChainError> {
        let no_support = || {
            let position = [&link.outer[..], &link.coefficients].concat();
            let is_start = warm_up.n_done() == 0;
            let failure = if is_start { ChainFailure::NoSupport } else { ChainFailure::RanAway };
            fixed.error(Phase::Warmup, warm_up.n_done(), position, failure)
        };
        let conditional = fixed.conditional(shared, &link.outer).ok_or_else(no_support)?;
        let position = conditional.position(&link.coefficients);
        let mut kernel =
            fixed.kernel(conditional, &link.scale, &position, fixed.stream(Part::Inner, &warm_up));
        if !kernel.is_usable() {
            return Err(no_support());
        }
        let learning = if warm_up.is_over() {
            None
        } else {
            // whitened coordinates: scales are near 1 before anything is learnt
            let nothing = DrawMoments::new(position.len(), MetricKind::Diagonal);
            let target = fixed.target_accept;
            let learns = Adaptation::begin(&mut kernel, MetricKind::Diagonal, target, &nothing);
            let failure = ChainFailure::NoStepSize;
            let fails = || fixed.error(Phase::Warmup, warm_up.n_done(), position, failure);
            Some((learns.ok_or_else(fails)?, Lesson::default()))
        };
        let layout = fixed.density.layout();
        Ok(Self {
            rng: fixed.stream(Part::Hyper, &warm_up),
            fixed,
            shared: Arc::clone(shared),
            kernel,
            ln_length: link.ln_length,
            step_size: learning.as_ref().map_or(link.step_size, |(learns, _)| learns.step_size()),
            learning,
            warm_up,
            n_evaluations: link.n_evaluations,
            hyper: [vec![0.0; layout.hyper.len()], vec![0.0; layout.hyper.len()]],
            position: vec![0.0; fixed.density.dim()],
        })
    }

    /// What the next round begins with.
    pub(super) fn link(&mut self) -> Link {
        let step_size = self.learning.as_ref().map(|(learns, _)| learns.final_step_size());
        let scale = self.kernel.metric().scale.clone();
        let n_evaluations = self.n_evaluations + self.n_in_round();
        let (conditional, point) = self.kernel.parts();
        Link {
            coefficients: conditional.coefficients(&point.position).to_vec(),
            outer: conditional.outer.clone(),
            scale,
            step_size: step_size.unwrap_or(self.step_size),
            ln_length: self.ln_length,
            n_evaluations,
        }
    }

    /// Evaluations in this round.
    fn n_in_round(&self) -> u64 {
        self.kernel.n_evaluations() + self.kernel.evaluator().n_trials
    }

    /// Makes both moves several times: what lies between two kept draws. The transition that is
    /// returned is the last one, but with the leapfrog steps of all, and it counts as diverging if
    /// any of them diverged.
    fn sweeps(&mut self) -> (Transition, Option<[Vec<f64>; 2]>) {
        let (mut n_leapfrog, mut divergence) = (0, None);
        let mut last = None;
        self.leap();
        for _ in 0..SWEEPS {
            let start = self.kernel.point.position.clone();
            let transition = self.move_inner();
            if transition.diverging && divergence.is_none() {
                let end = self.kernel.divergent_position().to_vec();
                divergence = Some([start, end].map(|inner| {
                    self.complete(&inner);
                    self.position.clone()
                }));
            }
            n_leapfrog += transition.n_leapfrog;
            self.move_hyper();
            self.swap();
            last = Some(transition);
        }
        let diverging = divergence.is_some();
        let last = last.unwrap_or(Transition::NONE);
        (Transition { n_leapfrog, diverging, ..last }, divergence)
    }

    /// Writes the position in the density's own unknowns for an inner one, and returns the log
    /// density there.
    fn complete(&mut self, inner: &[f64]) -> f64 {
        self.kernel.parts().0.join(inner, &mut self.rng, &mut self.position)
    }

    /// Moves the inner unknowns. Where these are nearly standard normal, a quarter of a period makes a
    /// fresh draw. NUTS would need twice as long, to see a U-turn.
    fn move_inner(&mut self) -> Transition {
        if self.kernel.evaluator().is_nearly_normal() {
            self.kernel.static_transition(self.step_size, QUARTER_PERIOD)
        } else {
            self.kernel.transition(self.step_size)
        }
    }

    /// A few proposals of all unknowns together, where they are prepared.
    fn leap(&mut self) {
        let Some(Leaps { mixture, anchors, .. }) = &self.shared.leaps else { return };
        let layout = self.fixed.density.layout();
        let (conditional, point) = self.kernel.parts();
        conditional.take(&point.position);
        let Some(guide) = anchors.at(&conditional.outer, layout) else { return };
        let mut estimate = conditional.estimate(&point.position, &guide, &mut self.rng);
        let mut proposed = vec![0.0; conditional.outer.len()];
        let mut moved = false;
        for _ in 0..LEAPS {
            mixture.draw(&mut self.rng, &mut proposed);
            let Some(guide) = anchors.at(&proposed, layout) else { continue };
            let ln_ratio = mixture.ln_density(&conditional.outer) - mixture.ln_density(&proposed);
            let state = (&mut point.position[..], &mut estimate);
            moved |= conditional.leap((&proposed, &guide), ln_ratio, state, &mut self.rng);
        }
        conditional.settle(moved);
        if moved {
            self.kernel.evaluate();
        }
    }

    /// A step of a region from one regime to another, where there are any.
    fn swap(&mut self) {
        let swaps = &self.shared.swaps;
        if swaps.is_empty() {
            return;
        }
        let (conditional, point) = self.kernel.parts();
        conditional.take(&point.position);
        conditional.settle(false);
        let swap = &swaps[self.rng.random_range(0..swaps.len())];
        if conditional.swap(swap, &mut point.position, &mut self.rng) {
            self.kernel.evaluate();
        }
    }

    /// A few Metropolis steps of the hyperparameters; their mean acceptance.
    fn move_hyper(&mut self) -> f64 {
        let (conditional, point) = self.kernel.parts();
        conditional.take(&point.position);
        if !conditional.has_hyper() {
            return Proposal::TARGET;
        }
        let [present, proposed] = &mut self.hyper;
        let proposal = &self.shared.proposal;
        let (mut walked, mut n_walks, mut moved) = (0.0, 0.0, false);
        let mut ln_density = point.ln_density;
        let length = self.ln_length.exp();
        for k in 0..STEPS_EACH * present.len() {
            conditional.hyper(present);
            let ln_ratio = proposal.draw(k, length, present, &mut self.rng, proposed);
            let uniform: f64 = self.rng.random();
            let accept = conditional.move_hyper(
                &point.position,
                proposed,
                ln_ratio,
                uniform,
                &mut ln_density,
            );
            moved |= uniform < accept;
            if proposal.is_walk(k) {
                walked += accept;
                n_walks += 1.0;
            }
        }
        conditional.settle(moved);
        if moved {
            self.kernel.evaluate();
        }
        walked / n_walks
    }
}

impl<'d> Fixed<'d> {
    pub(super) fn conditional(
        self,
        shared: &Arc<Shared>,
        outer: &[f64],
    ) -> Option<Conditional<'d>> {
        Conditional::new(self.density.latent(), self.density.layout(), Arc::clone(shared), outer)
    }

    pub(super) fn kernel(
        self,
        conditional: Conditional<'d>,
        scale: &[f64],
        position: &[f64],
        rng: ChaCha8Rng,
    ) -> Kernel<Conditional<'d>> {
        let hamiltonian = Hamiltonian::new(conditional, Metric::diagonal(scale.to_vec()));
        Kernel::new(hamiltonian, position, self.max_depth, rng)
    }

    /// Each round has streams of its own.
    pub(super) fn stream(self, part: Part, warm_up: &WarmUp) -> ChaCha8Rng {
        let (round, chain) = (warm_up.n_meetings(), self.chain);
        Stream::Blocked { part, round, chain }.rng(self.seed)
    }

    pub(super) fn error(
        self,
        phase: Phase,
        iteration: usize,
        position: Vec<f64>,
        failure: ChainFailure,
    ) -> ChainError {
        ChainError { chain: self.chain, seed: self.seed, phase, iteration, position, failure }
    }
}

impl std::fmt::Debug for Blocked<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Blocked").field("state", &self.state()).finish_non_exhaustive()
    }
}

impl MarkovChain for Blocked<'_> {
    /// The draws in the last two thirds of each round are kept to learn from.
    fn adapt(&mut self) -> Result<Option<Transition>, ChainError> {
        if self.must_meet() {
            Self::meet(vec![self]).into_iter().collect::<Result<(), _>>()?;
        }
        if self.learning.is_none() {
            return Ok(None);
        }
        let transition = self.move_inner();
        let iteration = self.warm_up.done();
        if let Some((adaptation, _)) = &mut self.learning {
            adaptation.update(&self.warm_up, &mut self.kernel, &transition);
            self.step_size = adaptation.step_size();
        }
        let accept = self.move_hyper();
        self.swap();
        self.ln_length += (accept - Proposal::TARGET) / (1.0 + iteration as f64).powf(0.6);
        if let (Some((_, lesson)), true) = (&mut self.learning, self.warm_up.is_late()) {
            let (conditional, point) = self.kernel.parts();
            lesson.samples.push(conditional.sample(&point.position));
            lesson.outer.push(conditional.outer.clone());
        }
        self.warm_up.advance();
        Ok(Some(transition))
    }

    fn draw(&mut self) -> Result<Draw<'_>, ChainError> {
        while self.adapt()?.is_some() {}
        let (transition, divergence) = self.sweeps();
        let ln_density = self.complete(&self.kernel.point.position.clone());
        Ok(Draw { position: &self.position, ln_density, transition, divergence })
    }

    fn phase(&self) -> Phase {
        if self.learning.is_some() { Phase::Warmup } else { Phase::Sampling }
    }

    fn step_size(&self) -> f64 {
        self.step_size
    }

    fn n_evaluations(&self) -> [u64; 2] {
        match self.phase() {
            Phase::Warmup => [self.n_evaluations + self.n_in_round(), 0],
            Phase::Sampling => [self.n_evaluations, self.n_in_round()],
        }
    }
}
