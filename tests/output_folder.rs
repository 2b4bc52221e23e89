//! A folder of results is of one run, and what is not eplat's stays as it is.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use program::{Workplace, text};

const SMALL: &str = "run erp --chains 2 --warmup 60 --draws 100 --out out";
const LONG: &str =
    "run erp --sampler nuts --chains 2 --warmup 2000 --draws 100000 --checkpoint-every 0 --out out";

fn names(place: &Workplace, folder: &str) -> Vec<String> {
    let entries = fs::read_dir(place.path(folder)).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Contents of the files in a folder, by name; folders by their names.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let entries = fs::read_dir(folder).unwrap().map(Result::unwrap);
    let of = |entry: fs::DirEntry| {
        let content = fs::read(entry.path()).unwrap_or_default();
        (entry.file_name().into_string().unwrap(), content)
    };
    let mut all: Vec<_> = entries.map(of).collect();
    all.sort();
    all
}

fn sampled(place: &Workplace, arguments: &str) {
    let output = place.eplat(arguments);
    assert!(matches!(output.status.code(), Some(0 | 3 | 4)), "{}", text(&output.stderr));
}

#[test]
fn a_second_run_into_the_folder_of_a_live_one_is_refused() {
    let place = Workplace::new();
    let mut live = place.command(LONG).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let begun = Instant::now();
    while !place.path("out/checkpoint/chain-0").exists() {
        assert!(begun.elapsed() < Duration::from_mins(1) && live.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(5));
    }
    for arguments in [LONG, SMALL, &format!("{LONG} --resume"), &format!("{SMALL} --force")] {
        let second = place.eplat(arguments);
        let said = text(&second.stderr);
        assert_eq!(second.status.code(), Some(1), "{said}");
        let expected = format!(
            "error: out is in use: another eplat (process {}) writes to it\n\
             help: wait until it has ended, or name another folder with --out DIR\n",
            live.id()
        );
        assert!(said.ends_with(&expected), "{said}");
    }
    assert!(live.try_wait().unwrap().is_none());
    live.kill().unwrap();
    live.wait().unwrap();
    // a dead one locks nobody out
    let after = text(&place.eplat(LONG).stderr);
    assert!(after.contains("out/checkpoint holds an interrupted run"), "{after}");
    fs::remove_dir_all(place.path("out/checkpoint")).unwrap();
    sampled(&place, SMALL);
    assert!(!names(&place, "out").iter().any(|name| name.starts_with('.')));
}

#[test]
fn four_processes_on_one_folder_leave_the_files_of_one() {
    let place = Workplace::new();
    let start = |seed: usize| {
        let mut command = place.command(&format!("{SMALL} --seed {seed}"));
        command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let together: Vec<_> = (1..=4).map(start).collect();
    let mut n_done = 0;
    for child in together {
        let output = child.wait_with_output().unwrap();
        let said = text(&output.stderr);
        match output.status.code() {
            Some(0 | 3 | 4) => n_done += 1,
            Some(1) => assert!(said.contains("error: out is in use: another eplat"), "{said}"),
            other => panic!("{other:?} {said}"),
        }
    }
    assert!(n_done > 0);
    let record: serde_json::Value = serde_json::from_str(&place.read("out/run.json")).unwrap();
    let seed = record["seed"].as_u64().unwrap();
    let named = record["files"].as_object().unwrap();
    assert_eq!(names(&place, "out").len(), named.len() + 1);
    for (name, seal) in named {
        let found = eplat::store::seal_of(&place.path("out").join(name)).unwrap();
        assert_eq!(seal.as_str(), Some(&*found), "{name}");
    }
    // what one alone leaves
    sampled(&place, &format!("{} --seed {seed}", SMALL.replace("--out out", "--out alone")));
    assert_eq!(place.read("out/draws.csv"), place.read("alone/draws.csv"));
}

#[test]
fn a_run_that_dies_while_it_writes_leaves_the_earlier_one_whole() {
    let place = Workplace::new();
    sampled(&place, SMALL);
    let earlier = contents(&place.path("out"));
    // the system kills a process that writes a longer file than 64 kB: in draws.csv, after summary.csv
    let limited = |arguments: &str| {
        let mut command = Command::new("sh");
        let line = format!("ulimit -f 64; exec \"$0\" {arguments}");
        command.args(["-c", &line]).arg(env!("CARGO_BIN_EXE_eplat")).current_dir(place.path(""));
        command.env("EPLAT_CACHE", concat!(env!("CARGO_TARGET_TMPDIR"), "/cache"));
        command.output().unwrap()
    };
    let killed = limited(&format!("{SMALL} --seed 2 --checkpoint-every 1000"));
    assert_ne!(killed.status.code(), Some(0));
    let mut after = contents(&place.path("out"));
    after.retain(|(name, _)| name != "checkpoint" && !name.starts_with('.'));
    assert!(after == earlier, "files of two runs");
    // what it left half-written goes with the next run
    assert!(names(&place, "out").iter().any(|name| name.starts_with('.')));
    let _ = fs::remove_dir_all(place.path("out/checkpoint"));
    sampled(&place, &format!("{SMALL} --seed 2"));
    let expected: Vec<&String> = earlier.iter().map(|(name, _)| name).collect();
    assert_eq!(names(&place, "out").iter().collect::<Vec<_>>(), expected);
    assert!(contents(&place.path("out")) != earlier);
}

#[test]
fn files_of_two_kinds_of_run_do_not_stand_side_by_side() {
    let place = Workplace::new();
    sampled(&place, SMALL);
    let mode = place.eplat("run erp --optimize --out out");
    assert!(matches!(mode.status.code(), Some(0 | 3)), "{}", text(&mode.stderr));
    assert_eq!(names(&place, "out"), ["fields.vtp", "map.csv", "map.json"]);
}

#[test]
fn files_of_a_users_are_not_replaced_unasked() {
    let cases = [
        "summary.csv",
        "measurements.csv",
        "posterior.zarr/mine",
        "run.json",
        "map.json",
        "checkpoint/common",
        "checkpoint/chain-notes.txt",
        "checkpoint/draws-1",
        "checkpoint/identity.json",
    ];
    for name in cases {
        let place = Workplace::new();
        place.file(&format!("out/{name}"), "mine");
        let refused = place.eplat(SMALL);
        let said = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(1), "{name}: {said}");
        let named = name.trim_end_matches("/mine");
        assert!(said.contains(&format!("out/{named} is ")), "{name}: {said}");
        assert!(!said.contains("sampl"), "{name} is noticed too late: {said}");
        assert_eq!(place.read(&format!("out/{name}")), "mine");
        assert_eq!(names(&place, "out").len(), 1, "{name}");
    }
    let place = Workplace::new();
    place.file("out/summary.csv", "mine").file("out/notes.txt", "mine");
    sampled(&place, &format!("{SMALL} --force"));
    assert_ne!(place.read("out/summary.csv"), "mine");
    assert_eq!(place.read("out/notes.txt"), "mine");
    // an earlier run is no user's file
    sampled(&place, &format!("{SMALL} --seed 2"));

    place.file("there/predictions.csv", "mine").file("new.csv", place.read("out/measurements.csv"));
    let refused = place.eplat("predict out new.csv --out there");
    assert!(text(&refused.stderr).contains("there/predictions.csv is of no run of eplat"));
    assert_eq!(place.read("there/predictions.csv"), "mine");
    place.file("loop/report.html", "mine").file("data.csv", place.read("out/measurements.csv"));
    let refused = place.eplat("loop erp --mesh embedded --data data.csv --out loop");
    let said = text(&refused.stderr);
    assert!(said.contains("loop/report.html is of no run of eplat"), "{said}");
}

/// Nor are they by studies and experiments, whose folders hold other files.
#[test]
fn studies_replace_no_files_of_a_users() {
    let place = Workplace::new().with_erp();
    let plan = "model = \"erp.rs\"\nlengthscales = [64.0]\nsites = [5]\nresolutions = [10.0]\nfields = 1\ndesigns = 1\n\
                warmup = 40\ndraws = 40\n";
    place.file("plan.toml", plan);
    let experiment = "study experiment --skip-simulation --chains 2 --warmup 60 --draws 40";
    let cases = [
        (experiment, "measurements.csv"),
        (experiment, "fields.vtp"),
        (experiment, "settings.json"),
        (experiment, "experiment.json"),
        (experiment, "run/summary.csv"),
        ("study run plan.toml", "results.csv"),
        ("study run plan.toml", "summary.csv"),
        ("study run plan.toml", "blocks/00000.csv"),
        ("study slurm plan.toml", "submit.sh"),
    ];
    for (i, (command, name)) in cases.into_iter().enumerate() {
        let file = format!("out{i}/{name}");
        place.file(&file, "mine");
        let refused = place.eplat(&format!("{command} --out out{i}"));
        let said = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(1), "{command}, {name}: {said}");
        let named = file.trim_end_matches("/00000.csv");
        assert!(said.contains(&format!("{named} is of no run of eplat")), "{name}: {said}");
        assert_eq!(place.read(&file), "mine");
    }
}
