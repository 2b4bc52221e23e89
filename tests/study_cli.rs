//! `eplat study`: a plan run whole, in tasks and after a loss gives the same files to the bit; an experiment's
//! numbers are those of its maps, and its maps those of its draws.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/picture.rs"]
mod picture;
#[path = "support/program.rs"]
mod program;
#[path = "support/sphere.rs"]
mod sphere;

use std::collections::BTreeMap;
use std::fs;
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use eplat::manifold::{biharmonic, eigenpairs};
use eplat::mesh::{self, Units};
use eplat::report::FieldDraws;
use eplat::surrogate::{erp_s2, erp_s3};
use program::{Workplace, text};
use serde_json::Value;

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

    let drawn = place.eplat("plot whole");
    succeeds(&drawn);
    assert_eq!(picture::checked(&place.path(""), &text(&drawn.stdout)), ["errors"]);

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
    // of a record that is damaged nobody knows whose results these are
    let record = place.read("one/study.json");
    place.file("one/study.json", &record[..record.len() / 2]);
    let damaged = place.eplat("study run plan.toml --out one");
    assert_eq!(text(&damaged.stderr), text(&other.stderr));
    assert_eq!(place.read("one/study.json"), &record[..record.len() / 2]);
}

/// Four sites with both protocols, then what is learnt in the time of a fifth.
const MINUTES: &str = "model = \"erp.rs\"\nchoice = \"next\"\nestimate = \"mean\"\nlengthscales = [64.0]\nsites = [4, 5]\nresolutions = [10.0]\nfields = 2\ndesigns = 1\nchains = 2\nwarmup = 100\ndraws = 100\n";

#[test]
fn what_is_learnt_next_is_weighed_by_its_minutes() {
    let place = Workplace::new().with_erp();
    let run = |out: &str, minutes: &str| {
        place.file("plan.toml", format!("{MINUTES}minutes = {{ {minutes} }}\n"));
        succeeds(&place.eplat(&format!("study run plan.toml --out {out}")));
        let table = place.read(&format!("{out}/results.csv"));
        let last_three = |line: &str| {
            let cells: Vec<String> = line.rsplit(',').take(3).map(str::to_owned).collect();
            cells.into_iter().rev().collect::<Vec<_>>()
        };
        let lines: Vec<Vec<String>> = table.lines().map(last_three).collect();
        assert_eq!(lines[0], ["minutes", "measured_s1s2", "measured_s1s2s3"]);
        lines
    };
    // what takes a quarter of the other's time is measured instead of it, whichever it is
    let short = run("one", "moving = 1.0, s1s2 = 1.5, s1s2s3 = 6.0");
    for truth in short[1..].chunks(2) {
        assert_eq!(truth, [["34.0", "4", "4"], ["41.5", "7", "4"]]);
    }
    let other = run("other", "moving = 1.0, s1s2 = 6.0, s1s2s3 = 1.5");
    assert_eq!(other[2], ["41.5", "4", "7"]);

    let whole = place.read("other/results.csv");
    fs::remove_file(place.path("other/blocks/00001.csv")).unwrap();
    succeeds(&place.eplat("study run plan.toml --out other --threads 1"));
    assert_eq!(place.read("other/results.csv"), whole);
}

#[test]
fn minutes_that_make_no_sense_are_refused_and_leave_no_folder() {
    let place = Workplace::new().with_erp();
    let refused = |plan: &str| {
        place.file("plan.toml", plan);
        let output = place.eplat("study run plan.toml --out none");
        assert!(output.status.code() == Some(1) && !place.path("none").exists());
        text(&output.stderr)
    };
    let said = [
        "{ moving = 1.0, s1s2 = 2.0, s1s4 = 3.0 }",
        "{ moving = 1.0 }",
        "{ s1s2 = 2.0, s1s2s3 = 3.0 }",
        "{ moving = 1.0, s1s2 = 0.0, s1s2s3 = 3.0 }",
        "2.0",
    ]
    .map(|minutes| refused(&format!("{MINUTES}minutes = {minutes}\n")));
    insta::assert_snapshot!(said.join("\n"), @r"
    error: plan.toml: minutes of s1s2, s1s4, where the model observes s1s2, s1s2s3
    help: minutes = { moving = 1.0, s1s2 = 2.0, s1s2s3 = 2.0 }

    error: plan.toml: minutes of no protocol, where the model observes s1s2, s1s2s3
    help: minutes = { moving = 1.0, s1s2 = 2.0, s1s2s3 = 2.0 }

    error: plan.toml: 
    TOML parse error at line 12, column 11
       |
    12 | minutes = { s1s2 = 2.0, s1s2s3 = 3.0 }
       |           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    expected moving = 0 or more: the minutes to move to a site

    error: plan.toml: 
    TOML parse error at line 12, column 11
       |
    12 | minutes = { moving = 1.0, s1s2 = 0.0, s1s2s3 = 3.0 }
       |           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    s1s2 = 0: expected a positive number of minutes

    error: plan.toml: 
    TOML parse error at line 12, column 11
       |
    12 | minutes = 2.0
       |           ^^^
    invalid type: floating point `2.0`, expected a map
    ");
    let said = refused(&format!("{PLAN}minutes = {{ moving = 1.0, s1s2 = 2.0, s1s2s3 = 3.0 }}\n"));
    assert!(said.contains("minutes without choice = \"next\""), "{said}");
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

/// On that sphere, with one beat.
const EXPERIMENT: &str = "study experiment --mesh sphere.vtk --units mm --lengthscale 12 --sites 5 --chains 2 \
                          --warmup 300 --draws 500 --beats 1";

impl Workplace {
    fn with_sphere(self) -> Self {
        sphere::write(&self.path("sphere.vtk"));
        self
    }

    fn maps(&self, file: &str) -> BTreeMap<String, Vec<f64>> {
        mesh::read(&self.path(file), Units::Mm).unwrap().scalars()
    }

    fn json(&self, file: &str) -> Value {
        serde_json::from_str(&self.read(file)).unwrap()
    }
}

/// Exit code 0, or 3 where so few draws do not converge.
fn ends(output: &Output) {
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", text(&output.stderr));
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn is_near(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * (1.0 + a.abs())
}

/// `tau_out`, `apd_max`, ERP_S2, ERP_S3 in every draw and at every vertex, and whether it was repaired there: from
/// the draws' coefficients, with biharmonic distances one by one.
fn draws_made_physical(place: &Workplace, folder: &str) -> Vec<Vec<([f64; 4], bool)>> {
    let mesh = sphere::sphere();
    let basis = eigenpairs(&mesh, 256).unwrap();
    let n = mesh.n_vertices();
    let weights: Vec<Vec<f64>> =
        (0..n).map(|v| biharmonic(&basis, v).iter().map(|d| d.powi(-4)).collect()).collect();
    let all = FieldDraws::read(&place.path(folder).join("run").join(FieldDraws::FILE)).unwrap();
    let derived = |[t, a]: [f64; 2]| [t, a, erp_s2(t, a), erp_s3(t, a)];
    let is_bad = |[t, a, s2, _]: [f64; 4]| {
        !((1.0..=30.0).contains(&t) && (120.0..=270.0).contains(&a) && (0.0..=280.0).contains(&s2))
    };
    let step = all.n_draws().div_ceil(400);
    let one = |draw: usize| {
        let [t, a] = ["tau_out", "apd_max"].map(|name| all.at_vertices(name, draw).unwrap());
        let made: Vec<[f64; 4]> = (0..n).map(|v| derived([t[v], a[v]])).collect();
        let good: Vec<usize> = (0..n).filter(|v| !is_bad(made[*v])).collect();
        let mend = |v: usize| {
            if !is_bad(made[v]) {
                return (made[v], false);
            }
            let total: f64 = good.iter().map(|g| weights[v][*g]).sum();
            let average =
                |k: usize| good.iter().map(|g| weights[v][*g] * made[*g][k]).sum::<f64>() / total;
            (derived([average(0), average(1)]), true)
        };
        (0..n).map(mend).collect()
    };
    (0..all.n_draws()).step_by(step).map(one).collect()
}

#[test]
fn an_experiments_numbers_follow_from_its_draws_and_its_truth() {
    let place = Workplace::new().with_sphere();
    let output = place.eplat(&format!("{EXPERIMENT} --out one"));
    ends(&output);
    let (maps, found) = (place.maps("one/fields.vtp"), place.json("one/experiment.json"));
    let draws = draws_made_physical(&place, "one");
    let n = sphere::sphere().n_vertices();
    assert_eq!(found["draws"], draws.len());
    let pairs = (draws.len() * n) as f64;
    let repaired = draws.iter().flatten().filter(|(_, was_bad)| *was_bad).count() as f64 / pairs;
    assert!(repaired > 0.001, "nothing to repair: {repaired}");
    assert!(is_near(found["pairs_repaired"].as_f64().unwrap(), repaired));
    for (k, name) in ["tau_out", "apd_max", "erp_s2", "erp_s3"].into_iter().enumerate() {
        let map = |part: &str| &maps[&format!("{name}_{part}")];
        let truth = map("true");
        let (mut errors, mut inside, mut large) = (vec![], [0.0; 3], 0.0);
        for v in 0..n {
            let here: Vec<f64> = draws.iter().map(|draw| draw[v].0[k]).collect();
            let centre = mean(&here);
            let squares: f64 = here.iter().map(|x| (x - centre).powi(2)).sum();
            let sd = (squares / (here.len() as f64 - 1.0)).sqrt();
            assert!(
                is_near(map("mean")[v], centre) && (map("sd")[v] - sd).abs() < 1e-7,
                "{name} {v}"
            );
            let ise = (centre - truth[v]).abs() / sd;
            assert!((map("ise")[v] - ise).abs() < 1e-6 * ise.max(1.0), "{name} {v}");
            let rank = here.iter().filter(|x| **x < truth[v]).count() as f64 / here.len() as f64;
            for (inside, level) in inside.iter_mut().zip([0.5, 0.9, 0.95]) {
                *inside += f64::from(u8::from((rank - 0.5).abs() <= 0.5 * level)) / n as f64;
            }
            large += f64::from(u8::from(ise > 3.0)) / n as f64;
            errors.push(centre - truth[v]);
        }
        let said = |key: &str| found["maps"][name][key].as_f64().unwrap();
        let squared: Vec<f64> = errors.iter().map(|e| e * e).collect();
        assert!(is_near(said("rmse"), mean(&squared).sqrt()), "{name}");
        assert!(is_near(said("mean_error"), mean(&errors)), "{name}");
        assert!(is_near(said("ise_above_3"), large), "{name}");
        for (level, share) in ["50", "90", "95"].into_iter().zip(inside) {
            let said = found["maps"][name]["coverage"][level].as_f64().unwrap();
            assert!(is_near(said, share), "{name} {level}: {said} {share}");
        }
    }
    // the beat's maps are those of the two simulations, at the vertices that both meshes have
    let [with_truth, with_mean] =
        ["true", "mean"].map(|which| place.maps(&format!("one/simulation/{which}/beat.vtp")));
    for name in ["lat", "apd20", "apd90"] {
        assert_eq!(maps[&format!("{name}_true")], with_truth[name][..n]);
        assert_eq!(maps[&format!("{name}_mean")], with_mean[name][..n]);
    }
    let pairs = with_mean["apd90"].iter().zip(&with_truth["apd90"]);
    let squared: Vec<f64> = pairs.map(|(mean, truth)| (mean - truth).powi(2)).collect();
    assert_eq!(squared.len(), 7682, "cut twice");
    let said = found["simulation"]["mean_against_true"]["apd90"]["rmse_ms"].as_f64().unwrap();
    assert!(is_near(said, mean(&squared).sqrt()) && said > 0.5 && said < 40.0, "{said}");
    let page = place.read("one/report.html");
    assert_eq!(page.matches("<canvas data-array=").count(), 4 * 4 + 2 * 3);
}

#[test]
fn an_interrupted_experiment_goes_on_with_the_same_command() {
    let place = Workplace::new().with_sphere();
    ends(&place.eplat(&format!("{EXPERIMENT} --out whole")));
    for stage in ["simulation/true", "simulation/mean"] {
        let mut command = place.command(&format!("{EXPERIMENT} --out cut"));
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let (checkpoint, begun) =
            (place.path("cut").join(stage).join("checkpoint"), Instant::now());
        while !checkpoint.exists() {
            assert!(begun.elapsed() < Duration::from_mins(2), "{stage} does not begin");
            assert!(child.try_wait().unwrap().is_none(), "it ended before it was interrupted");
            sleep(Duration::from_millis(2));
        }
        let id = child.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
        assert!(text(&output.stderr).ends_with(
            "interrupted: what is done is kept in cut\nhelp: go on with the same command line\n"
        ));
        assert!(!place.path("cut/experiment.json").exists());
    }
    let last = place.eplat(&format!("{EXPERIMENT} --out cut"));
    ends(&last);
    let said = text(&last.stderr);
    assert!(said.contains("resume cut/simulation/mean/checkpoint: "), "{said}");
    for file in ["fields.vtp", "measurements.csv", "simulation/mean/beat.vtp"] {
        assert_eq!(
            place.read(&format!("cut/{file}")),
            place.read(&format!("whole/{file}")),
            "{file}"
        );
    }
    let [cut, whole] = ["cut", "whole"].map(|folder| {
        let mut found = place.json(&format!("{folder}/experiment.json"));
        found["seconds_of_the_run"].take();
        found["simulation"]["seconds"].take();
        found
    });
    assert_eq!(cut, whole);

    let other = place.eplat(&format!("{EXPERIMENT} --seed 2 --out cut"));
    assert_eq!(other.status.code(), Some(1));
    assert!(
        text(&other.stderr).contains("error: the experiment in cut is another one: ")
            && text(&other.stderr).contains("seed is 1 there, 2 here\nhelp: name another folder"),
        "{}",
        text(&other.stderr)
    );
}

#[test]
fn a_truth_that_is_given_is_measured() {
    let place = Workplace::new().with_sphere();
    let quick = "--sites 5 --chains 2 --warmup 200 --draws 200 --skip-simulation";
    let drawn = format!("study experiment --mesh sphere.vtk --units mm --lengthscale 12 {quick}");
    ends(&place.eplat(&format!("{drawn} --out drawn")));
    let given = format!("study experiment --truth drawn/fields.vtp --units mm {quick}");
    ends(&place.eplat(&format!("{given} --out given")));
    assert_eq!(place.read("given/measurements.csv"), place.read("drawn/measurements.csv"));
    let [drawn, given] =
        ["drawn", "given"].map(|folder| place.maps(&format!("{folder}/fields.vtp")));
    assert_eq!(drawn["erp_s3_true"], given["erp_s3_true"]);
    assert!(!given.contains_key("apd90_true"));
    let found = place.json("given/experiment.json");
    assert_eq!(found["truth_repaired"], 0.0, "it was repaired before");
    assert!(found["simulation"].is_null());

    let refused = |arguments: &str| {
        let output = place.eplat(&format!("study experiment {arguments} --out none"));
        assert!(matches!(output.status.code(), Some(1 | 2)) && !place.path("none").exists());
        text(&output.stderr)
    };
    let said = refused("--truth sphere.vtk --units mm");
    assert!(said.contains("expected point data tau_out_true or tau_out, found none"), "{said}");
    assert!(refused("--sites 0").contains("--sites: expected a positive number, got 0"));
    let said = refused("--mesh sphere.vtk --units mm --pace 482");
    assert!(said.contains("--pace 482 is no vertex of the surface, which has 482"), "{said}");
}
