//! Ctrl-C, and how a run begins and goes on.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use clap::Args;
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use super::voice::{tell, tell_failure};
use crate::error::Failure;
use crate::run::{Keep, OutputFolder};

/// Exit code of an interrupted run: that of a program that Ctrl-C ended.
pub(super) const INTERRUPTED: u8 = 130;

/// Exit code of a process that a second Ctrl-C ended.
const ENDED: u8 = 131;

/// Options of how a run begins.
#[derive(Debug, Args)]
pub(super) struct BeginArgs {
    /// Go on with the interrupted run in the output folder, to the same numbers as without the
    /// interruption; nothing is done if that run is complete
    #[arg(long, conflicts_with_all = ["optimize", "laplace", "prior"])]
    resume: bool,
    /// Start from the results of an earlier run of this model, perhaps on fewer measurements: a
    /// short --warmup is then enough
    #[arg(long, value_name = "DIR", conflicts_with_all = ["optimize", "laplace", "prior"])]
    pub(super) init: Option<PathBuf>,
    /// Least time between two savings of what --resume goes on from; they never take more than 1 %
    /// of a run
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0, conflicts_with_all = ["optimize", "laplace", "prior"])]
    checkpoint_every: f64,
}

impl BeginArgs {
    /// How the run is kept.
    pub(super) fn keep(&self) -> Result<Keep, Failure> {
        let seconds = self.checkpoint_every;
        let every = Duration::try_from_secs_f64(seconds).map_err(|_| {
            Failure::usage(format_args!(
                "--checkpoint-every: expected seconds, 0 or more, got {seconds}\nhelp: 2 is the default"
            ))
        })?;
        Ok(Keep { resume: self.resume, every, ..Keep::default() })
    }
}

/// The flag that the first Ctrl-C or SIGTERM sets; the second ends the program at once, whatever it does. There is
/// one for all that a command does.
pub(super) fn stop_flag() -> Result<Arc<AtomicBool>, Failure> {
    static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    if let Some(stop) = STOP.get() {
        return Ok(Arc::clone(stop));
    }
    let stop = Arc::new(AtomicBool::new(false));
    let watched = [SIGINT, SIGTERM]
        .iter()
        .try_for_each(|signal| flag::register(*signal, Arc::clone(&stop)).map(drop))
        .and_then(|()| end_at_second());
    watched.map_err(|error| Failure::new(format_args!("cannot watch for Ctrl-C: {error}")))?;
    Ok(Arc::clone(STOP.get_or_init(|| stop)))
}

/// Ends the process at the second signal: a function of a model's that never returns cannot be asked to stop.
#[cfg(unix)]
fn end_at_second() -> std::io::Result<()> {
    use std::io::Read as _;
    let (mut signals, sender) = std::os::unix::net::UnixStream::pair()?;
    for signal in [SIGINT, SIGTERM] {
        signal_hook::low_level::pipe::register(signal, sender.try_clone()?)?;
    }
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        let mut one = [0];
        if (0..2).all(|_| signals.read_exact(&mut one).is_ok()) {
            tell_failure(&Failure::new(
                "ended at once, by a second Ctrl-C\nhelp: a run goes on with --resume from where it was last kept",
            ));
            std::process::exit(i32::from(ENDED));
        }
    })?;
    Ok(())
}

#[cfg(not(unix))]
fn end_at_second() -> std::io::Result<()> {
    let second = std::sync::Arc::new(AtomicBool::new(false));
    flag::register_conditional_shutdown(SIGINT, ENDED.into(), Arc::clone(&second))?;
    flag::register(SIGINT, second).map(drop)
}

/// What the user is told after Ctrl-C.
pub(super) fn farewell(out: &OutputFolder) {
    let checkpoint = out.checkpoint();
    let text = format_args!(
        "interrupted: the run is kept in {}\nhelp: go on with the same command line and --resume",
        checkpoint.display()
    );
    tell("interrupted", text, json!({ "folder": out.path() }));
}
