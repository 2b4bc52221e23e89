//! What a run tells, on stderr: lines, and a live table of the chains on a terminal.

use std::io::IsTerminal as _;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, MultiProgress, ProgressBar, ProgressStyle};

use super::events::run_event;
use super::interrupt::stop_flag;
use super::remaining::Remaining;
use super::voice::{Count, tell, tell_progress, voice};
use crate::error::Failure;
use crate::infer::{ChainProgress, Phase, Settings};
use crate::run::{Event, Watch};

/// Prints what a run tells, and ends it on Ctrl-C.
pub(super) struct Console {
    stop: Arc<AtomicBool>,
    /// Of the run that is sampling.
    sampling: Mutex<Option<Sampling>>,
    /// Of fits without single measurements, once they have begun.
    leaving_out: Mutex<Option<Count>>,
}

/// What is shown while a run samples.
struct Sampling {
    remaining: Remaining,
    /// For people.
    bars: Option<ChainBars>,
}

impl Console {
    pub(super) fn new() -> Result<Self, Failure> {
        Ok(Self { stop: stop_flag()?, sampling: Mutex::default(), leaving_out: Mutex::default() })
    }

    /// Hands a watcher to `run`, which is told about and may be stopped.
    pub(super) fn watching<T>(&self, run: impl FnOnce(Watch<'_>) -> T) -> T {
        let result = run(Watch { on_event: &|event| self.print(event), stop: &self.stop });
        self.finish();
        result
    }

    fn print(&self, event: &Event<'_>) {
        if let Event::Progress(progress) = event {
            return self.progress(progress, event);
        }
        if let Event::LeavingOut { done, of } = *event {
            return self.leaving_out(done, of);
        }
        if let Event::ChainFailed(_) | Event::Sampled { .. } = event {
            self.finish();
        }
        tell_event(event);
        let Event::Sampling { settings, sampler, .. } = event else { return };
        let bars = voice().is_words().then(|| ChainBars::new(settings));
        let sampling = Sampling { remaining: Remaining::new(settings, *sampler), bars };
        *self.sampling.lock().unwrap_or_else(PoisonError::into_inner) = Some(sampling);
    }

    fn progress(&self, progress: &ChainProgress, event: &Event<'_>) {
        let mut sampling = self.sampling.lock().unwrap_or_else(PoisonError::into_inner);
        let left = sampling.as_mut().and_then(|s| s.remaining.after(progress, Instant::now()));
        let (name, mut fields) = run_event(event);
        fields["seconds_left"] = left.map(|left| left.as_secs_f64().round()).into();
        tell_progress(name, fields);
        if let Some(bars) = sampling.as_ref().and_then(|sampling| sampling.bars.as_ref()) {
            bars.show(progress, event, left);
        }
    }

    fn leaving_out(&self, done: usize, of: usize) {
        let mut count = self.leaving_out.lock().unwrap_or_else(PoisonError::into_inner);
        if done == 0 {
            let template = "{bar:30} {pos}/{len} measurements left out, {eta} left";
            *count = Count::new("leaving_out", of as u64, template).ok();
        } else if let Some(count) = &*count {
            count.add(1);
        }
        if done == of
            && let Some(count) = count.take()
        {
            count.finish();
        }
    }

    /// Leaves the lines of the chains as they are.
    fn finish(&self) {
        let sampling = self.sampling.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(bars) = sampling.and_then(|sampling| sampling.bars) else { return };
        bars.bars.iter().for_each(ProgressBar::abandon);
        bars.left.finish_and_clear();
    }
}

/// Tells one event, with its figures.
pub(super) fn tell_event(event: &Event<'_>) {
    let (name, fields) = run_event(event);
    tell(name, event, fields);
}

/// Where every chain stands.
struct ChainBars {
    bars: Vec<ProgressBar>,
    /// Below them: how long all of them will take.
    left: ProgressBar,
    is_terminal: bool,
    warmup: usize,
}

impl ChainBars {
    /// For the chains of `settings`.
    fn new(settings: &Settings) -> Self {
        let Settings { chains, warmup, draws, .. } = *settings;
        let total = warmup + draws;
        let all = MultiProgress::new();
        let header = format!(
            "{:>5}  {:24}  {:>13}  {:<8}  {:>11}  {:>9}",
            "chain", "", "draws", "phase", "divergences", "step size"
        );
        let template = "{prefix:>5}  {bar:24}  {pos:>6}/{len:<6}  {msg:32}";
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
        let line = ProgressStyle::with_template("{msg}").unwrap_or_else(|_| style.clone());
        let left = all.add(ProgressBar::new(0)).with_style(line);
        Self { bars, left, is_terminal: std::io::stderr().is_terminal(), warmup }
    }

    /// The chain's bar, and how long all will take; without a terminal a line at the end of each phase.
    fn show(&self, p: &ChainProgress, event: &Event<'_>, left: Option<Duration>) {
        let (phase, divergences, step) = (p.phase.to_string(), p.divergences, p.step_size);
        let bar = &self.bars[p.chain];
        bar.set_position(p.iteration as u64);
        bar.set_message(format!("{phase:<8}  {divergences:>11}  {step:>9.3}"));
        if let Some(left) = left {
            self.left.set_message(format!("       about {} of sampling left", HumanDuration(left)));
        }
        let phase_ends = match p.phase {
            Phase::Warmup => p.iteration == self.warmup,
            Phase::Sampling => p.iteration == p.total,
        };
        if !self.is_terminal && phase_ends {
            tell_event(event);
        }
    }
}
