//! One NUTS chain: its warm-up and its draws.

use super::curvature::conditional_scales;
use super::density::{Evaluator, LogDensity};
use super::draws::{Draw, Transition};
use super::error::{ChainError, ChainFailure, InferError};
use super::hamiltonian::{Hamiltonian, Metric};
use super::kernel::{Kernel, KernelState};
use super::markov::{MarkovChain, Together};
use super::moments::DrawMoments;
use super::progress::Phase;
use super::settings::{MetricKind, Settings, check_starts};
use super::stages::{Stage, WarmUp};
use super::warmup::Adaptation;
use crate::random::Stream;
use serde::{Deserialize, Serialize};

/// A chain of the no-U-turn sampler.
pub struct Nuts<'d> {
    kernel: Kernel<Box<dyn Evaluator + 'd>>,
    chain: usize,
    seed: u64,
    warm_up: WarmUp,
    /// What the chain learns in the warm-up; `None` afterwards.
    adaptation: Option<Adaptation>,
    step_size: f64,
    n_evaluations_warmup: u64,
    /// Where the last transition began.
    start: Vec<f64>,
}

/// Everything that the rest of a chain depends on.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct NutsState {
    kernel: KernelState,
    warm_up: WarmUp,
    adaptation: Option<Adaptation>,
    step_size: f64,
    n_evaluations_warmup: u64,
}

impl<'d> Nuts<'d> {
    /// A chain from `start`, `(dim)`. The settings `chains`, `draws` and `threads` are not used.
    ///
    /// # Errors
    /// Those of [`sample`](super::sample); [`InferError::Chain`] where the chain cannot begin.
    pub fn new(
        density: &'d dyn LogDensity,
        start: &[f64],
        settings: &Settings,
    ) -> Result<Self, InferError> {
        let settings = Settings { chains: 1, ..settings.clone() };
        check_starts(density, &[start.to_vec()], &settings)?;
        let dense = settings.metric == MetricKind::Dense;
        let learnt = DrawMoments::of(density, &settings.earlier, dense);
        Ok(Self::begin(density, start, &settings, 0, &learnt)?)
    }

    /// The same chain with these stages of warm-up, instead of those of [`Stage::nuts`].
    #[must_use]
    pub fn with_warm_up(self, stages: Vec<Stage>) -> Self {
        let alone = stages.into_iter().map(|stage| Stage { meets: false, ..stage });
        Self { warm_up: WarmUp::new(alone.collect()), ..self }
    }

    /// Chain number `chain` of a run. `learnt` is what is known of scales beforehand.
    pub(super) fn begin(
        density: &'d dyn LogDensity,
        start: &[f64],
        settings: &Settings,
        chain: usize,
        learnt: &DrawMoments,
    ) -> Result<Self, ChainError> {
        let scale = conditional_scales(&mut *density.evaluator(), start, 1.0);
        let hamiltonian = Hamiltonian::new(density.evaluator(), Metric::Diagonal(scale));
        let rng = Stream::Chain(chain).rng(settings.seed);
        let kernel = Kernel::new(hamiltonian, start, settings.max_depth, rng);
        let Settings { seed, metric, target_accept, .. } = *settings;
        let mut new = Self {
            kernel,
            chain,
            seed,
            warm_up: WarmUp::new(Stage::nuts(settings.warmup, Adaptation::is_enough(learnt))),
            adaptation: None,
            step_size: f64::NAN,
            n_evaluations_warmup: 0,
            start: start.to_vec(),
        };
        if !new.kernel.is_usable() {
            return Err(new.error(0, ChainFailure::NoSupport));
        }
        let adaptation = Adaptation::begin(&mut new.kernel, metric, target_accept, learnt);
        let adaptation = adaptation.ok_or_else(|| new.error(0, ChainFailure::NoStepSize))?;
        new.step_size = adaptation.step_size();
        new.adaptation = Some(adaptation);
        Ok(new)
    }
}

impl std::fmt::Debug for Nuts<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Nuts").field("state", &self.state()).finish_non_exhaustive()
    }
}

impl MarkovChain for Nuts<'_> {
    fn adapt(&mut self) -> Result<Option<Transition>, ChainError> {
        let Some(adaptation) = &mut self.adaptation else { return Ok(None) };
        let transition = self.kernel.transition(adaptation.step_size());
        adaptation.update(&self.warm_up, &mut self.kernel, &transition);
        self.step_size = adaptation.step_size();
        self.warm_up.advance();
        if self.warm_up.is_over() {
            self.step_size = adaptation.final_step_size();
            self.n_evaluations_warmup = self.kernel.n_evaluations();
            self.adaptation = None;
        }
        Ok(Some(transition))
    }

    fn draw(&mut self) -> Result<Draw<'_>, ChainError> {
        while self.adapt()?.is_some() {}
        self.start.copy_from_slice(&self.kernel.point.position);
        let transition = self.kernel.transition(self.step_size);
        let ends = || [self.start.clone(), self.kernel.divergent_position().to_vec()];
        Ok(Draw {
            divergence: transition.diverging.then(ends),
            position: &self.kernel.point.position,
            ln_density: self.kernel.point.ln_density,
            transition,
        })
    }

    fn phase(&self) -> Phase {
        if self.warm_up.is_over() { Phase::Sampling } else { Phase::Warmup }
    }

    fn step_size(&self) -> f64 {
        self.step_size
    }

    fn inv_metric(&self) -> Vec<f64> {
        self.kernel.metric().inverse_mass(self.start.len())
    }

    fn n_evaluations(&self) -> [u64; 2] {
        let all = self.kernel.n_evaluations();
        match self.phase() {
            Phase::Warmup => [all, 0],
            Phase::Sampling => [self.n_evaluations_warmup, all - self.n_evaluations_warmup],
        }
    }
}

impl Together for Nuts<'_> {
    type State = NutsState;

    fn state(&self) -> NutsState {
        NutsState {
            kernel: self.kernel.state(),
            warm_up: self.warm_up.clone(),
            adaptation: self.adaptation.clone(),
            step_size: self.step_size,
            n_evaluations_warmup: self.n_evaluations_warmup,
        }
    }

    fn restore(&mut self, state: NutsState) -> Result<(), ChainError> {
        self.kernel.restore(state.kernel);
        self.warm_up = state.warm_up;
        self.adaptation = state.adaptation;
        self.step_size = state.step_size;
        self.n_evaluations_warmup = state.n_evaluations_warmup;
        Ok(())
    }

    fn n_adapted(&self) -> usize {
        self.warm_up.n_done()
    }

    fn error(&self, iteration: usize, failure: ChainFailure) -> ChainError {
        ChainError {
            chain: self.chain,
            seed: self.seed,
            phase: self.phase(),
            iteration,
            position: self.kernel.point.position.clone(),
            failure,
        }
    }
}
