//! What a run of several blocked chains needs: the state of each chain, and their meetings.

use super::chain::{Blocked, Fixed};
use super::explore::Exploring;
use super::meeting::{Lesson, Link, Shared, agree};
use super::scouts::scouts;
use crate::infer::error::{ChainError, ChainFailure};
use crate::infer::kernel_state::KernelState;
use crate::infer::markov::{MarkovChain as _, Together};
use crate::infer::settings::MetricKind;
use crate::infer::stages::WarmUp;
use crate::infer::warmup::Adaptation;
use crate::random::Part;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Everything that the rest of a chain depends on, except what is computed again from the outer
/// unknowns.
#[derive(Debug, Serialize, Deserialize)]
pub(in crate::infer) struct BlockedState {
    shared: Shared,
    warm_up: WarmUp,
    outer: Vec<f64>,
    kernel: KernelState,
    /// How many words were drawn from the random stream of the hyperparameters.
    word: u128,
    ln_length: f64,
    learning: Option<(Adaptation, Lesson)>,
    step_size: f64,
    n_evaluations: u64,
    n_trials: u64,
}

impl Together for Blocked<'_> {
    type State = BlockedState;

    fn state(&self) -> BlockedState {
        let conditional = self.kernel.evaluator();
        BlockedState {
            shared: (*self.shared).clone(),
            warm_up: self.warm_up.clone(),
            outer: conditional.outer.clone(),
            kernel: self.kernel.state(),
            word: self.rng.get_word_pos(),
            ln_length: self.ln_length,
            learning: self.learning.clone(),
            step_size: self.step_size,
            n_evaluations: self.n_evaluations,
            n_trials: conditional.n_trials,
        }
    }

    fn dim(&self) -> usize {
        self.position.len()
    }

    fn fits(&self, state: &BlockedState, n_draws: usize) -> bool {
        let (warm_up, layout) = (&state.warm_up, self.fixed.density.layout());
        let dim = self.kernel.point.position.len();
        let is_lesson = |(adaptation, lesson): &(Adaptation, Lesson)| {
            adaptation.fits(dim, MetricKind::Diagonal) && lesson.fits(warm_up.n_late(), layout)
        };
        warm_up.follows(&self.warm_up)
            && state.shared.is_like(&self.shared, layout)
            && state.outer.len() == layout.outer.len()
            && state.kernel.fits(dim)
            && state.learning.is_none() == warm_up.is_over()
            && state.learning.as_ref().is_none_or(is_lesson)
            && (n_draws == 0 || warm_up.is_over())
    }

    fn restore(&mut self, state: BlockedState) -> Result<(), ChainError> {
        let fixed = self.fixed;
        let shared = state.shared.ready(fixed.density, fixed.seed).map(Arc::new);
        let with = shared.and_then(|s| Some((fixed.conditional(&s, &state.outer)?, s)));
        let Some((conditional, shared)) = with else {
            return Err(self.error(state.warm_up.n_done(), ChainFailure::RanAway));
        };
        let position = state.kernel.position.clone();
        // the metric and all of the point are in the kernel's state
        let scale = vec![1.0; position.len()];
        self.kernel =
            fixed.kernel(conditional, &scale, &position, fixed.stream(Part::Inner, &state.warm_up));
        self.kernel.restore(state.kernel);
        self.kernel.parts().0.n_trials = state.n_trials;
        self.rng = fixed.stream(Part::Hyper, &state.warm_up);
        self.rng.set_word_pos(state.word);
        self.shared = shared;
        self.warm_up = state.warm_up;
        self.ln_length = state.ln_length;
        self.learning = state.learning;
        self.step_size = state.step_size;
        self.n_evaluations = state.n_evaluations;
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

    fn meet(mut chains: Vec<&mut Self>) -> Vec<Result<(), ChainError>> {
        let mut links: Vec<Link> = chains.iter_mut().map(|chain| chain.link()).collect();
        let lessons = chains.iter_mut().filter_map(|chain| chain.learning.take());
        let lessons = lessons.map(|(_, lesson)| lesson).collect();
        let Some(first) = chains.first() else { return vec![] };
        let mut warm_up = first.warm_up.clone();
        warm_up.met();
        agree(&mut links);
        let Self { fixed, shared, .. } = &**first;
        let scouts = scouts(*fixed, shared, &links, (&first.warm_up, &warm_up));
        let Fixed { density, knows_hyper, seed, .. } = *fixed;
        let last = warm_up.is_over().then_some(Exploring { knows_hyper, seed });
        let shared = shared.fitted(density, lessons, scouts, last);
        let shared = Arc::new(shared);
        let begin = |(chain, link): (&mut Self, Link)| {
            *chain = Self::begin(chain.fixed, &shared, warm_up.clone(), &link)?;
            Ok(())
        };
        chains.into_iter().zip(links).map(begin).collect()
    }

    fn error(&self, iteration: usize, failure: ChainFailure) -> ChainError {
        self.fixed.error(self.phase(), iteration, self.kernel.point.position.clone(), failure)
    }
}
