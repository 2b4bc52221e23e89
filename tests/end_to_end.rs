//! Whole runs of the built program in folders of their own.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::fs;
use std::process::Stdio;
use std::time::Duration;

use program::{Workplace, shared, text};
use serde_json::Value;

/// Settings of a run that is looked at for its files, not for its statistics.
const SMALL: &str = "--chains 2 --warmup 300 --draws 300";

/// DESIGN.md's list.
const FILES: [&str; 13] = [
    "draws.csv",
    "field_draws.npz",
    "fields.vtp",
    "loo.csv",
    "measurements.csv",
    "model.rs",
    "posterior.zarr",
    "report.html",
    "rows.csv",
    "run.json",
    "summary.csv",
    "summary.json",
    "unknowns.npz",
];

/// Runs the command; it must end with 0, or with 3 where so few draws fail the diagnostics.
fn sampled(place: &Workplace, arguments: &str) -> (String, String) {
    let output = place.eplat(arguments);
    let (out, said) = (text(&output.stdout), text(&output.stderr));
    assert!(
        matches!(output.status.code(), Some(0 | 3)),
        "{arguments}: {:?}\n{said}",
        output.status
    );
    (out, said)
}

fn names_in(place: &Workplace, folder: &str) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(place.path(folder))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

#[test]
fn a_run_leaves_every_file_and_the_same_numbers_for_any_number_of_threads() {
    let place = Workplace::new().with_erp();
    let (shown, _) = sampled(&place, &format!("run erp.rs {SMALL} --threads 1 --out a"));
    for words in ["tau_out.m", "R̂", "RMSE against the truth", "Files in a: "] {
        assert!(shown.contains(words), "no {words:?} in\n{shown}");
    }
    assert_eq!(names_in(&place, "a"), FILES);
    sampled(&place, &format!("run erp.rs {SMALL} --threads 2 --out b"));
    for file in
        ["summary.csv", "draws.csv", "loo.csv", "rows.csv", "fields.vtp", "measurements.csv"]
    {
        assert!(place.read(&format!("a/{file}")) == place.read(&format!("b/{file}")), "{file}");
    }

    let summary = place.read("a/summary.csv");
    let mut lines = summary.lines();
    let header = lines.next().unwrap();
    assert_eq!(header, "name,mean,sd,mcse,q5,q50,q95,ess_bulk,ess_tail,r_hat,unit");
    let names: Vec<&str> = lines.map(|line| line.split(',').next().unwrap()).collect();
    assert_eq!(names.len(), 2 * (3 + 24));
    let by_name = json(&place.read("a/summary.json"));
    assert!(names.iter().all(|name| by_name[name]["mean"].is_f64()));

    let draws = place.read("a/draws.csv");
    assert_eq!(draws.lines().count(), 1 + 2 * 300);
    let columns: Vec<&str> = draws.lines().next().unwrap().split(',').collect();
    assert_eq!(columns[..2], ["chain", "draw"]);
    assert_eq!(columns[2..], names);
    let is_number = |cell: &str| cell.parse::<f64>().is_ok_and(f64::is_finite);
    assert!(draws.lines().skip(1).all(|line| line.split(',').all(is_number)));

    run_record(&json(&place.read("a/run.json")));
    fields(&place.read("a/fields.vtp"));
    for group in [
        "posterior",
        "sample_stats",
        "log_likelihood",
        "posterior_predictive",
        "observed_data",
        "constant_data",
        "fields",
    ] {
        let node = json(&place.read(&format!("a/posterior.zarr/{group}/zarr.json")));
        assert_eq!(node["node_type"], "group", "{group}");
    }
    let page = place.read("a/report.html");
    assert!(page.starts_with("<!doctype html>") && page.trim_end().ends_with("</html>"));
    assert!(!page.contains("src=\"http"), "the page needs the network");
    let links: Vec<&str> =
        page.split("<a href=\"").skip(1).map(|link| link.split_once('"').unwrap().0).collect();
    assert!(links.len() >= FILES.len() - 1, "{links:?}");
    for link in links {
        assert!(FILES.contains(&link), "{link} leads nowhere");
    }

    // What was measured is a table like any other.
    let checked = place.eplat("check erp.rs --mesh embedded --data a/measurements.csv");
    assert_eq!(checked.status.code(), Some(0), "{}", text(&checked.stderr));
    assert!(text(&checked.stdout).contains("observe s1s2s3: 10 measurements\n"));
}

fn run_record(run: &Value) {
    for field in ["seed", "n_params", "grad_evals", "divergences"] {
        assert!(run[field].is_u64(), "{field}: {}", run[field]);
    }
    for field in
        ["ns_per_grad", "max_r_hat", "min_ess_bulk", "min_ess_tail", "ess_per_second", "e_bfmi"]
    {
        assert!(run[field].as_f64().is_some_and(|x| x > 0.0), "{field}: {}", run[field]);
    }
    for part in ["compile", "setup", "warmup", "sampling", "total"] {
        assert!(run["seconds"][part].is_f64(), "seconds.{part}");
    }
    for field in ["tau_out", "apd_max", "erp_s2", "erp_s3"] {
        assert!(run["rmse"][field].is_f64(), "rmse.{field}");
    }
    for answer in run["verdict"]["answers"].as_array().unwrap() {
        assert!(answer["question"].is_string() && answer["colour"].is_string(), "{answer}");
    }
    assert_eq!(run["verdict"]["answers"].as_array().unwrap().len(), 5);
    assert_eq!(run["questions"]["fits"]["sets"][0]["n"], 20);
    assert_eq!(run["model"], "Erp");
    assert_eq!(run["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(run["settings"]["draws"], 300);
    assert_eq!(run["hashes"]["model"].as_str().unwrap().len(), 64);
}

fn fields(vtp: &str) {
    assert!(vtp.trim_end().ends_with("</VTKFile>"));
    for field in ["tau_out", "apd_max", "erp_s2", "erp_s3"] {
        for of in ["mean", "sd", "true", "ise", "q5", "q50", "q95"] {
            assert!(vtp.contains(&format!("Name=\"{field}_{of}\"")), "{field}_{of}");
        }
    }
}

#[test]
fn with_json_nothing_else_is_on_stdout() {
    let place = Workplace::new().with_erp();
    let (stdout, stderr) = sampled(&place, &format!("run erp.rs {SMALL} --json --out out"));
    let result = json(&stdout);
    assert!(result["summary"]["apd_max.rho"]["r_hat"].is_f64());
    assert_eq!(result["run"], json(&place.read("out/run.json")));
    assert!(result["converged"].is_boolean() && result["verdict"]["colour"].is_string());
    assert!(stderr.contains("synthetic experiment"), "{stderr}");
}

#[test]
fn another_seed_gives_other_draws() {
    let place = Workplace::new().with_erp();
    let small = "--chains 2 --warmup 50 --draws 50";
    for seed in [1, 2] {
        sampled(&place, &format!("run erp.rs {small} --seed {seed} --out {seed}"));
    }
    assert_ne!(place.read("1/draws.csv"), place.read("2/draws.csv"));
}

#[test]
fn a_run_on_the_surface_that_another_left_has_its_own_maps() {
    let place = Workplace::new().with_erp();
    let small = "--chains 2 --warmup 50 --draws 50";
    sampled(&place, &format!("run erp.rs {small} --out a"));
    let of_a = "--mesh a/fields.vtp --units mm --data a/measurements.csv";
    sampled(&place, &format!("run erp.rs {of_a} {small} --seed 2 --out b"));
    let maps = place.read("b/fields.vtp");
    for name in ["apd_max_mean", "apd_max_true", "unphysical"] {
        assert_eq!(maps.matches(&format!("Name=\"{name}\"")).count(), 1, "{name}");
    }
}

#[test]
fn a_clinical_shell_and_tables_of_measurements() {
    let place = Workplace::new().with_erp();
    if let Some(shell) = shared("openep_la/la_lat.vtk") {
        let mesh = format!("--mesh {} --units mm", shell.display());
        let (_, said) = sampled(&place, &format!("run erp.rs {mesh} {SMALL} --out shell"));
        let note = "mended: left out 1 other piece (62 vertices)";
        assert!(said.contains(note) && place.read("shell/run.json").contains(note), "{said}");
        assert_eq!(names_in(&place, "shell"), FILES);
    }
    for kind in ["clinical", "sphere"] {
        let Some(folder) = shared(&format!("synthetic/{kind}")) else { continue };
        let mesh = format!("--mesh {} --units mm", folder.join("mesh.vtk").display());
        for entry in fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()) {
            if !entry.is_dir() {
                continue;
            }
            let data = format!("--data {}", entry.join("train.csv").display());
            let checked = place.eplat(&format!("check erp.rs {mesh} {data}"));
            assert_eq!(checked.status.code(), Some(0), "{}", text(&checked.stderr));
        }
        let null = if kind == "clinical" { "null_s102" } else { "null_s101" };
        let data = format!("--data {}", folder.join(null).join("train.csv").display());
        sampled(&place, &format!("run erp.rs {mesh} {data} {SMALL} --out {kind}"));
        assert_eq!(names_in(&place, kind), FILES);
        assert!(json(&place.read(&format!("{kind}/run.json")))["rmse"].is_null());
    }
}

/// Killed at several moments of its life, a run leaves no file that looks whole but is not.
#[test]
fn an_interrupted_run_leaves_nothing_that_looks_whole() {
    let place = Workplace::new().with_erp();
    let arguments = "run erp.rs --chains 2 --warmup 100 --draws 100 --out out";
    for milliseconds in [100, 300, 500, 700, 1000] {
        let mut child =
            place.command(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(milliseconds));
        child.kill().unwrap();
        child.wait().unwrap();
        if place.path("out").exists() {
            whole(&place);
            fs::remove_dir_all(place.path("out")).unwrap();
        }
    }
    sampled(&place, arguments);
    assert_eq!(names_in(&place, "out"), FILES);
}

/// Every file under its own name is complete.
fn whole(place: &Workplace) {
    for name in names_in(place, "out") {
        match name.as_str() {
            "run.json" | "summary.json" => {
                json(&place.read(&format!("out/{name}")));
            }
            "summary.csv" => assert_eq!(place.read("out/summary.csv").lines().count(), 1 + 54),
            "draws.csv" => assert_eq!(place.read("out/draws.csv").lines().count(), 1 + 200),
            "loo.csv" | "measurements.csv" | "rows.csv" => {
                assert_eq!(place.read(&format!("out/{name}")).lines().count(), 21);
            }
            "fields.vtp" => fields(&place.read("out/fields.vtp")),
            "field_draws.npz" => {
                let draws = eplat::report::FieldDraws::read(&place.path("out/field_draws.npz"));
                assert!(draws.unwrap().n_draws() > 0);
            }
            "model.rs" => assert_eq!(place.read("out/model.rs"), place.read("erp.rs")),
            "unknowns.npz" => {
                let bytes = fs::read(place.path("out/unknowns.npz")).unwrap();
                assert!(zip::ZipArchive::new(std::io::Cursor::new(bytes)).is_ok());
            }
            "report.html" => assert!(place.read("out/report.html").trim_end().ends_with("</html>")),
            "posterior.zarr" => drop(json(&place.read("out/posterior.zarr/zarr.json"))),
            "checkpoint" => {}
            other => assert!(other.starts_with('.'), "{other} is left over and not hidden"),
        }
    }
}

const MODEL: &str = include_str!("../models/erp.rs");

#[test]
fn an_edited_model_runs_without_a_compiler() {
    let place = Workplace::new();
    place.file("mine.rs", MODEL.replace("K = 24", "K = 20"));
    let without = |arguments: &str| place.command(arguments).env("PATH", "").output().unwrap();
    let shown = without("show mine.rs");
    assert!(shown.status.success(), "{}", text(&shown.stderr));
    assert_eq!(text(&shown.stderr), "");
    assert!(text(&shown.stdout).contains("20 modes") || text(&shown.stdout).contains("K = 20"));
    let run = without("run mine.rs --chains 2 --warmup 50 --draws 50 --out out");
    assert!(matches!(run.status.code(), Some(0 | 3)), "{}", text(&run.stderr));
    assert_eq!(json(&place.read("out/run.json"))["n_params"], 2 * (3 + 19));
    // what only a compiler understands is named
    place.file("mine.rs", MODEL.to_owned() + "\nstruct Mine;\n");
    let said = text(&without("show mine.rs").stderr);
    assert!(said.contains("help: install Rust (https://rustup.rs): `struct Mine` needs"), "{said}");
}

/// The text of a model that ships, changed in a comment, is evaluated as it is written. That it gives the same numbers to the
/// bit is seen of densities, gradients and Hessians in `gradient.rs`; here of all that a run leaves.
#[test]
fn a_model_as_written_leaves_what_the_compiled_one_leaves() {
    let place = Workplace::new().with_erp();
    place.file("mine.rs", format!("{MODEL}\n// mine\n"));
    for model in ["erp.rs", "mine.rs"] {
        let out = model.trim_end_matches(".rs");
        let run =
            place.eplat(&format!("run {model} --chains 2 --warmup 50 --draws 50 --out {out}"));
        assert!(matches!(run.status.code(), Some(0 | 3 | 4)), "{}", text(&run.stderr));
    }
    let mut compared = 0;
    for entry in std::fs::read_dir(place.path("erp")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        // records and pages tell times and the model's text
        let is_other = ["run.json", "report.html", "model.rs"].contains(&&*name);
        if is_other || place.path(&format!("erp/{name}")).is_dir() {
            continue;
        }
        let file = |out: &str| std::fs::read(place.path(&format!("{out}/{name}"))).unwrap();
        assert!(file("erp") == file("mine"), "{name}");
        compared += 1;
    }
    assert!(compared > 5, "{compared}");
}

#[test]
fn the_model_as_equations() {
    let place = Workplace::new().with_erp();
    insta::assert_snapshot!(text(&place.eplat("show erp.rs").stdout));
}

#[test]
fn the_help_of_every_command() {
    let place = Workplace::new();
    let commands = [
        "",
        "run",
        "show",
        "check",
        "import",
        "export",
        "mesh decimate",
        "loop",
        "compare",
        "report",
        "plot",
        "mesh",
        "mesh info",
        "mesh convert",
        "mesh repair",
        "mesh basis",
        "mesh sites",
        "mesh atrium",
        "simulate",
        "simulate strip",
        "simulate cell",
        "simulate atrium",
        "design next",
        "study",
        "study run",
        "study merge",
        "study plot",
        "study slurm",
        "surrogate",
        "surrogate design",
        "surrogate run",
        "surrogate fit",
        "surrogate sensitivity",
    ];
    let help = |command: &&str| {
        let output = place.eplat(&format!("{command} --help"));
        assert!(output.status.success(), "{command}: {}", text(&output.stderr));
        format!("$ eplat {command} --help\n{}", text(&output.stdout))
    };
    insta::assert_snapshot!(commands.iter().map(help).collect::<Vec<_>>().join("\n"));
}
