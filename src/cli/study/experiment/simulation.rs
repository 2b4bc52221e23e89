//! The paced atrium with the true fields, and with their posterior means.

use std::sync::Mutex;

use clap::Args;

use super::super::super::atrium::{AtriumBar, introduce, tell};
use crate::study::{SimulationEvent, SimulationPlan};

#[derive(Debug, Args)]
pub(super) struct SimulationArgs {
    /// Do not simulate the atrium: no APD. The same command without this goes on with it
    #[arg(long)]
    pub(super) skip_simulation: bool,
    /// Beats of the atrium, 600 ms apart; the last is measured
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..))]
    beats: u32,
    /// Vertex that is paced, counted from 0 as in the file [default: one at the rim of the widest opening]
    #[arg(long, value_name = "VERTEX")]
    pace: Option<usize>,
    /// Cut every triangle into four, this many times, for the simulation [default: until vertices are 0.4 mm
    /// apart]
    #[arg(long, value_name = "N")]
    refine: Option<u32>,
}

impl SimulationArgs {
    pub(super) fn plan(&self) -> SimulationPlan {
        SimulationPlan { beats: self.beats, pace: self.pace, refine: self.refine }
    }
}

/// Tells on stderr how the two simulations go.
#[derive(Default)]
pub(super) struct Teller {
    bar: Mutex<Option<AtriumBar>>,
}

impl Teller {
    pub(super) fn tell(&self, event: SimulationEvent<'_>) {
        let mut bar = self.bar.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        match event {
            SimulationEvent::Begins(which, atrium) => {
                eprintln!("atrium with the {which} fields");
                introduce(atrium);
                *bar = AtriumBar::new(atrium.total_time()).ok();
            }
            SimulationEvent::Goes(event) => {
                if let Some(bar) = &*bar {
                    bar.show(event);
                }
            }
            SimulationEvent::WasComplete(folder) => {
                eprintln!("complete: there is nothing left to do in {}", folder.display());
            }
            SimulationEvent::Ends(atrium, beat, folder) => {
                if let Some(bar) = bar.take() {
                    bar.finish();
                }
                tell(atrium, beat, folder);
            }
        }
    }
}
