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

/// A line of the answer.
struct Line {
    what: &'static str,
    is_well: bool,
    text: String,
    /// What to do where it is not well.
    remedy: &'static str,
}

impl Command {
    /// Prints a line for each thing that is looked at; exit code 1 if something does not run.
    #[expect(clippy::unused_self, reason = "as every command")]
    pub(super) fn run(&self) -> Result<ExitCode, Failure> {
        let (kept, toolchain) = (kept(), toolchain());
        let runs_own = kept.is_well && toolchain.is_well;
        let lines = [program(), free_memory(), kept, toolchain, compiled_against()];
        let mut out = stdout();
        for Line { what, is_well, text, remedy } in &lines {
            writeln!(out, "{} {what:<13} {text}", if *is_well { "ok " } else { "NO " })?;
            if !is_well {
                writeln!(out, "                  → {remedy}")?;
            }
        }
        let own = if runs_own {
            ", and so do models of your own"
        } else {
            "; models of your own do not yet"
        };
        writeln!(out, "\nModels that ship run{own}.")?;
        Ok(ExitCode::from(u8::from(!lines.iter().all(|line| line.is_well))))
    }
}

fn program() -> Line {
    let path = std::env::current_exe().map_or_else(|e| e.to_string(), |p| p.display().to_string());
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let version = env!("CARGO_PKG_VERSION");
    let text = format!("eplat {version}, {path}; {threads} threads");
    Line { what: "program", is_well: true, text, remedy: "" }
}

/// Memory that is free, where the system tells it.
fn free_memory() -> Line {
    let (is_well, text) = match memory::available() {
        Some(bytes) => (bytes >= ENOUGH_MEMORY, format!("{:.1} GB free", bytes as f64 / 1e9)),
        None => (true, "this system does not tell".into()),
    };
    let remedy = "large meshes and tables may not fit: close other programs";
    Line { what: "memory", is_well, text, remedy }
}

/// The folder in which compiled models, eigenfunctions and checkpoints are kept.
fn kept() -> Line {
    let remedy = "set EPLAT_CACHE to a folder that can be written";
    let Some(folder) = cache::folder() else {
        let text = "no folder: neither EPLAT_CACHE nor HOME is set".into();
        return Line { what: "cache", is_well: false, text, remedy };
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
    Line { what: "cache", is_well: written.is_ok(), text, remedy }
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

/// Rust, which compiles models of the user's own.
fn toolchain() -> Line {
    let version = |tool: &str| {
        let output = Process::new(tool).arg("--version").stdin(Stdio::null()).output().ok()?;
        let text = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        output.status.success().then_some(text)
    };
    let remedy =
        "install Rust (https://rustup.rs) to run models of your own; models that ship need none";
    match (version("rustc"), version("cargo")) {
        (Some(rustc), Some(_)) => Line { what: "Rust", is_well: true, text: rustc, remedy },
        _ => Line { what: "Rust", is_well: false, text: "no rustc or no cargo".into(), remedy },
    }
}

/// The library that a model of the user's own is compiled against.
fn compiled_against() -> Line {
    let text = match library() {
        Library::LinkedFrom => {
            "where this program was built: a model of your own compiles in seconds"
        }
        Library::Built => "built: a model of your own compiles in seconds",
        Library::ToBuild => "not built yet: the first model of your own takes some minutes",
    };
    Line { what: "library", is_well: true, text: text.into(), remedy: "" }
}
