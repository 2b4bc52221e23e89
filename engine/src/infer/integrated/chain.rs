//! One chain of the integrated sampler.

use super::marginal::{At, MadeAt, Marginal};
use crate::infer::blocked::{LatentGaussian, Proposal};
use crate::infer::curvature::conditional_scales;
use crate::infer::draws::{Draw, Transition};
use crate::infer::error::{ChainError, ChainFailure, InferError};
use crate::infer::markov::{MarkovChain, Together};
use crate::infer::progress::Phase;
use crate::infer::settings::{Settings, check_starts};
use crate::infer::stages::{Stage, WarmUp};
use crate::random::{Part, Stream};
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Transitions of the warm-up that are worth their time, where the settings ask for more: there is no metric to learn.
const MOST_WARMUP: usize = 200;

/// Least variance of an unknown in the proposal: with thousands of measurements a noise is known to a thousandth.
const FLOOR: f64 = 1e-8;

/// A chain of the integrated sampler. Alone it learns from its own draws; with others, from those of all.
pub struct Integrated<'d> {
    fixed: Fixed,
    marginal: Marginal<'d>,
    proposal: Proposal,
    warm_up: WarmUp,
    rng: ChaCha8Rng,
    outer: Vec<f64>,
    at: At,
    /// ln of the length of random-walk steps.
    ln_length: f64,
    /// Outer unknowns of this round of the warm-up.
    lesson: Vec<Vec<f64>>,
    /// Draws since the warm-up.
    n_draws: usize,
    /// Metropolis steps in the warm-up, and since.
    n_steps: [u64; 2],
    position: Vec<f64>,
}

#[derive(Clone, Copy)]
struct Fixed {
    chain: usize,
    seed: u64,
}

/// All that the rest of a chain depends on.
#[derive(Debug, Serialize, Deserialize)]
pub(in crate::infer) struct IntegratedState {
    proposal: Proposal,
    warm_up: WarmUp,
    outer: Vec<f64>,
    /// Words drawn from the random stream.
    word: u128,
    ln_length: f64,
    lesson: Vec<Vec<f64>>,
    n_draws: usize,
    n_steps: [u64; 2],
    /// The products that `outer` was asked with, and those that are known.
    made_at: [MadeAt; 2],
}

impl<'d> Integrated<'d> {
    /// A chain from `start`, `(dim)`. Of the settings, `chains`, `draws`, `threads`, `metric`, `max_depth` and
    /// `target_accept` do not matter.
    ///
    /// # Errors
    /// Those of [`sample_integrated`](super::sample_integrated); [`InferError::Chain`] where the chain cannot begin.
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
        let layout = density.layout();
        let scales = conditional_scales(&mut *density.evaluator(), &starts[0], 1.0);
        let scales: Vec<f64> = layout.outer_of(&scales).iter().map(|s| s.min(1.0)).collect();
        let proposal = Proposal::new(&scales);
        let warm_up = WarmUp::new(Stage::integrated(settings.warmup.min(MOST_WARMUP)));
        let mut first = Marginal::new(density.latent(), layout);
        first.at(&layout.outer_of(&starts[0]));
        let begin = |(chain, start): (usize, &Vec<f64>)| {
            let fixed = Fixed { chain, seed: settings.seed };
            let mut marginal = Marginal::new(density.latent(), layout);
            marginal.share(&first);
            let outer = layout.outer_of(start);
            let at = marginal.at(&outer).ok_or_else(|| {
                fixed.error(Phase::Warmup, 0, start.clone(), ChainFailure::NoSupport)
            })?;
            Ok(Self {
                rng: fixed.stream(&warm_up),
                fixed,
                marginal,
                proposal: proposal.clone(),
                warm_up: warm_up.clone(),
                outer,
                at,
                ln_length: 0.0,
                lesson: vec![],
                n_draws: 0,
                n_steps: [0; 2],
                position: vec![0.0; density.dim()],
            })
        };
        starts.iter().enumerate().map(begin).collect()
    }

    /// Metropolis steps of these numbers ([`Proposal::draw`]); their mean acceptance, and that of random-walk steps alone.
    fn steps(&mut self, numbers: &[usize]) -> [f64; 2] {
        let (mut all, mut walked, mut n_walks) = (0.0, 0.0, 0.0);
        let mut proposed = vec![0.0; self.outer.len()];
        self.n_steps[usize::from(self.warm_up.is_over())] += numbers.len() as u64;
        for k in numbers.iter().copied() {
            let length = self.ln_length.exp();
            let ln_ratio = self.proposal.draw(k, length, &self.outer, &mut self.rng, &mut proposed);
            let uniform: f64 = self.rng.random();
            let mut accept = 0.0;
            if let Some(at) = self.marginal.at(&proposed) {
                accept = (at.ln_density - self.at.ln_density + ln_ratio).exp().min(1.0);
                if uniform < accept {
                    self.at = at;
                    self.outer.copy_from_slice(&proposed);
                }
            }
            all += accept / numbers.len() as f64;
            if self.proposal.is_walk(k) {
                walked += accept;
                n_walks += 1.0;
            }
        }
        let walked = if n_walks > 0.0 { walked / n_walks } else { Proposal::TARGET };
        [all, walked]
    }
}

impl MarkovChain for Integrated<'_> {
    /// In the last two thirds of each round draws are taken to learn from.
    fn adapt(&mut self) -> Result<Option<Transition>, ChainError> {
        if self.must_meet() {
            Self::meet(vec![self]).into_iter().collect::<Result<(), _>>()?;
        }
        if self.warm_up.is_over() {
            return Ok(None);
        }
        let numbers: Vec<usize> = (0..self.outer.len().max(2)).collect();
        let [accept, walked] = self.steps(&numbers);
        let iteration = self.warm_up.done();
        self.ln_length += (walked - Proposal::TARGET) / (1.0 + iteration as f64).powf(0.6);
        if self.warm_up.is_late() {
            self.lesson.push(self.outer.clone());
        }
        self.warm_up.advance();
        Ok(Some(Transition { accept, ..Transition::NONE }))
    }

    fn draw(&mut self) -> Result<Draw<'_>, ChainError> {
        while self.adapt()?.is_some() {}
        // one unknown given the others, now and then a random walk; then all of them anew
        let first = if self.n_draws % 4 == 3 { 1 } else { 2 * self.n_draws };
        self.n_draws += 1;
        let [accept, _] = self.steps(&[first, 3]);
        let ln_density =
            self.marginal.draw(&self.outer, &self.at, &mut self.rng, &mut self.position);
        let transition = Transition { accept, energy: -ln_density, ..Transition::NONE };
        Ok(Draw { position: &self.position, ln_density, transition, divergence: None })
    }

    fn phase(&self) -> Phase {
        if self.warm_up.is_over() { Phase::Sampling } else { Phase::Warmup }
    }

    fn step_size(&self) -> f64 {
        self.ln_length.exp()
    }

    /// There is none: ones.
    fn n_evaluations(&self) -> [u64; 2] {
        self.n_steps
    }
}

impl Together for Integrated<'_> {
    type State = IntegratedState;

    fn state(&self) -> IntegratedState {
        IntegratedState {
            proposal: self.proposal.clone(),
            warm_up: self.warm_up.clone(),
            outer: self.outer.clone(),
            word: self.rng.get_word_pos(),
            ln_length: self.ln_length,
            lesson: self.lesson.clone(),
            n_draws: self.n_draws,
            n_steps: self.n_steps,
            made_at: [&self.at.products, self.marginal.made_at()].map(Clone::clone),
        }
    }

    fn dim(&self) -> usize {
        self.position.len()
    }

    fn fits(&self, state: &IntegratedState, n_draws: usize) -> bool {
        let n_outer = self.outer.len();
        let is_place = |outer: &Option<Vec<f64>>| outer.as_ref().is_none_or(|o| o.len() == n_outer);
        let is_like = |made_at: &MadeAt| {
            made_at.len() == self.at.products.len() && made_at.iter().all(is_place)
        };
        state.warm_up.follows(&self.warm_up)
            && state.proposal.is_like(&self.proposal)
            && state.outer.len() == n_outer
            && state.lesson.len() == state.warm_up.n_late()
            && state.lesson.iter().all(|outer| outer.len() == n_outer)
            && state.made_at.iter().all(is_like)
            && state.n_draws == n_draws
            && (n_draws == 0 || state.warm_up.is_over())
    }

    fn restore(&mut self, state: IntegratedState) -> Result<(), ChainError> {
        let [of_outer, known] = &state.made_at;
        let at = self.marginal.remake(of_outer).and_then(|()| self.marginal.at(&state.outer));
        let Some(at) = at.filter(|_| self.marginal.remake(known).is_some()) else {
            return Err(self.error(state.warm_up.n_done(), ChainFailure::RanAway));
        };
        self.rng = self.fixed.stream(&state.warm_up);
        self.rng.set_word_pos(state.word);
        self.at = at;
        self.proposal = state.proposal;
        self.warm_up = state.warm_up;
        self.outer = state.outer;
        self.ln_length = state.ln_length;
        self.lesson = state.lesson;
        self.n_draws = state.n_draws;
        self.n_steps = state.n_steps;
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

    fn meet(chains: Vec<&mut Self>) -> Vec<Result<(), ChainError>> {
        let Some(first) = chains.first() else { return vec![] };
        let mut proposal = first.proposal.clone();
        let draws: Vec<Vec<f64>> =
            chains.iter().flat_map(|chain| chain.lesson.iter().cloned()).collect();
        proposal.fit(&draws, FLOOR);
        let n = chains.len() as f64;
        let ln_length = chains.iter().map(|chain| chain.ln_length).sum::<f64>() / n;
        let begin = |chain: &mut Self| {
            chain.proposal = proposal.clone();
            chain.ln_length = ln_length;
            chain.lesson.clear();
            chain.warm_up.met();
            chain.rng = chain.fixed.stream(&chain.warm_up);
            Ok(())
        };
        chains.into_iter().map(begin).collect()
    }

    fn error(&self, iteration: usize, failure: ChainFailure) -> ChainError {
        self.fixed.error(self.phase(), iteration, self.outer.clone(), failure)
    }
}

impl Fixed {
    /// Each round has a stream of its own.
    fn stream(self, warm_up: &WarmUp) -> ChaCha8Rng {
        let (round, chain) = (warm_up.n_meetings(), self.chain);
        Stream::Blocked { part: Part::Hyper, round, chain }.rng(self.seed)
    }

    fn error(
        self,
        phase: Phase,
        iteration: usize,
        position: Vec<f64>,
        failure: ChainFailure,
    ) -> ChainError {
        ChainError { chain: self.chain, seed: self.seed, phase, iteration, position, failure }
    }
}

impl std::fmt::Debug for Integrated<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Integrated").field("state", &self.state()).finish_non_exhaustive()
    }
}
