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

/// Is told, from any thread, how far a search is. If it returns `Break`, the search stops.
pub type Watch<'w> = dyn Fn(SearchProgress) -> ControlFlow<()> + Sync + 'w;
