//! `eplat study`: a plan run whole, in tasks and after a loss gives the same files to the bit.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::fs;
use std::process::Output;

use program::{Workplace, text};

/// Twelve calibrations on four truths.
const PLAN: &str = "model = \"erp.rs\"\nlengthscales = [64.0, 128.0]\nsites = [5]\nresolutions = [10.0, 40.0, 20.0]\nfields = 2\ndesigns = 1\n";

impl Workplace {
    fn with_plan(self) -> Self {
        let place = self.with_erp();
        place.file("plan.toml", PLAN);
        place
    }
}

fn succeeds(output: &Output) {
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
}

#[test]
fn tasks_and_a_study_taken_up_again_give_the_same_table_as_one_run() {
    let place = Workplace::new().with_plan();
    succeeds(&place.eplat("study run plan.toml --out whole"));
    let whole = place.read("whole/results.csv");
    assert_eq!(whole.lines().count(), 1 + 12);
    let errors =
        whole.lines().nth(1).unwrap().split(',').skip(8).map(|x| x.parse::<f64>().unwrap());
    assert!(errors.clone().count() == 4 && errors.clone().all(|rmse| rmse > 0.0 && rmse < 100.0));

    for task in ["2/3", "0/3"] {
        succeeds(
            &place.eplat(&format!("study run plan.toml --out tasks --task {task} --threads 1")),
        );
    }
    let early = place.eplat("study merge plan.toml --out tasks");
    assert_eq!(early.status.code(), Some(1));
    insta::assert_snapshot!(text(&early.stderr), @r"
    error: tasks: the results of 1 of 4 truths are missing (numbers 1)
    help: run the plan again with the same --out, which does what is missing; or merge what is there with --partial
    ");
    succeeds(&place.eplat("study merge plan.toml --out tasks --partial"));
    assert_eq!(place.read("tasks/results.csv").lines().count(), 1 + 9);
    succeeds(&place.eplat("study run plan.toml --out tasks --task 1/3"));
    succeeds(&place.eplat("study merge plan.toml --out tasks"));
    assert_eq!(place.read("tasks/results.csv"), whole);

    // as after a kill: one block is gone
    fs::remove_file(place.path("tasks/blocks/00002.csv")).unwrap();
    let again = place.eplat("study run plan.toml --out tasks");
    assert!(
        text(&again.stderr).contains("on each of 4 truths, of which 1 are left to do"),
        "{}",
        text(&again.stderr)
    );
    assert_eq!(place.read("tasks/results.csv"), whole);
    assert_eq!(place.read("tasks/figure.svg"), place.read("whole/figure.svg"));
}

#[test]
fn results_of_another_plan_are_not_mixed_in() {
    let place = Workplace::new().with_plan();
    succeeds(&place.eplat("study run plan.toml --out one --task 0/4"));
    place.file("plan.toml", PLAN.replace("designs = 1", "designs = 2"));
    let other = place.eplat("study run plan.toml --out one");
    assert_eq!(other.status.code(), Some(1));
    insta::assert_snapshot!(text(&other.stderr), @r"
    error: one/study.json: the results there are of another plan, model, mesh or version
    help: give another --out, or remove the folder
    ");
    assert_eq!(fs::read_dir(place.path("one/blocks")).unwrap().count(), 1);
}

#[test]
fn the_job_array_runs_the_tasks_and_merges_after_any_of_them() {
    let place = Workplace::new().with_plan();
    succeeds(&place.eplat("study slurm plan.toml --out here --tasks 8"));
    let scripts = ["array.sbatch", "merge.sbatch", "submit.sh"];
    let scripts = scripts.map(|name| place.read(&format!("here/{name}"))).join("----\n");
    let root = fs::canonicalize(place.path("")).unwrap().display().to_string();
    let said = scripts.replace(&root, "ROOT").replace(env!("CARGO_BIN_EXE_eplat"), "eplat");
    insta::assert_snapshot!(said);
}
