//! `eplat doctor`: what this machine has for eplat, and what runs on it.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command as Process, ExitCode, Stdio};

use clap::Args;

use super::library::{Library, library};
use super::voice::stdout;
use crate::error::Failure;
use crate::store::{cache, memory};

/// Bytes of free memory that a run on a mesh of 100,000 vertices needs.
const ENOUGH_MEMORY: u64 = 1 << 30;

/// `eplat doctor`
#[derive(Debug, Args)]
pub(super) struct Command {}

/// How something is.
#[derive(Clone, Copy, PartialEq)]
enum State {
    Well,
    /// Not there, and not needed for most.
    Absent,
    Bad,
}

/// A line of the answer.
struct Line {
    what: &'static str,
    state: State,
    text: String,
    /// What to do where it is not there.
    remedy: &'static str,
}

impl Command {
    /// Prints a line for each thing that is looked at; exit code 1 if something does not run.
    #[expect(clippy::unused_self, reason = "as every command")]
    pub(super) fn run(&self) -> Result<ExitCode, Failure> {
        let (kept, toolchain) = (kept(), toolchain());
        let compiles = kept.state == State::Well && toolchain.state == State::Well;
        let lines = [program(), free_memory(), kept, toolchain, compiled_against()];
        let mut out = stdout();
        for Line { what, state, text, remedy } in &lines {
            let mark = match state {
                State::Well => "ok ",
                State::Absent => "-- ",
                State::Bad => "NO ",
            };
            writeln!(out, "{mark} {what:<13} {text}")?;
            if *state != State::Well {
                writeln!(out, "                  → {remedy}")?;
            }
        }
        let rust = if compiles {
            ", with Rust code in them, too"
        } else {
            "; those with Rust code in them do not yet"
        };
        writeln!(out, "\nModels that ship and models of your own run{rust}.")?;
        Ok(ExitCode::from(u8::from(lines.iter().any(|line| line.state == State::Bad))))
    }
}

fn program() -> Line {
    let path = std::env::current_exe().map_or_else(|e| e.to_string(), |p| p.display().to_string());
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let version = env!("CARGO_PKG_VERSION");
    let text = format!("eplat {version}, {path}; {threads} threads");
    Line { what: "program", state: State::Well, text, remedy: "" }
}

/// Memory that is free, where the system tells it.
fn free_memory() -> Line {
    let state = |is_well| if is_well { State::Well } else { State::Bad };
    let (state, text) = match memory::available() {
        Some(bytes) => {
            (state(bytes >= ENOUGH_MEMORY), format!("{:.1} GB free", bytes as f64 / 1e9))
        }
        None => (State::Well, "this system does not tell".into()),
    };
    let remedy = "large meshes and tables may not fit: close other programs";
    Line { what: "memory", state, text, remedy }
}

/// The folder in which compiled models, eigenfunctions and checkpoints are kept.
fn kept() -> Line {
    let remedy = "set EPLAT_CACHE to a folder that can be written";
    let Some(folder) = cache::folder() else {
        let text = "no folder: neither EPLAT_CACHE nor HOME is set".into();
        return Line { what: "cache", state: State::Bad, text, remedy };
    };
    let written = std::fs::create_dir_all(&folder)
        .and_then(|()| tempfile::NamedTempFile::new_in(&folder).map(drop));
    let text = match &written {
        Ok(()) => {
            let megabytes = size(&folder) as f64 / 1e6;
            let most = cache::LIMIT / 1_000_000_000;
            format!(
                "{}, {megabytes:.0} MB; models and eigenfunctions that were not used for longest go beyond {most} GB; may be deleted at any time",
                folder.display()
            )
        }
        Err(error) => format!("{} cannot be written: {error}", folder.display()),
    };
    let state = if written.is_ok() { State::Well } else { State::Bad };
    Line { what: "cache", state, text, remedy }
}

/// Bytes of the files in a folder.
fn size(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let of = |entry: std::fs::DirEntry| match entry.metadata() {
        Ok(found) if found.is_dir() => size(&entry.path()),
        Ok(found) => found.len(),
        Err(_) => 0,
    };
    entries.map(of).sum()
}

/// Rust, which compiles models that hold code of the user's own.
fn toolchain() -> Line {
    let version = |tool: &str| {
        let output = Process::new(tool).arg("--version").stdin(Stdio::null()).output().ok()?;
        let text = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        output.status.success().then_some(text)
    };
    let remedy = "install Rust (https://rustup.rs) to run models with Rust code in them; all others need none";
    match (version("rustc"), version("cargo")) {
        (Some(rustc), Some(_)) => Line { what: "Rust", state: State::Well, text: rustc, remedy },
        _ => {
            Line { what: "Rust", state: State::Absent, text: "no rustc or no cargo".into(), remedy }
        }
    }
}

/// The library that a model with Rust code in it is compiled against.
fn compiled_against() -> Line {
    let text = match library() {
        Library::LinkedFrom => {
            "where this program was built: a model with Rust code compiles in seconds"
        }
        Library::Built => "built: a model with Rust code compiles in seconds",
        Library::ToBuild => "not built yet: the first model with Rust code takes some minutes",
    };
    Line { what: "library", state: State::Well, text: text.into(), remedy: "" }
}
