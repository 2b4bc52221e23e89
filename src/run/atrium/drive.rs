//! A simulation under way: what it goes on from, and how it is stopped.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use super::AtriumError;
use crate::ep::Precision;
use crate::ep::surface::{Simulation, State};
use crate::store::{Checkpoint, CheckpointError, Keeper, take_chain};

/// What whoever started a simulation hears of it, and how they end it.
#[derive(Clone, Copy)]
pub struct Watch<'a> {
    /// Once this is set, the simulation keeps its state and returns.
    pub stop: &'a AtomicBool,
    /// Told what happens, from any thread.
    pub on_event: &'a (dyn Fn(Event<'_>) + Sync),
}

/// The flag of those who never stop.
static NEVER: AtomicBool = AtomicBool::new(false);

impl Default for Watch<'_> {
    /// Hears nothing and never stops it.
    fn default() -> Self {
        Self { stop: &NEVER, on_event: &|_| () }
    }
}

impl std::fmt::Debug for Watch<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Watch").field("stop", self.stop).finish_non_exhaustive()
    }
}

/// What happens during a simulation.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// It goes on from where it was interrupted.
    Resumed {
        /// The checkpoint.
        folder: &'a Path,
        /// Wall time until the interruption, s.
        seconds: f64,
    },
    /// So many ms are simulated, of all draws together.
    Time(f64),
    /// So many pairs of a draw and a site are done, of [`Vulnerability`](super::Vulnerability).
    Pairs {
        /// Pairs that are done.
        done: usize,
        /// Pairs in all, of a task its own.
        of: usize,
    },
    /// The state could not be kept, for this reason; the simulation goes on.
    NotKept(&'a str),
}

/// A state, and which draw of the posterior it belongs to.
pub(super) type Kept<F> = (u32, State<F>);

/// Runs simulations so that they can be interrupted.
#[derive(Clone, Copy)]
pub(super) struct Drive<'a> {
    pub(super) checkpoint: Option<&'a Checkpoint>,
    pub(super) watch: Watch<'a>,
}

/// Where a state is kept, and of which draw.
#[derive(Clone, Copy)]
pub(super) struct Slot {
    pub(super) slot: usize,
    pub(super) draw: u32,
}

impl Drive<'_> {
    /// What was kept in a slot of the checkpoint, once.
    pub(super) fn kept<T: serde::de::DeserializeOwned>(
        &self,
        slot: usize,
    ) -> Result<Option<T>, CheckpointError> {
        self.checkpoint.map_or(Ok(None), |checkpoint| take_chain(checkpoint, slot))
    }

    /// Whether the simulation goes on from what was kept.
    pub(super) fn goes_on(&self) -> bool {
        self.checkpoint.is_some_and(Checkpoint::has_states)
    }

    /// Runs a simulation to its end, from what was `kept` of this draw. `each` is told of every step.
    /// Whether the end was reached: not if somebody stops it.
    pub(super) fn run<F: Precision>(
        &self,
        Slot { slot, draw }: Slot,
        simulation: &mut Simulation<F>,
        kept: Option<Kept<F>>,
        each: &mut (dyn FnMut(&Simulation<F>) -> Result<(), AtriumError> + Send),
    ) -> Result<bool, AtriumError> {
        let kept = kept.filter(|kept| kept.0 == draw);
        if let (Some(checkpoint), Some((_, state))) = (self.checkpoint, kept) {
            simulation.restore(state).map_err(|_| checkpoint.misfit(Some(slot)))?;
        }
        let mut keeper = Keeper::new(self.checkpoint, slot);
        rayon::scope(|_| {
            while !simulation.is_done() {
                let stops = self.watch.stop.load(Ordering::Relaxed);
                if keeper.is_due(stops) {
                    keeper.keep(&(draw, simulation.state()));
                }
                if stops {
                    return Ok(false);
                }
                simulation.step()?;
                each(simulation)?;
            }
            Ok(true)
        })
    }
}
