//! A simulation under way: progress, what it goes on from, Ctrl-C.

use std::io::IsTerminal as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressStyle};

use crate::ep::Precision;
use crate::ep::surface::{Simulation, State};
use crate::error::Failure;
use crate::store::{Checkpoint, Keeper};

/// A state, and which draw of the posterior it belongs to.
pub(super) type Kept<F> = (u32, State<F>);

/// Runs simulations so that they can be interrupted.
pub(super) struct Drive<'a> {
    pub(super) checkpoint: &'a Checkpoint,
    stop: Arc<AtomicBool>,
}

impl<'a> Drive<'a> {
    pub(super) fn new(checkpoint: &'a Checkpoint, stop: Arc<AtomicBool>) -> Self {
        Self { checkpoint, stop }
    }

    /// Runs the simulation of a draw to its end, from what was `kept` of this draw; it is kept in `slot`.
    /// `each` is told of every step. Whether the end was reached: not if somebody stops it.
    pub(super) fn run<F: Precision>(
        &self,
        (slot, draw): (usize, u32),
        simulation: &mut Simulation<F>,
        kept: Option<Kept<F>>,
        each: &mut (dyn FnMut(&Simulation<F>) -> Result<(), Failure> + Send),
    ) -> Result<bool, Failure> {
        if let Some((_, state)) = kept.filter(|kept| kept.0 == draw) {
            simulation.restore(state)?;
        }
        let mut keeper = Keeper::new(Some(self.checkpoint), slot);
        rayon::scope(|_| {
            while !simulation.is_done() {
                let stops = self.stop.load(Ordering::Relaxed);
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

    /// Says so if what --resume needs could not be written.
    pub(super) fn warn_of_failure(&self) {
        if let Some(reason) = self.checkpoint.failure() {
            eprintln!("warning: the simulation could not be kept for --resume: {reason}");
        }
    }
}

/// How far simulations are, on stderr: a bar on a terminal, a line for every tenth otherwise.
pub(super) struct Progress {
    bar: ProgressBar,
    is_terminal: bool,
    total: f64,
}

impl Progress {
    /// Of `total` ms.
    pub(super) fn new(total: f64) -> Result<Self, Failure> {
        let style = ProgressStyle::with_template("{bar:30} {pos}/{len} ms, {eta} left")?;
        let bar = ProgressBar::new(total as u64).with_style(style);
        Ok(Self { bar, is_terminal: std::io::stderr().is_terminal(), total })
    }

    /// `time` ms are done.
    pub(super) fn at(&self, time: f64) {
        let tenth = |time: f64| (10.0 * time / self.total) as u64;
        let before = self.bar.position();
        if time as u64 == before {
            return;
        }
        self.bar.set_position(time as u64);
        if !self.is_terminal && tenth(time) > tenth(before as f64) {
            let eta = self.bar.eta().as_secs();
            eprintln!("{} of {} ms, {eta} s left", time as u64, self.total as u64);
        }
    }

    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
