//! What a run leaves opens in the programs that it is written for, ArviZ and PyVista, with the numbers that were
//! written; groups that contradict themselves are refused.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

#[path = "support/skipped.rs"]
mod skipped;

use eplat::mesh::{TriMesh, write_vtp};
use eplat::report::{Group, ReportError, Values, Variable, write_zarr};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::process::Command;

const N_CHAINS: usize = 4;
const N_DRAWS: usize = 200;

/// Two parameters, one with sites, and the groups that a run writes, from a seeded stream.
fn run() -> Vec<Group> {
    let stream = &mut ChaCha8Rng::seed_from_u64(1);
    let scalar = [("chain", N_CHAINS), ("draw", N_DRAWS)];
    let per_site = [("chain", N_CHAINS), ("draw", N_DRAWS), ("site", 3)];
    let n_scalar = N_CHAINS * N_DRAWS;
    let mut uniform = |n: usize, low: f64, high: f64| -> Vec<f64> {
        (0..n).map(|_| low + (high - low) * stream.random::<f64>()).collect()
    };
    let group = |name: &str, variables: Vec<Variable>| Group { name: name.to_owned(), variables };
    let sites = Variable::new(
        "site",
        "",
        &[("site", 3)],
        ["roof", "appendage", "Östra"].map(str::to_owned).to_vec(),
    );
    let stat = |name: &str, values: Vec<f64>| Variable::new(name, "", &scalar, values);
    let integer = |name: &str| Variable::new(name, "", &scalar, vec![5_i64; n_scalar]);
    let diverging: Vec<bool> = (0..n_scalar).map(|i| i % 50 == 0).collect();
    vec![
        group(
            "posterior",
            vec![
                Variable::new("tau_out.rho", "mm", &scalar, uniform(n_scalar, 20.0, 90.0)),
                Variable::new("tau_out.alpha", "ms", &scalar, uniform(n_scalar, 1.0, 4.0)),
                Variable::new("tau_out_at", "ms", &per_site, uniform(3 * n_scalar, 1.0, 30.0)),
                sites.clone(),
            ],
        ),
        group(
            "sample_stats",
            vec![
                stat("lp", uniform(n_scalar, -9.0, -1.0)),
                stat("energy", uniform(n_scalar, 1.0, 9.0)),
                stat("acceptance_rate", uniform(n_scalar, 0.0, 1.0)),
                stat("step_size", vec![0.25; n_scalar]),
                Variable::new("diverging", "", &scalar, diverging),
                integer("tree_depth"),
                integer("n_steps"),
            ],
        ),
        group(
            "log_likelihood",
            vec![
                Variable::new("s1s2", "", &per_site, uniform(3 * n_scalar, -3.0, -2.0)),
                sites.clone(),
            ],
        ),
        group(
            "posterior_predictive",
            vec![
                Variable::new("s1s2", "ms", &per_site, uniform(3 * n_scalar, 200.0, 280.0)),
                sites.clone(),
            ],
        ),
        group(
            "observed_data",
            vec![Variable::new("s1s2", "ms", &[("site", 3)], vec![215.0, 225.0, 235.0]), sites],
        ),
        group("constant_data", vec![Variable::new("n_modes", "", &[], vec![24_i64])]),
        group(
            "fields",
            vec![Variable::new("tau_out_mean", "ms", &[("vertex", 40)], uniform(40, 1.0, 30.0))],
        ),
    ]
}

fn attributes() -> Map<String, Value> {
    json!({ "inference_library": "eplat" }).as_object().unwrap().clone()
}

/// A Python of at least 3.12 with ArviZ of at least 1 and PyVista, or none.
fn python() -> Option<PathBuf> {
    let named = std::env::var_os("EPLAT_PYTHON").map(PathBuf::from);
    let usual = ["python3.13", "python3.12", "python3"].map(PathBuf::from);
    let test = "import sys, arviz, pyvista; sys.exit(sys.version_info < (3, 12) or int(arviz.__version__[0]) < 1)";
    let fits = |python: &PathBuf| {
        Command::new(python).args(["-c", test]).output().is_ok_and(|output| output.status.success())
    };
    if let Some(python) = named {
        assert!(fits(&python), "EPLAT_PYTHON={} lacks arviz >= 1 or pyvista", python.display());
        return Some(python);
    }
    let found = usual.into_iter().find(fits);
    if found.is_none() {
        skipped::skipped(
            "no Python >= 3.12 with tests/python/requirements.txt found (EPLAT_PYTHON)",
        );
    }
    found
}

/// What a script of `tests/python` prints; fails with its output if it fails.
fn script_output(python: &Path, script: &str, file: &Path, arguments: &[&str]) -> String {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python").join(script);
    let output = Command::new(python).arg(script).arg(file).args(arguments).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    text
}

#[test]
fn pyvista_opens_the_fields() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fields.vtp");
    let corners = vec![[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]];
    let tetrahedron = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
    let mesh = TriMesh::new(corners, tetrahedron).unwrap();
    let values = [1.25, 2.5, f64::NAN, -3.5];
    write_vtp(&path, &mesh, &[("tau_out_mean", &values)]).unwrap();
    let text = script_output(&python, "check_vtp.py", &path, &["tau_out_mean"]);
    assert!(text.contains("4 points, 4 cells\ntau_out_mean: -3.5 to 2.5, 1 NaN\nok"), "{text}");
}

#[test]
fn arviz_opens_the_draws() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("posterior.zarr");
    let groups = run();
    write_zarr(&path, &groups, &attributes()).unwrap();
    let text = script_output(&python, "check_zarr.py", &path, &[]);
    for variable in &groups[0].variables[..3] {
        let Values::Float(values) = &variable.values else { panic!("not floats") };
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let start = format!("mean {} ", variable.name);
        let line = text.lines().find_map(|line| line.strip_prefix(&start)).expect("a mean");
        let (read, unit) = line.split_once(' ').unwrap();
        assert!((read.parse::<f64>().unwrap() / mean - 1.0).abs() < 1e-12, "{line} but {mean}");
        assert_eq!(unit, variable.unit);
    }
}

/// The bytes of every file below `folder` by relative path.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = std::fs::read(&path).unwrap();
                found.push((path.strip_prefix(folder).unwrap().to_owned(), bytes));
            }
        }
    }
    found.sort();
    found
}

#[test]
fn the_same_groups_give_the_same_bytes_also_over_an_old_folder() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = ["first.zarr", "second.zarr"].map(|name| folder.path().join(name));
    write_zarr(&first, &run(), &attributes()).unwrap();
    write_zarr(&second, &run()[..1], &attributes()).unwrap();
    write_zarr(&second, &run(), &attributes()).unwrap();
    let files = contents(&first);
    assert!(files.iter().any(|(path, _)| path.ends_with("posterior/tau_out.rho/c.3.0")));
    assert!(files == contents(&second), "the two folders differ");
}

#[test]
fn a_folder_of_the_user_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("thesis.tex"), "").unwrap();
    let refused = write_zarr(folder.path(), &run(), &attributes());
    assert!(matches!(refused, Err(ReportError::Occupied { .. })), "{refused:?}");
    assert!(folder.path().join("thesis.tex").exists());
}

#[test]
fn groups_that_contradict_themselves_are_refused() {
    let vector = |name: &str, n: usize, values: usize| {
        Variable::new(name, "ms", &[("site", n)], vec![0.0; values])
    };
    let cases = [
        vec![vector("a", 3, 2)],
        vec![vector("a", 3, 3), vector("b", 4, 4)],
        vec![vector("a", 3, 3), vector("a", 3, 3)],
        vec![Variable::new("a", "", &[("../a", 3)], vec![0.0; 3])],
        vec![Variable::new("site", "", &[("site", 1), ("draw", 1)], vec![0.0])],
        vec![Variable::new("covariance", "", &[("row", 1), ("row", 1)], vec![0.0])],
    ];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("posterior.zarr");
    let texts = cases.map(|variables| {
        let group = Group { name: "posterior".to_owned(), variables };
        write_zarr(&path, &[group], &Map::new()).unwrap_err().to_string()
    });
    assert!(!path.exists());
    insta::assert_snapshot!(texts.join("\n\n"), @r#"
    variable a: its dimensions [("site", 3)] need 3 values, got 2
    help: give one value per cell, row-major

    group posterior: dimension site has length 3 but also 4
    help: give the two different names

    group posterior: the name "a" is empty, hidden, not one folder, or used twice
    help: names are unique within a group, without / and without a leading dot or underscores

    group posterior: the name "../a" is empty, hidden, not one folder, or used twice
    help: names are unique within a group, without / and without a leading dot or underscores

    group posterior: the name "site" is empty, hidden, not one folder, or used twice
    help: names are unique within a group, without / and without a leading dot or underscores

    group posterior: the name "row" is empty, hidden, not one folder, or used twice
    help: names are unique within a group, without / and without a leading dot or underscores
    "#);
}
