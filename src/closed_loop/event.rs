//! What a loop tells while it goes on, and how it is stopped.

use std::fmt;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::criticism::SearchProgress;
use crate::run;

/// Something that a loop tells. Its `Display` is what the program prints.
#[derive(Debug)]
#[non_exhaustive]
pub enum LoopEvent<'a> {
    /// A search on simulated data is done.
    Search(SearchProgress),
    /// All searches are done.
    Searched,
    /// A model is sampled: the model as written, the one with what sites and measurements differ
    /// by, or the one with what was found too.
    Sample {
        /// `declared`, `before` or `after`, which is the folder of the fit.
        which: &'static str,
    },
    /// What the fit tells.
    Fit(&'a run::Event<'a>),
}

impl fmt::Display for LoopEvent<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Search(SearchProgress { round, done, .. }) => {
                write!(f, "search round {}: {done} searches on simulated data", round + 1)
            }
            Self::Searched => write!(f, "searched"),
            Self::Sample { which: "declared" } => write!(f, "sample the model as written"),
            Self::Sample { which } => write!(f, "sample the model {which}"),
            Self::Fit(event) => write!(f, "{event}"),
        }
    }
}

/// Who is told of events, and may stop the loop.
#[derive(Clone, Copy)]
pub struct LoopWatch<'a> {
    /// Called for every event, from any thread.
    pub on_event: &'a (dyn Fn(&LoopEvent<'_>) + Sync),
    /// Once this is true, the loop ends with [`LoopError::Stopped`](super::LoopError::Stopped).
    pub stop: &'a AtomicBool,
}

impl LoopWatch<'_> {
    pub(super) fn tell(&self, event: &LoopEvent<'_>) {
        (self.on_event)(event);
    }

    /// The same watch, for a search.
    pub(super) fn search(&self, progress: SearchProgress) -> ControlFlow<()> {
        self.tell(&LoopEvent::Search(progress));
        if self.stop.load(Ordering::Relaxed) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }
}

/// The flag of those who never stop.
static NEVER: AtomicBool = AtomicBool::new(false);

impl Default for LoopWatch<'_> {
    fn default() -> Self {
        Self { on_event: &|_| (), stop: &NEVER }
    }
}

impl fmt::Debug for LoopWatch<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LoopWatch").field("stop", self.stop).finish_non_exhaustive()
    }
}
