//! One chain of the blocked sampler: a stage of warm-up, or the draws.

use super::conditional::{Conditional, Inner};
use super::latent::LatentGaussian;
use super::proposal::Proposal;
use super::stand_in::{Sample, StandIn};
use crate::infer::adapt::Warmup;
use crate::infer::hamiltonian::{Hamiltonian, Metric};
use crate::infer::moments::Moments;
use crate::infer::nuts::{Nuts, NutsState, Transition};
use crate::infer::sample::{Reporter, is_usable};
use crate::infer::{
    Chain, ChainError, ChainFailure, ChainResult, Divergence, MetricKind, Phase, Progress, Settings,
};
use crate::random::{Part, Stream};
use crate::store::Keeper;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::rc::Rc;
use std::time::Instant;

/// Steps of the hyperparameters after each trajectory, for each of them: the more there are, the
/// shorter their steps.
const STEPS_EACH: usize = 2;
/// Times both moves are made between two kept draws: hyperparameters are known by slow random steps,
/// and a sweep costs less than keeping a draw is worth.
const SWEEPS: usize = 3;
/// Mean length of a trajectory of the whitened block alone, in units of its standard deviation.
const TIME: f64 = 1.6;

/// What a chain takes from one stage to the next.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Link {
    pub(super) outer: Vec<f64>,
    pub(super) block: Vec<f64>,
    /// Scale of each inner coordinate.
    pub(super) scale: Vec<f64>,
    pub(super) step_size: f64,
    /// ln of the hyperparameter steps' length.
    pub(super) ln_length: f64,
    pub(super) n_grad: u64,
    pub(super) seconds: f64,
}

/// What a stage of warm-up learns from.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Lesson {
    pub(super) samples: Vec<Sample>,
    /// Hyperparameters.
    pub(super) hyper: Vec<Vec<f64>>,
}

/// What a chain is between two transitions of a stage: all that changes there and is not made again
/// from the outer unknowns.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct RunState {
    outer: Vec<f64>,
    nuts: NutsState,
    /// Words drawn from the hyperparameters' random stream.
    word: u128,
    ln_length: f64,
    n_trials: u64,
}

/// How far a chain is in a stage of warm-up: the next iteration, what has been learnt, seconds.
pub(super) type Learning = (usize, Warmup, Lesson, f64);

/// An interrupted chain: its stage and state, in warm-up how far it is, its draws.
pub(super) type Kept = (usize, RunState, Option<Learning>, Chain);

/// What all chains share during a stage; nothing here changes while they run.
#[derive(Clone, Copy)]
pub(super) struct Common<'a> {
    pub(super) density: &'a dyn LatentGaussian,
    pub(super) settings: &'a Settings,
    pub(super) progress: &'a dyn Progress,
    pub(super) stand_in: &'a StandIn,
    pub(super) proposal: &'a Proposal,
    /// The stage, from 0: each has its own random streams.
    pub(super) stage: usize,
    /// Transitions of earlier stages.
    pub(super) before: usize,
}

/// One chain under way within a stage.
pub(super) struct Run<'a> {
    common: Common<'a>,
    chain: usize,
    shared: Rc<RefCell<Conditional<'a>>>,
    nuts: Nuts<'a>,
    /// Of hyperparameter moves and of completing draws.
    rng: ChaCha8Rng,
    ln_length: f64,
    reporter: Reporter<'a>,
    keeper: Keeper<'a>,
    /// Whether the whitened block is all there is to move inside.
    is_standard: bool,
    present: Vec<f64>,
    proposed: Vec<f64>,
}

impl<'a> Run<'a> {
    /// Takes up `link`, or what was kept later in the same stage.
    ///
    /// # Errors
    /// [`ChainFailure::NoSupport`].
    pub(super) fn new(
        common: Common<'a>,
        chain: usize,
        link: &Link,
        kept: Option<RunState>,
    ) -> Result<Self, ChainError> {
        let Common { density, settings, .. } = common;
        let no_support = || {
            let position = [&link.outer[..], &link.block].concat();
            let failure =
                if common.stage == 0 { ChainFailure::NoSupport } else { ChainFailure::RanAway };
            error(common, chain, Phase::Warmup, common.before, position, failure)
        };
        let layout = density.layout();
        let outer = kept.as_ref().map_or(&link.outer, |kept| &kept.outer);
        let conditional = Conditional::new(density.latent(), layout, common.stand_in, outer);
        let conditional = conditional.ok_or_else(no_support)?;
        let position = kept.as_ref().map_or_else(
            || conditional.position(&link.block),
            |kept| kept.nuts.position().to_vec(),
        );
        let shared = Rc::new(RefCell::new(conditional));
        let hamiltonian = Hamiltonian::new(
            Box::new(Inner(Rc::clone(&shared))),
            Metric::Diagonal(link.scale.clone()),
        );
        let stream = |part| Stream::Blocked { part, round: common.stage, chain }.rng(settings.seed);
        let nuts = Nuts::new(hamiltonian, &position, settings.max_depth, stream(Part::Inner));
        if !is_usable(&nuts) {
            return Err(no_support());
        }
        let mut new = Self {
            common,
            chain,
            shared,
            nuts,
            rng: stream(Part::Hyper),
            ln_length: link.ln_length,
            is_standard: layout.free().is_empty(),
            reporter: Reporter::new(chain, settings, common.progress),
            keeper: Keeper::new(common.progress.checkpoint(), chain),
            present: vec![0.0; layout.hyper.len()],
            proposed: vec![0.0; layout.hyper.len()],
        };
        if let Some(kept) = kept {
            new.restore(kept);
        }
        Ok(new)
    }

    /// All but what [`Run::new`] makes of the outer unknowns.
    fn restore(&mut self, kept: RunState) {
        self.nuts.restore(kept.nuts);
        self.rng.set_word_pos(kept.word);
        self.ln_length = kept.ln_length;
        self.shared.borrow_mut().n_trials = kept.n_trials;
    }

    fn state(&self) -> RunState {
        let conditional = self.shared.borrow();
        RunState {
            outer: conditional.outer.clone(),
            nuts: self.nuts.state(),
            word: self.rng.get_word_pos(),
            ln_length: self.ln_length,
            n_trials: conditional.n_trials,
        }
    }

    /// A stage of `n` transitions in which step size, metric and the length of hyperparameter steps
    /// adapt; the last two thirds are learnt from.
    ///
    /// # Errors
    /// [`ChainFailure::NoStepSize`], [`ChainFailure::Stopped`].
    pub(super) fn learn(
        mut self,
        n: usize,
        link: &Link,
        kept: Option<Learning>,
    ) -> Result<(Link, Lesson), ChainError> {
        let (done, mut adapt, mut lesson, before) = match kept {
            Some(kept) => kept,
            None => (0, self.begin_learning(n)?, Lesson::default(), link.seconds),
        };
        let begun = Instant::now();
        let seconds = || before + begun.elapsed().as_secs_f64();
        for iteration in done..n {
            let learning = Some((iteration, &adapt, &lesson, seconds()));
            self.pause(Phase::Warmup, iteration, learning, &Chain::default())?;
            let transition = self.move_inner(adapt.step_size());
            adapt.update(iteration, &mut self.nuts, &transition);
            let accept = self.move_hyper();
            self.ln_length += (accept - Proposal::TARGET) / (1.0 + iteration as f64).powf(0.6);
            if 3 * iteration >= n {
                let mut conditional = self.shared.borrow_mut();
                lesson.samples.push(conditional.sample(&self.nuts.point.position));
                conditional.hyper(&mut self.present);
                lesson.hyper.push(self.present.clone());
            }
            self.report(Phase::Warmup, iteration, &transition, adapt.step_size());
        }
        Ok((self.link(adapt.final_step_size(), link.n_grad, seconds()), lesson))
    }

    fn begin_learning(&mut self, n: usize) -> Result<Warmup, ChainError> {
        let Settings { target_accept, .. } = *self.common.settings;
        // whitened coordinates: scales are near 1 before anything is learnt
        let nothing = Moments::new(self.nuts.point.position.len(), false);
        Warmup::begin(&mut self.nuts, MetricKind::Diagonal, n, target_accept, &nothing)
            .ok_or_else(|| self.error(Phase::Warmup, 0, ChainFailure::NoStepSize))
    }

    fn link(&mut self, step_size: f64, n_grad_before: u64, seconds: f64) -> Link {
        let Metric::Diagonal(scale) = self.nuts.hamiltonian().metric.clone() else {
            unreachable!("the inner metric is diagonal")
        };
        let mut conditional = self.shared.borrow_mut();
        Link {
            block: conditional.block(&self.nuts.point.position).to_vec(),
            outer: conditional.outer.clone(),
            scale,
            step_size,
            ln_length: self.ln_length,
            n_grad: n_grad_before + self.nuts.n_evaluations() + conditional.n_trials,
            seconds,
        }
    }

    /// The draws, after those that `chain` has already.
    ///
    /// # Errors
    /// [`ChainFailure::Stopped`].
    pub(super) fn draw(mut self, link: &Link, mut chain: Chain) -> ChainResult {
        let begun = Instant::now();
        let before = chain.seconds_sampling;
        chain.step_size = link.step_size;
        chain.inv_metric = link.scale.iter().map(|s| s * s).collect();
        chain.n_grad_warmup = link.n_grad;
        chain.seconds_warmup = link.seconds;
        self.reporter.divergences = chain.n_divergences();
        let mut position = vec![0.0; self.common.density.dim()];
        for iteration in chain.n_draws()..self.common.settings.draws {
            self.pause(Phase::Sampling, iteration, None, &chain)?;
            let transition = self.sweeps(iteration, link.step_size, &mut chain);
            let ln_density = self.complete(&self.nuts.point.position.clone(), &mut position);
            chain.record(&position, ln_density, &transition);
            chain.seconds_sampling = before + begun.elapsed().as_secs_f64();
            self.report(Phase::Sampling, iteration, &transition, link.step_size);
        }
        chain.n_grad_sampling = self.nuts.n_evaluations() + self.shared.borrow().n_trials;
        Ok(chain)
    }

    /// What lies between two kept draws: both moves, several times. The transition reported is the
    /// last, diverging if any of them was, with the leapfrog steps of all.
    fn sweeps(&mut self, iteration: usize, step_size: f64, chain: &mut Chain) -> Transition {
        let (mut n_leapfrog, mut diverging) = (0, false);
        for sweep in 1.. {
            let start = self.nuts.point.position.clone();
            let transition = self.move_inner(step_size);
            if transition.diverging && !diverging {
                chain.divergences.push(self.divergence(iteration, &start));
            }
            n_leapfrog += transition.n_leapfrog;
            diverging |= transition.diverging;
            self.move_hyper();
            if sweep == SWEEPS {
                return Transition { n_leapfrog, diverging, ..transition };
            }
        }
        unreachable!("the loop ends at its last sweep")
    }

    /// The density's own position for an inner one.
    fn complete(&mut self, inner: &[f64], position: &mut [f64]) -> f64 {
        self.shared.borrow_mut().join(inner, &mut self.rng, position)
    }

    fn divergence(&mut self, iteration: usize, start: &[f64]) -> Divergence {
        let mut ends = [start.to_vec(), self.nuts.divergent_position().to_vec()].map(|inner| {
            let mut position = vec![0.0; self.common.density.dim()];
            self.complete(&inner, &mut position);
            position
        });
        Divergence {
            iteration,
            start: std::mem::take(&mut ends[0]),
            end: std::mem::take(&mut ends[1]),
        }
    }

    /// The whitened block alone is nearly standard normal: a quarter of a period is a fresh draw, at
    /// half the price of the period that NUTS needs to see a U-turn.
    fn move_inner(&mut self, step_size: f64) -> Transition {
        if self.is_standard {
            self.nuts.static_transition(step_size, TIME)
        } else {
            self.nuts.transition(step_size)
        }
    }

    /// A few Metropolis steps of the hyperparameters; their mean acceptance.
    fn move_hyper(&mut self) -> f64 {
        let mut conditional = self.shared.borrow_mut();
        conditional.take(&self.nuts.point.position);
        if !conditional.has_hyper() {
            return Proposal::TARGET;
        }
        let (mut walked, mut n_walks, mut moved) = (0.0, 0.0, false);
        let mut ln_density = self.nuts.point.ln_density;
        let position = &self.nuts.point.position;
        let length = self.ln_length.exp();
        for k in 0..STEPS_EACH * self.present.len() {
            let proposal = self.common.proposal;
            conditional.hyper(&mut self.present);
            let ln_ratio =
                proposal.draw(k, length, &self.present, &mut self.rng, &mut self.proposed);
            let uniform: f64 = self.rng.random();
            let accept = conditional.move_hyper(
                position,
                &self.proposed,
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
        drop(conditional);
        if moved {
            self.nuts.evaluate();
        }
        walked / n_walks
    }

    fn report(&mut self, phase: Phase, iteration: usize, transition: &Transition, step_size: f64) {
        let iteration =
            if phase == Phase::Warmup { self.common.before + iteration } else { iteration };
        self.reporter.report(phase, iteration, transition, step_size);
    }

    /// Between two transitions: keeps the chain now and then, and stops on request.
    fn pause(
        &mut self,
        phase: Phase,
        iteration: usize,
        learning: Option<(usize, &Warmup, &Lesson, f64)>,
        chain: &Chain,
    ) -> Result<(), ChainError> {
        let stops = self.common.progress.should_stop();
        // written as it is read, as `Kept`
        if self.keeper.is_due(stops) {
            self.keeper.keep(&(self.common.stage, self.state(), learning, chain));
        }
        if stops {
            return Err(self.error(phase, iteration, ChainFailure::Stopped));
        }
        Ok(())
    }

    fn error(&self, phase: Phase, iteration: usize, failure: ChainFailure) -> ChainError {
        let position = self.nuts.point.position.clone();
        let iteration =
            if phase == Phase::Warmup { self.common.before + iteration } else { iteration };
        error(self.common, self.chain, phase, iteration, position, failure)
    }
}

fn error(
    common: Common<'_>,
    chain: usize,
    phase: Phase,
    iteration: usize,
    position: Vec<f64>,
    failure: ChainFailure,
) -> ChainError {
    ChainError { chain, seed: common.settings.seed, phase, iteration, position, failure }
}
