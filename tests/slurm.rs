//! A study as a Slurm job array: 8 tasks, one killed on purpose, submitted again, merged, equal to the
//! local run to the bit.
//!
//! ```text
//! cargo test --release --test slurm -- --ignored --nocapture
//! ```
//! Needs a Slurm that runs jobs on this machine; CONTRIBUTING.md says how to set one up.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::process::{Command, Output};
use std::thread::sleep;
use std::time::{Duration, Instant};

use program::{Workplace, text};

const PLAN: &str = "model = \"erp.rs\"\nlengthscales = [64.0, 128.0]\nsites = [5, 10, 20]\nresolutions = [10.0, 20.0]\nfields = 8\ndesigns = 3\n";

fn slurm(place: &Workplace, command: &str) -> Output {
    let mut words = command.split_whitespace();
    let mut command = Command::new(words.next().unwrap());
    command.args(words).current_dir(place.path("")).output().unwrap()
}

/// The numbers of the jobs in the queue.
fn queue(place: &Workplace, format: &str) -> Vec<String> {
    let listed =
        text(&slurm(place, &format!("squeue --noheader --array --format={format}")).stdout);
    listed.lines().map(|line| line.trim().to_owned()).collect()
}

fn wait_for(what: &str, done: impl Fn() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < Duration::from_mins(5), "waited in vain for {what}");
        sleep(Duration::from_millis(200));
    }
}

fn submit(place: &Workplace) {
    let submitted = slurm(place, "sh array/submit.sh");
    assert!(submitted.status.success(), "{}", text(&submitted.stderr));
}

#[test]
#[ignore = "needs Slurm, 1 minute"]
fn a_killed_task_is_missed_done_again_and_leaves_no_trace() {
    if Command::new("sbatch").arg("--version").output().is_err() {
        program::skipped::skipped("no sbatch");
        return;
    }
    let place = Workplace::new().with_erp();
    place.file("plan.toml", PLAN);
    let local = place.eplat("study run plan.toml --out local");
    assert!(local.status.success(), "{}", text(&local.stderr));
    assert!(place.eplat("study slurm plan.toml --out array --tasks 8").status.success());

    submit(&place);
    let is_running = || queue(&place, "%i,%t").into_iter().find(|job| job.ends_with("_3,R"));
    wait_for("the fourth task", || is_running().is_some());
    let task = is_running().unwrap_or_default();
    slurm(&place, &format!("scancel --signal=KILL {}", task.trim_end_matches(",R")));
    wait_for("the array", || queue(&place, "%i").is_empty());
    let merged = || place.path("array/results.csv").is_file();
    assert!(!merged(), "the merge did not see that the killed task's truths are missing");

    submit(&place);
    wait_for("the array", || queue(&place, "%i").is_empty());
    assert!(merged());
    assert_eq!(place.read("array/results.csv"), place.read("local/results.csv"));
}
