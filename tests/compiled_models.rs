//! Models of one's own in the cache: a program is used while it is what its files say, and whole.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use program::{Workplace, text};

const MODEL: &str = "use eplat::prelude::*;
pub mod a;
mod b; // a table
#[path = \"c.rs\"]
mod other;
include!(\"d.in\");

fn shift<D: Real>(x: D) -> D {
    x + a::A + b::B + other::C + D4
}

model! {
    model Shifted;
    param mean [ms] ~ Normal(1.0, 2.0);
    let shifted(row) [ms] = shift(mean);
    observe y(row): Number [ms] ~ Normal(shifted(row), 1.0);
}
";

/// The files beside the model, and what they hold.
const BESIDE: [(&str, &str); 4] = [
    ("a.rs", "pub const A: f64 = 0.0;"),
    ("b.rs", "pub const B: f64 = 0.0;"),
    ("c.rs", "pub const C: f64 = 0.0;"),
    ("d.in", "const D4: f64 = 0.0;"),
];

fn workplace() -> Workplace {
    let place = Workplace::new();
    place.file("m.rs", MODEL).file("table.csv", "y\n1\n2\n");
    for (name, content) in BESIDE {
        place.file(name, content);
    }
    place
}

/// `eplat check` in a cache of its own.
fn check(place: &Workplace) -> Command {
    let mut command = place.command("check m.rs --data table.csv");
    command.env("EPLAT_CACHE", place.path("cache"));
    command
}

/// The log density that it tells.
fn log_density(output: &Output) -> String {
    assert!(output.status.success(), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    let (_, value) = said.split_once("log density ").unwrap_or_else(|| panic!("{said}"));
    value.split(' ').next().unwrap().to_owned()
}

#[test]
fn a_change_of_any_file_that_the_compiler_read_is_seen() {
    let place = workplace();
    let first = log_density(&check(&place).output().unwrap());
    for (name, content) in BESIDE {
        place.file(name, content.replace("0.0", "3.0"));
        let changed = log_density(&check(&place).output().unwrap());
        assert_ne!(changed, first, "{name}");
        place.file(name, content);
        let back = check(&place).output().unwrap();
        assert_eq!(log_density(&back), first, "{name}");
    }
    let unchanged = check(&place).output().unwrap();
    assert_eq!(text(&unchanged.stderr), "");
}

/// A folder with a `rustc` that runs `script` before the compiler itself.
fn compiler_after(place: &Workplace, script: &str) -> String {
    let path = std::env::var("PATH").unwrap();
    let found = std::env::split_paths(&path).map(|folder| folder.join("rustc"));
    let rustc = found.into_iter().find(|file| file.is_file()).unwrap();
    let wrapper = place.path("bin/rustc");
    place.file("bin/rustc", format!("#!/bin/sh\n{script}\nexec {} \"$@\"\n", rustc.display()));
    fs::set_permissions(wrapper, fs::Permissions::from_mode(0o755)).unwrap();
    format!("{}:{path}", place.path("bin").display())
}

#[test]
fn a_file_saved_while_it_is_compiled_does_not_become_another_text_s_program() {
    for name in ["m.rs", "c.rs"] {
        let place = workplace();
        let before = place.read(name);
        let edited = place.path("edited").display().to_string();
        place.file("edited", before.replace("Normal(1.0", "Normal(7.0").replace("0.0", "3.0"));
        let save = format!("cp {edited} {}", place.path(name).display());
        let output = check(&place).env("PATH", compiler_after(&place, &save)).output().unwrap();
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains(&format!("{name} was saved while the model was compiled\nhelp: ")));
        let edited = log_density(&check(&place).output().unwrap());
        place.file(name, before);
        let original = log_density(&check(&place).output().unwrap());
        assert_ne!(edited, original, "{name}");
    }
}

/// The programs in the cache.
fn programs(place: &Workplace) -> Vec<PathBuf> {
    let entries = fs::read_dir(place.path("cache/programs")).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    paths.filter(|path| path.extension().is_none()).collect()
}

#[test]
fn a_program_that_is_not_whole_is_compiled_again() {
    let place = workplace();
    let first = log_density(&check(&place).output().unwrap());
    for length in [0, 1 << 20] {
        let [program] = &programs(&place)[..] else { panic!("one program") };
        fs::OpenOptions::new().write(true).open(program).unwrap().set_len(length).unwrap();
        let again = check(&place).output().unwrap();
        assert_eq!(log_density(&again), first);
        assert!(text(&again.stderr).contains("compiling m.rs"));
    }
}

#[test]
fn processes_that_need_the_same_model_compile_it_once_and_killed_ones_leave_nothing() {
    let place = workplace();
    // killed while it compiles
    let slow = compiler_after(&place, "touch began; echo unfinished > program; sleep 1");
    let mut killed = check(&place)
        .env("PATH", &slow)
        .stderr(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let packages = place.path("cache/packages");
    let unfinished = || {
        let folders = fs::read_dir(&packages).into_iter().flatten().flatten();
        let inside = folders.flat_map(|folder| fs::read_dir(folder.path()).unwrap().flatten());
        let left = inside.filter(|e| e.file_name().to_string_lossy().starts_with(".tmp"));
        left.filter(|folder| folder.path().join("program").exists()).count()
    };
    while unfinished() == 0 {
        assert!(killed.try_wait().unwrap().is_none());
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    killed.kill().unwrap();
    killed.wait().unwrap();
    // the compiler that it started ends by itself
    std::thread::sleep(std::time::Duration::from_millis(2500));
    let start = || check(&place).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let together: Vec<_> = (0..4).map(|_| start()).collect();
    let outputs = together.into_iter().map(|child| child.wait_with_output().unwrap());
    let outputs: Vec<Output> = outputs.collect();
    let compiled = outputs.iter().filter(|o| text(&o.stderr).contains("compiling m.rs")).count();
    assert_eq!(compiled, 1);
    let first = log_density(&outputs[0]);
    assert!(outputs.iter().all(|output| log_density(output) == first));
    assert_eq!(unfinished(), 0);
    assert_eq!(programs(&place).len(), 1);
}
