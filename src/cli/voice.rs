//! How a command speaks on stderr: in words, as JSON with one event on each line, or not at all.
//!
//! A process has one stderr, so it has one voice: [`speak`] sets it before the command begins. Errors are always
//! told. Results on stdout are no matter of this file.

use std::fmt::{self, Display};
use std::io::Write as _;
use std::sync::OnceLock;

use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Value, json};

use crate::error::Failure;

/// Options of how a command speaks.
#[derive(Clone, Copy, Debug, Default, Args)]
pub(super) struct Voice {
    /// Tell progress and errors on stderr as JSON, one event a line (docs/outputs.md), and print results on stdout as JSON where
    /// a command has any
    #[arg(long, global = true)]
    pub(super) json: bool,
    /// Tell nothing on stderr but errors
    #[arg(long, short, global = true)]
    quiet: bool,
}

/// A family of commands with the options of [`Voice`].
#[derive(Debug, Args)]
pub(super) struct Voiced<C: Subcommand> {
    #[command(subcommand)]
    pub(super) command: C,
    #[command(flatten)]
    pub(super) voice: Voice,
}

static VOICE: OnceLock<Voice> = OnceLock::new();

/// Sets how this process speaks; only the first call does anything.
pub(super) fn speak(voice: Voice) {
    VOICE.get_or_init(|| voice);
}

/// In words, unless another way was asked for.
pub(super) fn voice() -> Voice {
    VOICE.get().copied().unwrap_or_default()
}

impl Voice {
    /// Whether people read along: lines and bars, not events, not silence.
    pub(super) fn is_words(self) -> bool {
        !self.json && !self.quiet
    }
}

/// Tells that something happened: `text` in words; or an object of `event`, `text` and the fields of `more`, which
/// is an object, too.
pub(super) fn tell(event: &str, text: impl Display, more: Value) {
    let voice = voice();
    if voice.quiet {
        return;
    }
    if voice.json {
        line(&object(event, Some(text.to_string()), more));
    } else {
        line(&text);
    }
}

/// Tells how far something is, where events are asked for. People see a bar.
pub(super) fn tell_progress(event: &str, more: Value) {
    let voice = voice();
    if voice.json && !voice.quiet {
        line(&object(event, None, more));
    }
}

/// Tells in words, without figures for programs.
pub(super) fn note(text: impl Display) {
    tell("note", text, json!({}));
}

/// Tells why the command ends.
pub(super) fn tell_failure(failure: &Failure) {
    if voice().json {
        let more = json!({ "code": failure.code() });
        line(&object("error", Some(failure.to_string()), more));
    } else {
        line(&format_args!("error: {failure}"));
    }
}

fn object(event: &str, text: Option<String>, more: Value) -> Value {
    let mut all = json!({ "event": event });
    if let Value::Object(all) = &mut all {
        all.extend(text.map(|text| ("text".to_owned(), text.into())));
        if let Value::Object(more) = more {
            all.extend(more);
        }
    }
    all
}

/// A whole line at once. Nobody may be reading: that is no reason to end.
fn line(text: &dyn Display) {
    let _ = std::io::stderr().lock().write_all(format!("{text}\n").as_bytes());
}

/// The process's stdout. Whoever reads it may stop reading (`| head`): that is no error.
pub(super) fn stdout() -> impl std::io::Write {
    Stdout(std::io::stdout().lock())
}

struct Stdout(std::io::StdoutLock<'static>);

impl std::io::Write for Stdout {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match self.0.write(bytes) {
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(bytes.len()),
            written => written,
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        match self.0.flush() {
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
            flushed => flushed,
        }
    }
}

/// Prints what results say that are in files already: where it cannot be printed, that is told, and all is well.
pub(super) fn print_of_files(text: impl Display) {
    let mut out = stdout();
    if let Err(error) = out.write_all(format!("{text}\n").as_bytes()).and_then(|()| out.flush()) {
        note(format_args!("warning: cannot print the results: {error}; the files are written"));
    }
}

/// Where bars are drawn: nowhere, unless people read along.
pub(super) fn bar_target() -> ProgressDrawTarget {
    if voice().is_words() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() }
}

/// How much of something is done: a bar for people, events for programs.
pub(super) struct Count {
    bar: ProgressBar,
    event: &'static str,
}

impl Count {
    /// Of `total`. `event` is what it counts; `template` is that of `indicatif`.
    pub(super) fn new(event: &'static str, total: u64, template: &str) -> Result<Self, Failure> {
        let bar = ProgressBar::with_draw_target(Some(total), bar_target())
            .with_style(ProgressStyle::with_template(template)?);
        bar.tick();
        Ok(Self { bar, event })
    }

    /// `n` more are done.
    pub(super) fn add(&self, n: usize) {
        self.bar.inc(n as u64);
        tell_progress(self.event, json!({ "done": self.bar.position(), "of": self.bar.length() }));
    }

    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl fmt::Debug for Count {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Count").field("event", &self.event).finish_non_exhaustive()
    }
}
