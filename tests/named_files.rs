//! Every file that a command leaves in its folder is named in its record, with its hash; and who reads one makes sure
//! that it is the one that the record names.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;
#[path = "support/sheet.rs"]
mod sheet;
#[path = "support/sphere.rs"]
mod sphere;

use std::fmt::Write as _;
use std::fs;

use eplat::store::seal_of;
use program::{Workplace, text};
use serde_json::Value;

const SMALL: &str = "run erp --chains 2 --warmup 60 --draws 60";

fn succeeds(place: &Workplace, arguments: &str) {
    let output = place.eplat(arguments);
    assert!(
        matches!(output.status.code(), Some(0 | 3 | 4)),
        "{arguments}: {}",
        text(&output.stderr)
    );
}

/// The record in a folder names what else is there, but for `folders`, which have records of their own or of which it
/// names the files.
fn names_all(place: &Workplace, folder: &str, record: &str, folders: &[&str]) {
    let read: Value = serde_json::from_str(&place.read(&format!("{folder}/{record}"))).unwrap();
    let files = read["files"].as_object().unwrap_or_else(|| panic!("{folder}/{record}: no files"));
    let mut there: Vec<String> = fs::read_dir(place.path(folder))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name != record && !folders.contains(&name.as_str()))
        .collect();
    there.sort();
    let mut named: Vec<&String> = files.keys().filter(|name| !name.contains('/')).collect();
    named.sort();
    assert_eq!(named, there.iter().collect::<Vec<_>>(), "{folder}");
    for (name, hash) in files {
        let found = seal_of(&place.path(folder).join(name)).unwrap();
        assert_eq!(hash.as_str(), Some(found.as_str()), "{folder}/{name}");
    }
}

#[test]
fn a_record_names_every_file_of_its_folder() {
    let place = Workplace::new();
    sheet::write(&place.path("sheet.vtp"));
    succeeds(&place, &format!("{SMALL} --out run"));
    names_all(&place, "run", "run.json", &[]);
    // a run without a surface into the folder of the first
    place.file("schools.csv", include_str!("../models/eight_schools.csv"));
    let schools =
        "run eight_schools --data schools.csv --prior --chains 2 --draws 60 --out run --force";
    succeeds(&place, schools);
    names_all(&place, "run", "run.json", &[]);
    succeeds(&place, "run erp --optimize --out mode");
    names_all(&place, "mode", "map.json", &[]);
    let experiment =
        "study experiment --skip-simulation --chains 2 --warmup 100 --draws 60 --out experiment";
    succeeds(&place, experiment);
    names_all(&place, "experiment", "experiment.json", &["run"]);
    names_all(&place, "experiment/run", "run.json", &[]);
    sphere::write(&place.path("sphere.vtk"));
    let simulated = "study experiment --mesh sphere.vtk --units mm --lengthscale 12 --sites 5 --chains 2 --warmup 60 \
                     --draws 40 --beats 1 --out simulated";
    succeeds(&place, simulated);
    names_all(&place, "simulated", "experiment.json", &["run", "simulation"]);
    let record: Value = serde_json::from_str(&place.read("simulated/experiment.json")).unwrap();
    assert!(record["files"]["simulation/tissue.vtp"].is_string());
    assert_eq!(fs::read_dir(place.path("simulated/simulation")).unwrap().count(), 3);
    for which in ["true", "mean"] {
        names_all(&place, &format!("simulated/simulation/{which}"), "simulation.json", &[]);
    }

    let atrium = "simulate atrium --fields sheet.vtp --units mm --refine 1 --tau-out 8 --apd-max 200 --pace 0 --beats 1 \
                  --last 100 --out atrium";
    succeeds(&place, &format!("{atrium} --snapshots 20"));
    names_all(&place, "atrium", "simulation.json", &[]);
    assert!(place.path("atrium/voltage.pvd").exists());
    succeeds(&place, atrium);
    names_all(&place, "atrium", "simulation.json", &[]);
    assert!(!place.path("atrium/voltage.pvd").exists());
    // files of a user's are no simulation
    place.file("mine/beat.vtp", "mine");
    let refused = place.eplat(&atrium.replace("--out atrium", "--out mine"));
    assert!(text(&refused.stderr).contains("mine/beat.vtp is of no simulation of eplat"));
    assert_eq!(place.read("mine/beat.vtp"), "mine");
}

#[test]
fn what_is_made_of_a_run_is_named_too() {
    let place = Workplace::new().with_erp();
    for run in ["one", "other"] {
        let seed = run.len();
        succeeds(
            &place,
            &format!("run erp --chains 2 --warmup 300 --draws 200 --seed {seed} --out {run}"),
        );
    }
    for _ in 0..2 {
        succeeds(&place, "predict one one/measurements.csv --out predicted");
        names_all(&place, "predicted", "predictions.json", &[]);
    }
    // a posterior may leave the ranges of what is simulated
    let exported = place.eplat("export --run one --draws 2 --out carp");
    let said = text(&exported.stdout);
    assert!(said.contains("outside its range: it is the nearest in it"), "{said}");
    names_all(&place, "carp", "export.json", &[]);
    succeeds(
        &place,
        "simulate atrium --run one --refine 0 --pace 0 --beats 1 --last 20 --out beat",
    );
    let n_pictures = |only: &str| {
        succeeds(&place, &format!("plot {only} --out pictures"));
        names_all(&place, "pictures", "figures.json", &[]);
        fs::read_dir(place.path("pictures")).unwrap().count() - 1
    };
    let n_predicted = n_pictures("one --only predicted");
    let n_both = n_pictures("one --only traces");
    assert!(n_both > n_predicted && n_predicted > 0);
    let edited = fs::read_dir(place.path("pictures"))
        .unwrap()
        .map(|entry| format!("pictures/{}", entry.unwrap().file_name().into_string().unwrap()))
        .find(|name| name.contains("predicted") && name.contains(".svg"))
        .unwrap();
    place.file(&edited, "edited by hand");
    // those of another run take the place of all that nobody has changed
    succeeds(&place, "plot other --only traces --out pictures");
    assert_eq!(place.read(&edited), "edited by hand");
    let refused = place.eplat("plot other --only predicted --out pictures");
    let said = text(&refused.stderr);
    assert!(said.contains(&format!("{edited} is of no run of eplat")), "{said}");
    assert_eq!(place.read(&edited), "edited by hand");
    fs::remove_file(place.path(&edited)).unwrap();
    assert_eq!(n_pictures("other --only traces"), n_both - n_predicted);
}

#[test]
fn studies_imports_and_cells_are_named_too() {
    let place = Workplace::new().with_erp();
    let plan = "model = \"erp.rs\"\nlengthscales = [64.0]\nsites = [5, 10]\nresolutions = [10.0]\nfields = 1\ndesigns = 1\n\
                warmup = 60\ndraws = 60\n";
    place.file("plan.toml", plan);
    // what is complete is named again
    for command in ["slurm plan.toml", "run plan.toml", "run plan.toml", "merge plan.toml"] {
        succeeds(&place, &format!("study {command} --out study"));
        if !command.starts_with("slurm") {
            names_all(&place, "study", "study.json", &[]);
        }
    }
    sheet::write(&place.path("sheet.vtp"));
    place.file("log.csv", "site,x,y,z,s1,s2,captured\na,1,1,0,600,260,yes\na,1,1,0,600,250,no\n");
    succeeds(&place, "import log.csv --mesh sheet.vtp --units mm --out study_in");
    names_all(&place, "study_in", "import.json", &[]);
    for _ in 0..2 {
        succeeds(&place, "simulate cell --beats 1 --out cell");
        names_all(&place, "cell", "cell.json", &[]);
    }
    place.file("mine/trace.csv", "mine");
    let refused = place.eplat("simulate cell --beats 1 --out mine");
    assert!(text(&refused.stderr).contains("mine/trace.csv"), "{}", text(&refused.stderr));
    assert_eq!(place.read("mine/trace.csv"), "mine");
}

#[test]
fn a_loop_names_its_files_and_leaves_none_of_an_earlier_one() {
    let place = Workplace::new();
    sheet::write(&place.path("sheet.vtp"));
    for (name, effect) in [("with.csv", 6), ("without.csv", 0)] {
        let mut table = "site,vertex,protocol,lower,upper,force_g\n".to_owned();
        for v in (0..sheet::N).step_by(3) {
            let force = v * 13 % 7;
            let lower = 10 * (9 + effect * force / 2 + v % 2);
            let _ = writeln!(table, "{v},{v},S1S2,{lower},{},{force}", lower + 10);
        }
        place.file(name, table);
    }
    let close = |table: &str| {
        succeeds(
            &place,
            &format!(
                "loop recovery --mesh sheet.vtp --units mm --data {table} --nulls 19 --out loop --force"
            ),
        );
        names_all(&place, "loop", "finding.json", &["declared", "before", "after"]);
        names_all(&place, "loop/declared", "run.json", &[]);
    };
    close("with.csv");
    let written = || {
        let paths = fs::read_dir(place.path("loop")).unwrap().map(|entry| entry.unwrap().path());
        paths.filter(|path| path.extension().is_some_and(|e| e == "rs")).count()
    };
    assert_eq!(written(), 1, "an effect was found");
    close("without.csv");
    assert_eq!(written(), 0, "the model of the earlier loop is left");
}

#[test]
fn readers_refuse_a_file_that_is_not_the_run_s() {
    let place = Workplace::new();
    for out in ["a", "b"] {
        succeeds(&place, &format!("{SMALL} --out {out}"));
    }
    for (name, command) in [
        ("summary.json", "report a"),
        ("summary.json", "plot a --out plots"),
        ("loo.csv", "compare a b"),
        ("unknowns.npz", "predict a b/measurements.csv"),
        ("unknowns.npz", "run erp --chains 2 --warmup 60 --draws 60 --init a --out c"),
        ("rows.csv", "plot a --out plots"),
        ("fields.vtp", "simulate atrium --run a --pace 0 --beats 1 --last 50 --out atrium"),
    ] {
        let path = place.path(&format!("a/{name}"));
        let own = fs::read(&path).unwrap();
        let mut other = own.clone();
        let middle = other.len() / 2;
        other[middle] ^= 1;
        fs::write(&path, other).unwrap();
        let output = place.eplat(command);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{command}: {said}");
        let expected = format!(
            "error: a/{name} is not the file that this run left: its SHA-256 is not the one in a/run.json\nhelp: "
        );
        assert!(said.contains(&expected), "{command}: {said}");
        fs::write(&path, own).unwrap();
    }
    succeeds(&place, "report a");
    // a record from before there were names is content
    let mut record: Value = serde_json::from_str(&place.read("a/run.json")).unwrap();
    record.as_object_mut().unwrap().remove("files");
    place.file("a/run.json", record.to_string());
    succeeds(&place, "report a");
}
