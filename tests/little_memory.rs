//! A run for which there is not enough memory goes on with its draws on disk, to the same results; one that cannot fit
//! even so is refused. The limit is a real one: whoever takes more is ended by the system.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use program::{Workplace, text};
use serde_json::Value;

/// Files without times in them.
const SAME: [&str; 8] = [
    "summary.csv",
    "summary.json",
    "draws.csv",
    "loo.csv",
    "rows.csv",
    "fields.vtp",
    "field_draws.npz",
    "unknowns.npz",
];

/// The model with a field of 64 modes, few rows and many draws, on two threads whatever the machine has.
fn run(place: &Workplace, out: &str, limit: Option<u64>) -> Output {
    let arguments = format!(
        "run voltage --mesh embedded --data sites.csv --warmup 200 --draws 65536 --chains 2 --threads 2 --json --out {out}"
    );
    let plain = place.command(&arguments);
    let Some(limit) = limit else { return with_two_threads(plain).output().unwrap() };
    let mut limited = Command::new("sh");
    limited
        .args(["-c", "ulimit -d \"$0\" && exec \"$@\""])
        .arg((limit >> 10).to_string())
        .arg(plain.get_program())
        .args(plain.get_args())
        .current_dir(plain.get_current_dir().unwrap());
    for (name, value) in plain.get_envs() {
        limited.env(name, value.unwrap());
    }
    with_two_threads(limited).output().unwrap()
}

fn with_two_threads(mut command: Command) -> Command {
    command.env("RAYON_NUM_THREADS", "2");
    command
}

fn event(output: &Output, name: &str) -> Option<Value> {
    let said = text(&output.stderr);
    let mut events = said.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    events.find(|event| event["event"] == name)
}

/// All files below a folder, by path.
fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = vec![];
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push((path.clone(), fs::read(path).unwrap()));
        }
    }
    found.sort();
    found
}

#[test]
fn with_less_memory_the_results_are_the_same() {
    let place = Workplace::new();
    let mut table = "vertex,protocol,value\n".to_owned();
    for (vertex, value) in [(10, 1.5), (900, 2.25), (1800, 0.75), (2700, 3.5), (4000, 1.0)] {
        let _ = writeln!(table, "{vertex},bipolar,{value}");
    }
    place.file("sites.csv", table);
    let whole = run(&place, "whole", None);
    assert!(matches!(whole.status.code(), Some(0 | 3 | 4)), "{}", text(&whole.stderr));
    assert!(event(&whole, "on_disk").is_none());
    let bytes = event(&whole, "sampling").unwrap()["bytes"].as_u64().unwrap();

    let little = run(&place, "little", Some(bytes / 100 * 85));
    assert_eq!(little.status.code(), whole.status.code(), "{}", text(&little.stderr));
    let told = event(&little, "on_disk").unwrap();
    println!("{}", told["text"]);
    assert!(told["least"].as_u64() < told["free"].as_u64() && told["free"].as_u64() < Some(bytes));
    for name in SAME {
        let [whole, little] =
            ["whole", "little"].map(|folder| fs::read(place.path(folder).join(name)).unwrap());
        assert!(whole == little, "{name} differs");
    }
    let [whole, little] =
        ["whole", "little"].map(|folder| place.path(folder).join("posterior.zarr"));
    let [whole_files, little_files] = [&whole, &little].map(|folder| files(folder));
    assert_eq!(whole_files.len(), little_files.len());
    for ((one, expected), (other, got)) in whole_files.iter().zip(&little_files) {
        let [one, other] =
            [one.strip_prefix(&whole), other.strip_prefix(&little)].map(Result::unwrap);
        assert!(one == other && expected == got, "{} differs", one.display());
    }
    // nothing else is left
    let names = |folder: &str| {
        let entries = fs::read_dir(place.path(folder)).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    assert_eq!(names("little"), names("whole"));

    let refused = run(&place, "none", Some(bytes / 100 * 45));
    let said = event(&refused, "error").unwrap()["text"].as_str().unwrap().to_owned();
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains("GB of memory; ") && said.contains("--draws and --chains"), "{said}");
}
