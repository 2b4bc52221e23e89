//! `eplat run --laplace`: exact where the posterior is normal, like NUTS where it is nearly so, and said to be
//! useless where it is not.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;
mod support;

use std::fmt::Write as _;

use eplat::diagnostics::importance;
use eplat::infer::{Laplace, OptimumSettings, Settings, maximise};
use eplat::model::Model;
use nalgebra::{DMatrix, DVector};
use program::{Workplace, text};
use rand::RngExt;
use rand_distr::StandardNormal;
use serde_json::Value;
use support::{rng, table};

mod normal {
    use eplat::prelude::*;
    model! {
        model KnownSd;
        param mu ~ Normal(1.0, 1.5);
        observe y(row): Number ~ Normal(mu, 2.0);
    }
}

#[test]
fn the_evidence_of_a_normal_model_is_exact() {
    let y = [3.1, 0.4, 5.2, 2.9, 4.4];
    let data = table("y", &y.map(|y: f64| y.to_string()));
    let model = Model::new(&normal::KnownSd, None, &data).unwrap();
    let optimum = maximise(&model, &model.initial(), &OptimumSettings::default()).unwrap();
    let drawn = Laplace::at(&model, &optimum).unwrap().draws(&model, &Settings::default()).unwrap();
    let ratios: Vec<f64> = drawn.into_iter().flat_map(|d| d.log_ratios).collect();
    let found = importance(&ratios);
    // y ~ N(1, 4 I + 1.5² 1 1ᵀ)
    let covariance = DMatrix::from_element(5, 5, 2.25) + DMatrix::identity(5, 5) * 4.0;
    let away = DVector::from_row_slice(&y).add_scalar(-1.0);
    let square = (away.transpose() * covariance.clone().try_inverse().unwrap() * &away)[0];
    let exact = -0.5 * (square + covariance.determinant().ln() + 5.0 * std::f64::consts::TAU.ln());
    assert!((found.ln_mean - exact).abs() < 1e-6, "{} {exact}", found.ln_mean);
    assert!(found.ess > 3999.0 && found.pareto_k < 0.7, "{found:?}");
}

/// The number at `path` of a run's JSON.
fn number(run: &Value, path: &str) -> f64 {
    run.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path}: {run}"))
}

fn json(output: &std::process::Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", text(&output.stderr)))
}

/// A straight line in three covariates with noise 1.5, 60 rows.
fn regression_table() -> String {
    let mut rng = rng(3);
    let mut rows = "y,x1,x2,x3\n".to_owned();
    for _ in 0..60 {
        let [a, b, c, noise]: [f64; 4] = std::array::from_fn(|_| rng.sample(StandardNormal));
        let y = 2.0 + a - 2.0 * b + 0.5 * c + 1.5 * noise;
        writeln!(rows, "{y},{a},{b},{c}").unwrap();
    }
    rows
}

#[test]
fn a_regression_comes_out_as_from_nuts() {
    let place = Workplace::new();
    place.file("regression.rs", include_str!("../models/regression.rs"));
    place.file("table.csv", regression_table());
    let run = |how: &str| {
        let output = place.eplat(&format!("run regression.rs --data table.csv --json {how}"));
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        json(&output)
    };
    let (laplace, nuts) = (run("--laplace --out a"), run("--draws 4000 --out b"));
    assert!(!place.path("a/loo.csv").exists() && place.path("a/posterior.zarr").exists());
    let mut worst = 0f64;
    for name in ["intercept", "beta[0]", "beta[1]", "beta[2]", "sigma"] {
        let [a, b] = [&laplace, &nuts].map(|run| {
            ["mean", "sd", "mcse"].map(|figure| number(run, &format!("/summary/{name}/{figure}")))
        });
        worst = worst.max((a[0] - b[0]).abs() / a[2].hypot(b[2]));
        // The error of an sd is near that of the mean divided by √2; sigma has a longer tail.
        worst = worst.max((a[1] - b[1]).abs() / a[2].hypot(b[2]));
    }
    // Not corrected by their weights, the draws of such a table have the mean of sigma 0.46 sd off, over 15 errors.
    assert!(worst < 4.5, "{worst} Monte Carlo standard errors");
    assert!(number(&laplace, "/run/laplace/pareto_k") < 0.7);
    // Weights of unequal size: fewer draws' worth than there are, and an evidence with an error.
    assert!((1000.0..4000.0).contains(&number(&laplace, "/run/laplace/ess")));
    assert!(number(&laplace, "/run/laplace/ln_evidence_se") > 0.0);
}

#[test]
fn a_funnel_is_not_to_be_trusted() {
    let place = Workplace::new();
    place.file("schools.rs", include_str!("../models/eight_schools.rs"));
    place.file("schools.csv", include_str!("../models/eight_schools.csv"));
    let output = place.eplat("run schools.rs --data schools.csv --laplace");
    assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("Not to be trusted: "), "{}", text(&output.stdout));
    let again = place.eplat("report out/schools-laplace");
    assert_eq!(again.status.code(), Some(3));

    // Centred, its density has no mode: it grows without bound as tau shrinks.
    let centred = include_str!("../models/eight_schools.rs")
        .replace("param z(school) ~ Normal(0.0, 1.0);", "param z(school) ~ Normal(mu, tau);")
        .replace("let theta(row) = mu + tau * z(row);", "let theta(row) = z(row);");
    place.file("centred.rs", centred);
    let output = place.eplat("run centred.rs --data schools.csv --laplace");
    assert_eq!(output.status.code(), Some(1));
    let said = text(&output.stderr);
    assert!(said.contains("error: no mode reached") && said.contains("help: sample"), "{said}");
}
