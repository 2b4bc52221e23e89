//! Two short runs of the built program, compared, reported again, and their mode found.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/models/erp.rs");

fn eplat(folder: &Path, arguments: &str) -> Output {
    let arguments = arguments.replace("MODEL", MODEL);
    let words = arguments.split_whitespace();
    Command::new(env!("CARGO_BIN_EXE_eplat")).args(words).current_dir(folder).output().unwrap()
}

/// Standard output of a command that leaves with `code`.
fn said(folder: &Path, arguments: &str, code: i32) -> String {
    let output = eplat(folder, arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

/// Standard error of a command that fails.
fn refused(folder: &Path, arguments: &str) -> String {
    let output = eplat(folder, arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments}");
    String::from_utf8(output.stderr).unwrap()
}

fn json(folder: &Path, name: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join(name)).unwrap()).unwrap()
}

#[test]
fn two_runs_are_compared_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    // Too few draws to converge: exit code 3.
    let short = "--chains 2 --warmup 100 --draws 60";
    let first = said(at, &format!("run MODEL {short} --out a"), 3);
    said(
        at,
        &format!("run MODEL {short} --seed 2 --mesh embedded --data a/measurements.csv --out b"),
        3,
    );
    said(at, &format!("run MODEL {short} --seed 3 --out other"), 3);

    let run = json(at, "a/run.json");
    assert_eq!(run["loo"]["n_measurements"], 20);
    let table = fs::read_to_string(at.join("a/loo.csv")).unwrap();
    let elpd = |line: &str| line.split(',').nth(4).unwrap().parse::<f64>().unwrap();
    let sum: f64 = table.lines().skip(1).map(elpd).sum();
    assert!((sum - run["loo"]["elpd_loo"].as_f64().unwrap()).abs() < 1e-9);
    assert!(first.contains("Leave-one-out elpd "), "{first}");

    let again = said(at, "report a", 3);
    let without_last_line = |text: &str| text.trim().rsplit_once('\n').unwrap().0.to_owned();
    assert_eq!(without_last_line(&first), without_last_line(&again));
    assert!(again.contains("Open a/report.html in a browser"), "{again}");

    let compared = said(at, "compare a b --json", 0);
    let compared: Value = serde_json::from_str(&compared).unwrap();
    let elpd = |side: &str| compared[side]["loo"]["elpd_loo"].as_f64().unwrap();
    let difference = compared["elpd_diff"].as_f64().unwrap();
    assert!((difference - (elpd("a") - elpd("b"))).abs() < 1e-9);
    assert_eq!(compared["trustworthy"], false, "20 measurements are few");
    let text = said(at, "compare a a", 0);
    assert!(
        text.contains("A − B: 0.0 ± 0.0 over 20 measurements; A and B predict alike"),
        "{text}"
    );

    let text = refused(at, "compare a other");
    assert!(text.contains("the measurements differ: ") && text.contains("help:"), "{text}");
    fs::write(at.join("b/loo.csv"), table.lines().next().unwrap()).unwrap();
    let text = refused(at, "compare a b");
    assert!(text.contains("b/loo.csv is not the file that this run left"), "{text}");
    fs::remove_file(at.join("b/summary.json")).unwrap();
    assert!(refused(at, "report b").contains("cannot read b/summary.json"));
    assert!(refused(at, "report none").contains("no folder none"));
}

#[test]
fn the_mode_does_not_depend_on_the_seed_and_is_mapped() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::write(
        at.join("data.csv"),
        "site,vertex,protocol,lower,upper\n0,100,s1s2,240,250\n1,2000,s1s2,220,230\n2,4000,s1s2s3,200,210\n",
    )
    .unwrap();
    for seed in ["1", "2"] {
        let output = eplat(
            at,
            &format!(
                "run MODEL --optimize --mesh embedded --data data.csv --seed {seed} --out {seed}"
            ),
        );
        assert!(matches!(output.status.code(), Some(0 | 3)), "{output:?}");
    }
    let csv = |seed: &str| fs::read_to_string(at.join(seed).join("map.csv")).unwrap();
    assert_eq!(csv("1"), csv("2"));
    assert!(
        csv("1").contains("tau_out.eta[0],0.0,1"),
        "the collapsed mode is at its mode: {}",
        csv("1")
    );
    assert!(at.join("1/fields.vtp").is_file() && at.join("1/map.json").is_file());
    let usage = eplat(at, "run MODEL --optimize --draws 10");
    assert_eq!(usage.status.code(), Some(2));
}
