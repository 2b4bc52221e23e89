//! All tests, and then which of them did not run for want of data or a program:
//! `cargo test --release --test all`.
//!
//! Cargo runs documentation tests after every other, so what is to be said last cannot be said by one of
//! its tests: this one runs cargo. What follows `--` goes to it, such as a part of the workspace's name.

#![allow(clippy::print_stdout, reason = "it prints")]

use std::fs;
use std::path::Path;
use std::process::{Command, ExitCode};

fn main() -> ExitCode {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("not_run");
    // what an earlier run left
    let _ = fs::remove_dir_all(&folder);
    let mut tests = Command::new(env!("CARGO"));
    tests.arg("test").args((!cfg!(debug_assertions)).then_some("--release"));
    let passed = match tests.args(std::env::args().skip(1)).status() {
        Ok(status) => status.success(),
        Err(error) => {
            println!("cargo does not start: {error}");
            false
        }
    };
    println!("\n{}", not_run(&folder));
    if passed { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// How many tests did not run, and a line for each.
fn not_run(folder: &Path) -> String {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut lines: Vec<String> = entries
        .map(|entry| {
            let why = fs::read_to_string(entry.path()).unwrap_or_default();
            format!("\n  {}: {}", entry.file_name().display(), why.trim())
        })
        .collect();
    lines.sort();
    let n = lines.len();
    format!("{n} tests did not run for want of data or a program{}", lines.concat())
}
