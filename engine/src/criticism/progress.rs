//! How far a search is, and how it is stopped.

use std::ops::ControlFlow;

/// How far a search is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SearchProgress {
    /// Number of the round, from 0.
    pub round: usize,
    /// Searches on simulated data that are done in it.
    pub done: usize,
    /// Of how many.
    pub of: usize,
}

/// What searches on simulated data came to, in an earlier, interrupted search for the same. Asked and told from any
/// thread.
pub trait Remembered: Sync {
    /// The best log Bayes factor of a search of a round, if it is known.
    fn recall(&self, round: usize, search: usize) -> Option<f64>;
    /// It is known now.
    fn keep(&self, round: usize, search: usize, best: f64);
}

/// Nothing is remembered.
impl Remembered for () {
    fn recall(&self, _: usize, _: usize) -> Option<f64> {
        None
    }
    fn keep(&self, _: usize, _: usize, _: f64) {}
}

/// Is told, from any thread, how far a search is. If it returns `Break`, the search stops.
pub type Watch<'w> = dyn Fn(SearchProgress) -> ControlFlow<()> + Sync + 'w;
