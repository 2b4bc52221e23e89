//! How far a search is, and how it is stopped.

use std::ops::ControlFlow;

/// How far a search is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SearchProgress {
    /// Number of the round, from 0; none once it is asked whether sites differ by more than was found.
    pub round: Option<usize>,
    /// Simulated data sets that are done in it.
    pub done: usize,
    /// Of how many.
    pub of: usize,
}

/// Is told, from any thread, how far a search is. If it returns `Break`, the search stops.
pub type Watch<'w> = dyn Fn(SearchProgress) -> ControlFlow<()> + Sync + 'w;
