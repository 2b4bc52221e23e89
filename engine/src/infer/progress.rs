//! Who watches a run, and what it is told.

use super::draws::Chain;
use crate::store::Checkpoint;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Warm-up or sampling.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Phase {
    /// Step size and metric adapt; draws are dropped.
    Warmup,
    /// Nothing adapts; draws are kept.
    Sampling,
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Warmup => "warm-up",
            Self::Sampling => "sampling",
        })
    }
}

/// Where one chain stands.
#[derive(Clone, Copy, Debug)]
pub struct ChainProgress {
    /// The chain, from 0.
    pub chain: usize,
    /// Warm-up or sampling.
    pub phase: Phase,
    /// Transitions done, over both phases.
    pub iteration: usize,
    /// Transitions in all.
    pub total: usize,
    /// Divergences in the present phase.
    pub divergences: usize,
    /// Present step size.
    pub step_size: f64,
}

/// Watches a run and may end it.
pub trait Progress: Sync {
    /// Called about four times per second and chain, and at the end of each phase.
    fn report(&self, progress: &ChainProgress);
    /// Asked before every transition; `true` ends the chain with
    /// [`ChainFailure::Stopped`](super::ChainFailure::Stopped).
    fn should_stop(&self) -> bool {
        false
    }
    /// Whether these draws of all chains that came so far are enough; asked if [`enough_after`](super::Settings::enough_after)
    /// says so. It must depend on the draws alone, for a run that is resumed asks again.
    fn is_enough(&self, _: &[&Chain]) -> bool {
        false
    }
    /// Where the run is saved while it samples, and from where it goes on after an interruption.
    fn checkpoint(&self) -> Option<&Checkpoint> {
        None
    }
}

/// Shows nothing and never stops.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn report(&self, _: &ChainProgress) {}
}
