//! Progress of the chains: a live table on a terminal, one line per chain and phase otherwise.

use std::io::IsTerminal as _;
use std::sync::Arc;
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use crate::infer::{ChainProgress, Phase, Progress, Settings};
use crate::store::Checkpoint;

/// Shows where every chain stands, on stderr; keeps the run, and ends it on request.
pub(super) struct ChainBars {
    bars: Vec<ProgressBar>,
    is_terminal: bool,
    warmup: usize,
    checkpoint: Checkpoint,
    stop: Arc<AtomicBool>,
    warned: Once,
}

impl ChainBars {
    /// For the chains of `settings`, kept in `checkpoint`, until `stop` is set.
    pub(super) fn new(settings: &Settings, checkpoint: Checkpoint, stop: Arc<AtomicBool>) -> Self {
        let Settings { chains, warmup, draws, .. } = *settings;
        let total = warmup + draws;
        let all = MultiProgress::new();
        let header = format!(
            "{:>5}  {:24}  {:>13}  {:<8}  {:>11}  {:>9}  {:>5}",
            "chain", "", "draws", "phase", "divergences", "step size", "ETA"
        );
        let template = "{prefix:>5}  {bar:24}  {pos:>6}/{len:<6}  {msg:32}  {eta:>5}";
        let style = ProgressStyle::with_template(template)
            .unwrap_or_else(|_| ProgressStyle::default_bar())
            .progress_chars("━╸─");
        let title = all.add(ProgressBar::new(0));
        title.set_style(ProgressStyle::with_template("{msg}").unwrap_or_else(|_| style.clone()));
        title.abandon_with_message(header);
        let bar = |chain: usize| {
            let bar = all.add(ProgressBar::new(total as u64)).with_style(style.clone());
            bar.set_prefix((chain + 1).to_string());
            bar.set_message("starting");
            bar
        };
        let bars = (0..chains).map(bar).collect();
        let is_terminal = std::io::stderr().is_terminal();
        Self { bars, is_terminal, warmup, checkpoint, stop, warned: Once::new() }
    }

    /// Leaves the lines as they are.
    pub(super) fn finish(self) -> Checkpoint {
        self.bars.iter().for_each(ProgressBar::abandon);
        self.checkpoint
    }
}

impl Progress for ChainBars {
    fn report(&self, p: &ChainProgress) {
        let (phase, divergences, step) = (p.phase.to_string(), p.divergences, p.step_size);
        let bar = &self.bars[p.chain];
        bar.set_position(p.iteration as u64);
        bar.set_message(format!("{phase:<8}  {divergences:>11}  {step:>9.3}"));
        let phase_ends = match p.phase {
            Phase::Warmup => p.iteration == self.warmup,
            Phase::Sampling => p.iteration == p.total,
        };
        if !self.is_terminal && phase_ends {
            eprintln!(
                "chain {}  {:>5}/{}  {phase:<8} divergences {divergences:<3} step {step:.3}",
                p.chain + 1,
                p.iteration,
                p.total
            );
        }
        if let Some(reason) = self.checkpoint.failure() {
            self.warned.call_once(|| {
                eprintln!(
                    "warning: the run goes on, but cannot be resumed if interrupted: {reason}"
                );
            });
        }
    }

    fn should_stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn checkpoint(&self) -> Option<&Checkpoint> {
        Some(&self.checkpoint)
    }
}
