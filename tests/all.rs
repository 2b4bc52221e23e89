//! All tests, and then which of them did not run for want of data or a program:
//! `cargo test --release --test all`.
//!
//! Cargo runs one test program after the other, and a program that waits or ends with one long test leaves a core
//! idle. So they are run two at a time, each by a cargo of its own, which prints what it has to say when it is done.
//! What follows `--` goes to a single cargo instead, such as a part of the workspace's name.

#![allow(clippy::print_stdout, reason = "it prints")]

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::sync::Mutex;

/// Programs that run at a time.
const AT_A_TIME: usize = 2;

fn main() -> ExitCode {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("not_run");
    // what an earlier run left
    let _ = fs::remove_dir_all(&folder);
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let passed =
        if arguments.is_empty() { all_passed() } else { is_success(&mut tests(arguments)) };
    println!("\n{}", not_run(&folder));
    if passed { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// `cargo test` with these arguments.
fn tests(arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Command {
    let mut tests = Command::new(env!("CARGO"));
    tests.arg("test").args((!cfg!(debug_assertions)).then_some("--release")).args(arguments);
    tests
}

fn is_success(command: &mut Command) -> bool {
    match command.status() {
        Ok(status) => status.success(),
        Err(error) => {
            println!("cargo does not start: {error}");
            false
        }
    }
}

/// Runs every test program.
fn all_passed() -> bool {
    let Some(names) = names() else { return false };
    let mut programs = vec![vec!["--lib".to_owned()], vec!["--bins".to_owned()]];
    programs.extend(names.into_iter().map(|name| vec!["--test".to_owned(), name]));
    programs.push(vec!["--doc".to_owned()]);
    let (programs, failed) = (Mutex::new(programs.into_iter()), Mutex::new(vec![]));
    let next = || programs.lock().ok().and_then(|mut programs| programs.next());
    let run = || {
        while let Some(program) = next() {
            let output = tests(program.iter().chain([&"--no-fail-fast".to_owned()])).output();
            let passed = output.as_ref().is_ok_and(|output| output.status.success());
            let said = match output {
                Ok(output) => [output.stderr, output.stdout].concat(),
                Err(error) => format!("cargo does not start: {error}").into_bytes(),
            };
            let Ok(mut failed) = failed.lock() else { return };
            println!("{}", String::from_utf8_lossy(&said));
            failed.extend((!passed).then(|| program.join(" ")));
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..AT_A_TIME {
            scope.spawn(run);
        }
    });
    let failed = failed.into_inner().unwrap_or_default();
    for program in &failed {
        println!("failed: cargo test {program}");
    }
    failed.is_empty()
}

/// Compiles every test program. The names of those that are no unit tests, each once; none if one does not compile.
fn names() -> Option<BTreeSet<String>> {
    let mut compiled = tests(["--no-run", "--message-format=json-render-diagnostics"]);
    let output = compiled.stderr(Stdio::inherit()).output();
    let output = output.inspect_err(|error| println!("cargo does not start: {error}")).ok()?;
    let lines = output.stdout.split(|byte| *byte == b'\n');
    let messages = lines.filter_map(|line| serde_json::from_slice::<serde_json::Value>(line).ok());
    let is_test = |message: &serde_json::Value| {
        message["profile"]["test"] == true && message["target"]["kind"][0] == "test"
    };
    let name = |message: serde_json::Value| Some(message["target"]["name"].as_str()?.to_owned());
    let names = messages.filter(is_test).filter_map(name).filter(|name| name != "all").collect();
    output.status.success().then_some(names)
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
