//! When a chain is kept, and what is there of every chain when a run goes on.

use std::time::{Duration, Instant};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{CHAIN, Checkpoint, CheckpointError};
use crate::store::Spool;

/// Keeps one chain now and then: so seldom that keeping costs no more than a hundredth of its time.
#[derive(Debug)]
pub struct Keeper<'a> {
    checkpoint: Option<&'a Checkpoint>,
    name: String,
    due: Instant,
}

impl<'a> Keeper<'a> {
    /// Time between two savings, in units of the time that one takes.
    const COST: u32 = 100;

    /// Of chain number `chain`; keeps nothing without a checkpoint.
    pub fn new(checkpoint: Option<&'a Checkpoint>, chain: usize) -> Self {
        let due = Instant::now() + checkpoint.map_or(Duration::ZERO, |c| c.every);
        Self { checkpoint, name: name_of(chain), due }
    }

    /// Between two transitions: whether it is time to keep the chain, or the chain `stops` here.
    pub fn is_due(&self, stops: bool) -> bool {
        self.checkpoint.is_some() && (stops || Instant::now() >= self.due)
    }

    /// Keeps the chain.
    pub fn keep(&mut self, state: &impl Serialize) {
        self.keep_with(state, None);
    }

    /// Keeps the chain, whose state tells of `draws` that are in a file of their own.
    pub(crate) fn keep_with(&mut self, state: &impl Serialize, draws: Option<&Spool>) {
        let Some(checkpoint) = self.checkpoint else { return };
        let begun = Instant::now();
        checkpoint.keep(&self.name, state, draws);
        self.due = Instant::now() + checkpoint.every.max(Self::COST * begun.elapsed());
    }
}

/// The state of `chain`, if it was kept.
///
/// # Errors
/// [`CheckpointError::Damaged`].
pub fn take_chain<T: DeserializeOwned>(
    checkpoint: &Checkpoint,
    chain: usize,
) -> Result<Option<T>, CheckpointError> {
    checkpoint.take(&name_of(chain))
}

/// The states of all chains, as far as they were kept.
///
/// # Errors
/// [`CheckpointError::Damaged`].
pub(crate) fn take_chains<T: DeserializeOwned>(
    checkpoint: &Checkpoint,
    chains: usize,
) -> Result<Vec<Option<T>>, CheckpointError> {
    (0..chains).map(|chain| take_chain(checkpoint, chain)).collect()
}

pub(super) fn name_of(chain: usize) -> String {
    format!("{CHAIN}{chain}")
}
