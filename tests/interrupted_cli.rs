//! Runs of the built program that are killed, interrupted, resumed, or lose a chain.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/contents.rs"]
mod contents;
#[path = "support/program.rs"]
mod program;

use std::fs;
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use contents::contents;
use program::{Workplace, text};
use serde_json::Value;

/// Long enough to be interrupted several times; a saving may come after each transition.
const NUTS: &str = "run erp.rs --sampler nuts --chains 3 --warmup 300 --draws 300";
const BLOCKED: &str = "run erp.rs --chains 3 --warmup 1500 --draws 3000";
const OFTEN: &str = "--checkpoint-every 0";

fn same_files(place: &Workplace, a: &str, b: &str) {
    contents::same_files(&place.path(a), &place.path(b));
}

fn start(place: &Workplace, arguments: &str) -> Child {
    place.command(arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Waits until the chain has been kept anew, so that the run has come further than before.
fn await_saving(place: &Workplace, chain: &str, child: &mut Child) {
    let path = place.path("cut/checkpoint").join(chain);
    let before = fs::read(&path).ok();
    let begun = Instant::now();
    while fs::read(&path).ok() == before {
        assert!(begun.elapsed() < Duration::from_mins(1), "{chain} is not kept");
        assert!(child.try_wait().unwrap().is_none(), "the run ended before it was interrupted");
        sleep(Duration::from_millis(5));
    }
}

fn kill_and_resume(arguments: &str) {
    let place = Workplace::new().with_erp();
    let whole = place.eplat(&format!("{arguments} --out whole"));
    assert!(matches!(whole.status.code(), Some(0 | 3)), "{}", text(&whole.stderr));
    // early in warm-up, then later and later, on other numbers of threads
    let mut resume = "";
    for (kill, threads) in [("chain-0", 1), ("chain-0", 2), ("chain-1", 3), ("chain-2", 1)] {
        let arguments = format!("{arguments} {OFTEN} --threads {threads} --out cut {resume}");
        let mut child = start(&place, &arguments);
        await_saving(&place, kill, &mut child);
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!place.path("cut/run.json").exists());
        resume = "--resume";
    }
    let end = place.eplat(&format!("{arguments} --out cut --resume"));
    assert_eq!(end.status.code(), whole.status.code(), "{}", text(&end.stderr));
    assert!(text(&end.stderr).contains("resume cut/checkpoint: "), "{}", text(&end.stderr));
    same_files(&place, "whole", "cut");

    let again = place.eplat(&format!("{arguments} --out cut --resume"));
    assert_eq!(again.status.code(), whole.status.code());
    assert!(text(&again.stderr).ends_with("complete: there is nothing left to do in cut\n"));
    same_files(&place, "whole", "cut");
}

#[test]
fn killed_nuts_goes_on_to_the_same_files() {
    kill_and_resume(NUTS);
}

#[test]
fn killed_blocked_runs_go_on_to_the_same_files() {
    kill_and_resume(BLOCKED);
}

/// The last lines of stderr, which say what went wrong.
fn complaint(output: &Output) -> String {
    let said = text(&output.stderr);
    let at = said.find("error: ").unwrap_or_else(|| panic!("no error in\n{said}"));
    said[at..].to_owned()
}

#[test]
fn ctrl_c_keeps_the_run_and_nothing_else_takes_its_place() {
    let place = Workplace::new().with_erp();
    let mut child = start(&place, &format!("{NUTS} {OFTEN} --out cut"));
    await_saving(&place, "chain-0", &mut child);
    let signalled = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(signalled.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
    assert!(text(&output.stderr).ends_with(
        "interrupted: the run is kept in cut/checkpoint\n\
         help: go on with the same command line and --resume\n"
    ));
    assert_eq!(place.names(), ["cut", "erp.rs"]);
    let kept = contents(&place.path("cut"));
    assert!(kept.iter().all(|(path, _)| path.starts_with("checkpoint")));

    let refused = |arguments: &str| {
        let output = place.eplat(arguments);
        assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
        assert!(contents(&place.path("cut")) == kept, "{arguments} changed the interrupted run");
        output
    };
    let other_settings = NUTS.replace("--draws 300", "--draws 400 --seed 7");
    let outputs = [
        refused(&format!("{NUTS} --out cut")),
        refused(&format!("{other_settings} --out cut --resume")),
        refused(&format!("{NUTS} --out elsewhere --resume")),
    ];
    let at_once = text(&outputs[0].stderr);
    assert!(at_once.starts_with("error: "), "something was done before: {at_once}");
    let said = outputs.each_ref().map(complaint);
    insta::assert_snapshot!(said.join("\n"), @r"
    error: cut/checkpoint holds an interrupted run
    help: go on with it by --resume, write elsewhere with --out DIR, or delete the folder to give it up

    error: the interrupted run in cut/checkpoint is another one: draws is 300 there, 400 here; seed is 1 there, 7 here
    help: repeat its command line with --resume, or delete the folder to give it up

    error: no interrupted run in elsewhere/checkpoint
    help: leave out --resume to start one, or name its folder with --out
    ");
    place.file("erp.rs", include_str!("../models/erp_exact.rs"));
    let other_model = complaint(&refused(&format!("{NUTS} --out cut --resume")));
    assert!(other_model.contains("hash of the model is "), "{other_model}");

    place.file("erp.rs", include_str!("../models/erp.rs"));
    let path = place.path("cut/checkpoint/chain-0");
    let state = fs::read(&path).unwrap();
    fs::write(&path, &state[..state.len() / 2]).unwrap();
    let truncated = complaint(&place.eplat(&format!("{NUTS} --out cut --resume")));
    insta::assert_snapshot!(truncated, @r"
    error: cut/checkpoint/chain-0: the file is not whole: its checksum does not fit
    help: the run cannot go on from here; delete the folder cut/checkpoint and start anew
    ");
}

/// A model from which no chain moves where its start lies beyond the cliff.
const CLIFF: &str = "
use eplat::prelude::*;

fn cliff<D: Real>(a: D) -> D {
    if a.re() > 1.0 { (a - a.re()) * 1e300 } else { a * 0.0 }
}

model! {
    model Cliff;
    param a ~ Normal(0.0, 1.0);
    density beyond = cliff(a);
}
";

#[test]
fn the_chains_that_come_through_are_reported_with_the_one_that_failed() {
    let place = Workplace::new();
    place.file("cliff.rs", CLIFF);
    let output = place.eplat("run cliff.rs --seed 5 --draws 300 --out out");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    let failures: Vec<&str> = said.lines().filter(|line| line.contains("warning: chain")).collect();
    let [failure] = failures[..] else { panic!("{said}") };
    let failure = failure.strip_prefix("warning: ").unwrap();
    assert!(failure.contains("no step size between 1e-30 and 1e30"), "{failure}");
    let shown = text(&output.stdout);
    assert!(shown.contains(&format!("Failed: {failure}")), "{shown}");
    assert!(shown.contains("Not converged: 1 of 4 chains failed ✗"), "{shown}");
    let record: Value = serde_json::from_str(&place.read("out/run.json")).unwrap();
    assert!(record["failed_chains"][0].as_str().unwrap().starts_with(failure));
    assert!(place.read("out/report.html").contains("<dt>failed<dd>chain "));
    assert_eq!(place.read("out/draws.csv").lines().count(), 1 + 3 * 300);
    assert!(!place.path("out/checkpoint").exists());

    let none = place.command("run none.rs --out none");
    place.file("none.rs", CLIFF.replace("> 1.0", "> -100.0"));
    let output = { none }.output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(complaint(&output).starts_with("error: every chain failed; the first:\nchain 1"));
    assert!(!place.path("none/checkpoint").exists());
}

/// A field under a ceiling that one measurement presses it against.
const CEILING: &str = "
use eplat::prelude::*;

fn ceiling<D: Real>(f: D) -> D {
    if f.re() > 105.0 { f * 1e4 } else { f }
}

model! {
    model Ceiling;
    field f(x) [ms] in 50.0..150.0 = m + a * gp(Rbf(rho), K = 8) where {
        m   [ms] ~ Flat;
        a   [ms] ~ HalfNormal(5.0);
        rho [mm] ~ InvGamma(2.0, 40.0);
    }
    observe y(row): Number ~ Normal(ceiling(f(row)), 3.0);
}
";

#[test]
fn divergences_are_traced_to_the_site_that_causes_them() {
    let place = Workplace::new();
    place.file("ceiling.rs", CEILING);
    place.file("data.csv", "vertex,site,value\n10,roof,104\n2000,wall,85\n4000,floor,85\n");
    for sampler in ["blocked", "nuts"] {
        let output = place.eplat(&format!(
            "run ceiling.rs --mesh embedded --data data.csv --sampler {sampler} --draws 300 --out {sampler}"
        ));
        assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
        let shown = text(&output.stdout);
        let line = shown.lines().find(|line| line.starts_with("Divergences come from: "));
        assert!(line.is_some_and(|l| l.contains(": y at site roof (")), "{shown}");
        let record: Value =
            serde_json::from_str(&place.read(&format!("{sampler}/run.json"))).unwrap();
        let blamed = record["divergent_at"][0].as_str().unwrap();
        assert!(blamed.starts_with("y at site roof ("), "{blamed}");
        assert!(place.read(&format!("{sampler}/report.html")).contains("y at site roof ("));
    }
}

#[test]
fn a_run_starts_from_an_earlier_one_on_fewer_measurements() {
    let place = Workplace::new().with_erp();
    let first = place.eplat("run erp.rs --out first");
    assert_eq!(first.status.code(), Some(0), "{}", text(&first.stderr));
    let table = place.read("first/measurements.csv");
    let fewer: Vec<&str> = table.lines().take(1 + 16).collect();
    place.file("fewer.csv", fewer.join("\n") + "\n").file("all.csv", &table);
    let earlier = place.eplat(
        "run erp.rs --mesh embedded --data fewer.csv --warmup 500 --draws 500 --out earlier",
    );
    assert!(matches!(earlier.status.code(), Some(0 | 3)), "{}", text(&earlier.stderr));
    let short = "run erp.rs --mesh embedded --data all.csv --warmup 100 --draws 500 --init earlier";
    for (sampler, bound) in [("blocked", 1.02), ("nuts", 1.1)] {
        let warm = place.eplat(&format!("{short} --sampler {sampler} --out {sampler}"));
        let said = text(&warm.stderr);
        assert!(matches!(warm.status.code(), Some(0 | 3)), "{said}");
        assert!(said.contains("init   earlier: 52 of 52 unknowns\n"), "{said}");
        let record: Value =
            serde_json::from_str(&place.read(&format!("{sampler}/run.json"))).unwrap();
        // fitted to draws that the new rows contradict, the stand-in holds chains fast: R-hat 4
        let r_hat = record["max_r_hat"].as_f64().unwrap();
        assert!(r_hat < bound, "{sampler}: {r_hat}");
        assert!(record["hashes"]["init"].is_string());
    }
    place.file("more.rs", include_str!("../models/erp.rs").replacen("K = 24", "K = 26", 1));
    let more = place.eplat("run more.rs --init first --warmup 40 --draws 20 --out more");
    let said = text(&more.stderr);
    assert!(said.contains("init   first: 52 of 54 unknowns\n"), "{said}");
    assert!(said.contains("started as usual: tau_out.eta[24], tau_out.eta[25]\n"), "{said}");

    place.file("exact.rs", include_str!("../models/erp_exact.rs"));
    let refused = [
        place.eplat("run exact.rs --init first --out other"),
        place.eplat("run erp.rs --init nowhere --out other"),
    ];
    assert!(refused.iter().all(|output| output.status.code() == Some(1)));
    insta::assert_snapshot!(refused.each_ref().map(complaint).join("\n"), @r"
    error: --init: the run in first is of the model Erp, not of ErpExact
    help: name a run of this model, or start without --init

    error: cannot read nowhere/unknowns.npz: No such file or directory (os error 2)
    help: check the path; it is relative to the folder you are in
    ");
}
