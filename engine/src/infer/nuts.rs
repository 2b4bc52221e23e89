//! One NUTS chain: its warm-up and its draws.

use super::curvature::{Curvature, conditional_scales};
use super::density::{Evaluator, LogDensity};
use super::draws::{Draw, Transition};
use super::error::{ChainError, ChainFailure, InferError};
use super::hamiltonian::{Hamiltonian, Metric};
use super::kernel::Kernel;
use super::kernel_state::KernelState;
use super::lesson::Lesson;
use super::markov::{MarkovChain, Together};
use super::moments::DrawMoments;
use super::progress::Phase;
use super::settings::{MetricKind, Settings, check_starts};
use super::stages::{Stage, WarmUp};
use super::warmup::Adaptation;
use crate::random::Stream;
use serde::{Deserialize, Serialize};

/// How many meetings must have been before one can end the learning from Hessians. In a trial that ended it at the second
/// meeting, steps were half as long.
const ENOUGH_HESSIANS: usize = 3;

/// Mean length, in standard deviations, of a trajectory that does not look for a U-turn. A quarter of a period is 1.6; this is
/// longer because the moves of scales after a trajectory cost as much as three of its steps.
const LENGTH: f64 = 2.4;

/// At which meeting, besides the last one, a density is told where chains are: see [`LogDensity::draw_near`].
const NEAR_AFTER: usize = 2;
/// About how many draws it is told, of all chains together.
const NEAR: usize = 12;

/// A chain of the no-U-turn sampler. A single chain learns from its own draws, a chain of a run from
/// the draws of all chains.
pub struct Nuts<'d> {
    density: &'d dyn LogDensity,
    kernel: Kernel<Box<dyn Evaluator + 'd>>,
    chain: usize,
    seed: u64,
    kind: MetricKind,
    target_accept: f64,
    /// Where the metric comes from, if the density knows moves of its own: see [`LogDensity::interwoven`].
    curvature: Option<Curvature>,
    warm_up: WarmUp,
    /// What the chain learns in this round of the warm-up; `None` once the warm-up is over.
    learning: Option<(Adaptation, Lesson)>,
    step_size: f64,
    n_evaluations_warmup: u64,
    /// The draws that the density was told of last, if it changed.
    near: Vec<Vec<f64>>,
    /// Where the last transition began.
    start: Vec<f64>,
}

/// Everything that the rest of a chain depends on.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct NutsState {
    kernel: KernelState,
    curvature: Option<Curvature>,
    warm_up: WarmUp,
    learning: Option<(Adaptation, Lesson)>,
    step_size: f64,
    n_evaluations_warmup: u64,
    near: Vec<Vec<f64>>,
}

impl<'d> Nuts<'d> {
    /// Mean acceptance that the step size is tuned to where none is asked for. It may be this low because
    /// a step that is too long somewhere is halved there.
    pub const TARGET_ACCEPT: f64 = 0.8;

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
        let learnt = DrawMoments::of(density, &settings.earlier, settings.metric);
        Ok(Self::begin(density, start, &settings, 0, &learnt)?)
    }

    /// Chain number `chain` of a run. `learnt` is what is known of scales beforehand.
    pub(super) fn begin(
        density: &'d dyn LogDensity,
        start: &[f64],
        settings: &Settings,
        chain: usize,
        learnt: &DrawMoments,
    ) -> Result<Self, ChainError> {
        let mut evaluator = density.evaluator();
        let start = start.to_vec();
        let curvature =
            density.interwoven().map(|still| Curvature::at(&mut *evaluator, &start, &still));
        let metric = match &curvature {
            Some(curvature) => curvature.metric(&evaluator.multipliers(&start)),
            None => Metric::diagonal(conditional_scales(&mut *evaluator, &start, 1.0)),
        };
        let nothing = DrawMoments::new(start.len(), settings.metric);
        let (stages, learnt) = match curvature {
            Some(_) => (Stage::of_hessian(settings.warmup), &nothing),
            None => (Stage::nuts(settings.warmup, Adaptation::is_enough(learnt)), learnt),
        };
        let hamiltonian = Hamiltonian::new(evaluator, metric);
        let rng = Stream::Chain(chain).rng(settings.seed);
        let kernel = Kernel::new(hamiltonian, &start, settings.max_depth, rng);
        let mut new = Self {
            density,
            kernel,
            chain,
            seed: settings.seed,
            kind: settings.metric,
            target_accept: settings.target_accept.unwrap_or(Self::TARGET_ACCEPT),
            curvature,
            warm_up: WarmUp::new(stages),
            learning: None,
            step_size: f64::NAN,
            n_evaluations_warmup: 0,
            near: vec![],
            start,
        };
        if !new.kernel.is_usable() {
            return Err(new.error(0, ChainFailure::NoSupport));
        }
        new.begin_round(learnt)?;
        Ok(new)
    }

    /// A transition of NUTS. Where the metric is that of the Hessian, all unknowns that move are nearly standard normal in
    /// its units: a trajectory of [`LENGTH`] makes a fresh draw, and NUTS would go on until it sees a U-turn. Then the
    /// scales move, and the metric becomes that of where these led.
    fn transition(&mut self, step_size: f64) -> Transition {
        let Some(curvature) = &self.curvature else { return self.kernel.transition(step_size) };
        let transition = self.kernel.static_transition(step_size, LENGTH);
        self.kernel.move_scales(curvature);
        self.follow();
        transition
    }

    /// Brings the metric to where the chain is.
    fn follow(&mut self) {
        let Some(curvature) = &self.curvature else { return };
        let (evaluator, point) = self.kernel.parts();
        let metric = curvature.metric(&evaluator.multipliers(&point.position));
        self.kernel.hamiltonian().metric = metric;
    }

    /// Tells the density of draws of all chains. Where it changes, the chains go on under it.
    fn draw_near(chains: &mut [&mut Self], lessons: &[Lesson]) {
        let each = NEAR.div_ceil(lessons.len().max(1));
        let draws: Vec<Vec<f64>> =
            lessons.iter().flat_map(|lesson| lesson.positions(each)).collect();
        if chains.first().is_some_and(|first| first.density.draw_near(&draws)) {
            for chain in chains {
                chain.goes_on_near(draws.clone());
                chain.kernel.evaluate();
            }
        }
    }

    /// Forgets what was computed under the density as it was.
    fn goes_on_near(&mut self, draws: Vec<Vec<f64>>) {
        self.near = draws;
        self.kernel.hamiltonian().evaluator = self.density.evaluator();
    }

    fn begin_round(&mut self, learnt: &DrawMoments) -> Result<(), ChainError> {
        let adaptation = Adaptation::begin(&mut self.kernel, self.kind, self.target_accept, learnt);
        let n = self.warm_up.n_done();
        let adaptation = adaptation.ok_or_else(|| self.error(n, ChainFailure::NoStepSize))?;
        self.step_size = adaptation.step_size();
        self.learning = Some((adaptation, Lesson::default()));
        Ok(())
    }
}

impl std::fmt::Debug for Nuts<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Nuts").field("state", &self.state()).finish_non_exhaustive()
    }
}

impl MarkovChain for Nuts<'_> {
    /// The draws in the last two thirds of each round are kept to learn from.
    fn adapt(&mut self) -> Result<Option<Transition>, ChainError> {
        if self.must_meet() {
            Self::meet(vec![self]).into_iter().collect::<Result<(), _>>()?;
        }
        if self.learning.is_none() {
            return Ok(None);
        }
        let transition = self.transition(self.step_size);
        let Some((adaptation, lesson)) = &mut self.learning else { return Ok(None) };
        adaptation.update(&self.warm_up, &mut self.kernel, &transition);
        self.step_size = adaptation.step_size();
        if self.warm_up.is_late() {
            lesson.add(&self.kernel.point, transition.diverging);
        }
        self.warm_up.advance();
        if self.warm_up.is_over() {
            self.step_size = adaptation.final_step_size();
            self.n_evaluations_warmup = self.kernel.n_evaluations();
            self.learning = None;
        }
        Ok(Some(transition))
    }

    fn draw(&mut self) -> Result<Draw<'_>, ChainError> {
        while self.adapt()?.is_some() {}
        self.start.copy_from_slice(&self.kernel.point.position);
        let transition = self.transition(self.step_size);
        let ends = || [self.start.clone(), self.kernel.divergent_position().to_vec()];
        let divergence = transition.diverging.then(ends);
        let (evaluator, point) = self.kernel.parts();
        let ln_density = evaluator.ln_whole(&point.position, point.ln_density);
        Ok(Draw { divergence, position: &point.position, ln_density, transition })
    }

    fn phase(&self) -> Phase {
        if self.warm_up.is_over() { Phase::Sampling } else { Phase::Warmup }
    }

    fn step_size(&self) -> f64 {
        self.step_size
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
            curvature: self.curvature.clone(),
            warm_up: self.warm_up.clone(),
            learning: self.learning.clone(),
            step_size: self.step_size,
            n_evaluations_warmup: self.n_evaluations_warmup,
            near: self.near.clone(),
        }
    }

    fn dim(&self) -> usize {
        self.start.len()
    }

    fn fits(&self, state: &NutsState, n_draws: usize) -> bool {
        let (warm_up, dim) = (&state.warm_up, self.dim());
        let is_lesson = |(adaptation, lesson): &(Adaptation, Lesson)| {
            adaptation.fits(dim, self.kind) && lesson.fits(warm_up.n_late(), dim)
        };
        warm_up.follows(&self.warm_up)
            && state.kernel.fits(dim)
            && state.curvature.is_some() == self.curvature.is_some()
            && state.curvature.as_ref().is_none_or(|curvature| curvature.fits(dim))
            && state.learning.is_none() == warm_up.is_over()
            && state.learning.as_ref().is_none_or(is_lesson)
            && state.n_evaluations_warmup <= state.kernel.n_evaluations
            && state.near.iter().all(|draw| draw.len() == dim)
            && (n_draws == 0 || warm_up.is_over())
    }

    fn restore(&mut self, state: NutsState) -> Result<(), ChainError> {
        if !state.near.is_empty() {
            // the first chain tells it for all
            self.density.draw_near(&state.near);
            self.goes_on_near(state.near);
        }
        self.kernel.restore(state.kernel);
        self.curvature = state.curvature;
        self.warm_up = state.warm_up;
        self.learning = state.learning;
        self.step_size = state.step_size;
        self.n_evaluations_warmup = state.n_evaluations_warmup;
        Ok(())
    }

    fn n_adapted(&self) -> usize {
        self.warm_up.n_done()
    }

    fn n_meetings(&self) -> usize {
        self.warm_up.n_meetings()
    }

    fn must_meet(&self) -> bool {
        self.warm_up.must_meet()
    }

    /// Fits the metric to the draws of all chains, or takes the mean of the Hessians where the chains are, which then share their
    /// step size, too. Where they agree and none diverged, what is left of the warm-up is its last round.
    fn meet(mut chains: Vec<&mut Self>) -> Vec<Result<(), ChainError>> {
        let learnt = chains.iter_mut().filter_map(|chain| chain.learning.take());
        let (adaptations, lessons): (Vec<Adaptation>, Vec<Lesson>) = learnt.unzip();
        let Some(first) = chains.first_mut() else { return vec![] };
        let n_before = first.warm_up.n_meetings();
        let is_last = first.warm_up.is_last_but_one();
        let mut metric = first.kernel.metric().clone();
        let (kind, mut curvature) = (first.kind, first.curvature.clone());
        match &mut curvature {
            None => Lesson::fit(&lessons, kind, &mut metric),
            Some(curvature) => {
                let mut all = vec![];
                for chain in &mut chains {
                    let (evaluator, point) = chain.kernel.parts();
                    all.push(curvature.again(&mut **evaluator, &point.position));
                }
                curvature.learn(&all);
            }
        }
        let is_enough = match curvature {
            None => n_before > 0 && Lesson::agree(&lessons),
            Some(_) => n_before >= ENOUGH_HESSIANS && Lesson::agree_on_density(&lessons),
        };
        if is_enough || is_last || n_before + 1 == NEAR_AFTER {
            Self::draw_near(&mut chains, &lessons);
        }
        let nothing = DrawMoments::new(metric.scale.len(), kind);
        let together = curvature.as_ref().and_then(|_| Adaptation::together(&adaptations));
        let go_on = |chain: &mut Self| {
            chain.warm_up.met();
            if is_enough {
                chain.warm_up.shorten();
            }
            chain.kernel.hamiltonian().metric = metric.clone();
            chain.curvature.clone_from(&curvature);
            chain.follow();
            let Some(adaptation) = together.clone() else { return chain.begin_round(&nothing) };
            chain.step_size = adaptation.step_size();
            chain.learning = Some((adaptation, Lesson::default()));
            Ok(())
        };
        chains.into_iter().map(go_on).collect()
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
