//! A run for which there is not enough memory goes on with its draws on disk, to the same results; one that cannot fit
//! even so is refused. The limit is a real one: whoever takes more is ended by the system.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use program::{Workplace, text};
use serde_json::Value;

const DRAWS: &str = "--draws 65536 --chains 2";

/// Runs on two threads, whatever the machine has, and with so many bytes of memory at most.
fn run(place: &Workplace, arguments: &str, out: &str, limit: Option<u64>) -> Output {
    let plain = place.command(&format!("run {arguments} {DRAWS} --threads 2 --json --out {out}"));
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

/// All files below a folder, by path from there, without those with times in them.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let (path, name) = (entry.as_ref().unwrap().path(), entry.unwrap().file_name());
        if path.is_dir() {
            let below = files(&path).into_iter();
            found.extend(below.map(|(path, bytes)| (Path::new(&name).join(path), bytes)));
        } else if name != "run.json" && name != "report.html" {
            found.insert(name.into(), fs::read(path).unwrap());
        }
    }
    found
}

/// A run with all memory and one with `limit` bytes leave the same; with `too_few` there is none.
fn check(place: &Workplace, arguments: &str, [limit, too_few]: [u64; 2]) {
    let whole = run(place, arguments, "whole", None);
    assert!(matches!(whole.status.code(), Some(0 | 3 | 4)), "{}", text(&whole.stderr));
    assert!(event(&whole, "on_disk").is_none());

    let little = run(place, arguments, "little", Some(limit));
    assert_eq!(little.status.code(), whole.status.code(), "{}", text(&little.stderr));
    let told = event(&little, "on_disk").unwrap();
    println!("{arguments}: {}", told["text"]);
    let figure = |name: &str| told[name].as_u64();
    assert!(figure("least") < figure("free") && figure("free") < figure("bytes"));
    let [whole, little] = ["whole", "little"].map(|folder| files(&place.path(folder)));
    assert!(whole.keys().eq(little.keys()), "{:?}", little.keys());
    for (name, bytes) in &whole {
        assert!(little[name] == *bytes, "{} differs", name.display());
    }

    let refused = run(place, arguments, "none", Some(too_few));
    let said = event(&refused, "error").unwrap()["text"].as_str().unwrap().to_owned();
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains("GB of memory; ") && said.contains("--draws and --chains"), "{said}");
}

/// A field of 64 modes, few rows and many draws.
fn with_voltages() -> Workplace {
    let place = Workplace::new();
    let mut table = "vertex,protocol,value\n".to_owned();
    for (vertex, value) in [(10, 1.5), (900, 2.25), (1800, 0.75), (2700, 3.5), (4000, 1.0)] {
        let _ = writeln!(table, "{vertex},bipolar,{value}");
    }
    place.file("sites.csv", table);
    place
}

const VOLTAGE: &str = "voltage --mesh embedded --data sites.csv";
/// Less than a run takes with everything in memory, by a third at least; and less than it can do with.
const LIMITS: [u64; 2] = [105_000_000, 60_000_000];

#[test]
fn with_less_memory_the_results_are_the_same() {
    check(&with_voltages(), &format!("{VOLTAGE} --warmup 200"), LIMITS);
}

#[test]
fn so_are_draws_of_the_prior() {
    check(&with_voltages(), &format!("{VOLTAGE} --prior"), LIMITS);
}

/// Nearly normal, of as many unknowns as the field.
const WIDE: &str = "use eplat::prelude::*;
model! {
    model Wide;
    param x(64) ~ Normal(0.0, 1.0);
    param y ~ Gamma(20.0, 1.0);
}
";

/// Draws are chosen by their weights from others on the disk.
#[test]
fn so_are_those_of_a_normal_approximation() {
    let place = Workplace::new();
    place.file("wide.rs", WIDE);
    check(&place, "wide.rs --laplace", LIMITS);
}
