//! A chain that is moved on one step at a time.

use super::draws::{Draw, Transition};
use super::error::{ChainError, ChainFailure};
use super::progress::Phase;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// A Markov chain on a density, with a warm-up in which it learns how to move.
pub trait MarkovChain {
    /// One transition of the warm-up; `None` once that is over.
    ///
    /// # Errors
    /// [`ChainFailure::RanAway`], [`ChainFailure::NoStepSize`].
    fn adapt(&mut self) -> Result<Option<Transition>, ChainError>;

    /// The next draw. If the warm-up is not over, it is finished first.
    ///
    /// # Errors
    /// Those of [`MarkovChain::adapt`].
    fn draw(&mut self) -> Result<Draw<'_>, ChainError>;

    /// Whether the chain is in its warm-up.
    fn phase(&self) -> Phase;

    /// Present step size.
    fn step_size(&self) -> f64;

    /// Evaluations of the density in the warm-up, and since.
    fn n_evaluations(&self) -> [u64; 2];
}

/// What a run of several chains also needs: to save each chain, and to let the chains learn from
/// each other.
pub(super) trait Together: MarkovChain + Send {
    /// Everything that the rest of a chain depends on.
    type State: Serialize + DeserializeOwned + Send;

    fn state(&self) -> Self::State;

    /// Unknowns of the density.
    fn dim(&self) -> usize;

    /// Whether a chain of this run can have been in `state` after so many draws. What
    /// [`Together::restore`] relies on is checked here, since a file can hold anything.
    fn fits(&self, state: &Self::State, n_draws: usize) -> bool;

    /// Goes on from `state`, which fits, as if the chain had not been interrupted.
    fn restore(&mut self, state: Self::State) -> Result<(), ChainError>;

    /// Transitions of the warm-up so far.
    fn n_adapted(&self) -> usize;

    /// How often the chains have met.
    fn n_meetings(&self) -> usize {
        0
    }

    /// Whether this chain waits for the others of its run.
    fn must_meet(&self) -> bool {
        false
    }

    /// Fits what the chains share to what all of them have seen. After this they go on.
    fn meet(chains: Vec<&mut Self>) -> Vec<Result<(), ChainError>> {
        chains.iter().map(|_| Ok(())).collect()
    }

    /// The error that reports this failure, at the present iteration and phase.
    fn error(&self, iteration: usize, failure: ChainFailure) -> ChainError;
}
