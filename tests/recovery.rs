//! The default experiment: what `eplat run` finds of it with `models/erp.rs` and `models/erp_robust.rs`, against its
//! known truth.
//!
//! Medians are held to three Monte Carlo standard errors of a difference from those of one run, so that another
//! correct sampler, or a processor whose linear algebra has other last bits, passes; the snapshot holds errors.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::fmt::Write as _;

use program::{Workplace, text};
use serde_json::Value;

/// A hyperparameter and its median of seed 1.
type Median = (&'static str, f64);
/// A map and the most that its error may be, ms.
type Error = (&'static str, f64);

const ERP: [Median; 6] = [
    ("tau_out.m", 10.77),
    ("tau_out.alpha", 2.43),
    ("tau_out.rho", 22.8),
    ("apd_max.m", 205.3),
    ("apd_max.alpha", 13.55),
    ("apd_max.rho", 52.2),
];
const ERP_ROBUST: [Median; 7] = [
    ("tau_out.m", 11.48),
    ("tau_out.alpha", 6.88),
    ("tau_out.rho", 43.5),
    ("apd_max.m", 201.2),
    ("apd_max.alpha", 36.8),
    ("apd_max.rho", 60.1),
    ("discrepancy", 1.23),
];
/// 12 ms of ERP is what is asked of this design; for the parameters, three quarters of the truth's own
/// standard deviation over the surface (6.2 and 32.9 ms), which is the error of a constant field.
const ERRORS: [Error; 4] =
    [("erp_s2", 12.0), ("erp_s3", 12.0), ("tau_out", 4.6), ("apd_max", 24.7)];

/// The errors of the default experiment of this model file, once its medians and errors are what is expected.
fn recovered(place: &Workplace, file: &str, medians: &[Median]) -> String {
    let output = place.eplat(&format!("run {file} --json"));
    let said = text(&output.stderr);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{said}");
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    let run = &result["run"];
    assert!(run["max_r_hat"].as_f64().unwrap() <= 1.02, "{}", result["verdict"]);

    let mut lines = String::new();
    for (quantity, expected) in medians {
        let number = |name: &str| result["summary"][quantity][name].as_f64().unwrap();
        let (median, tolerance) = (number("q50"), 3.0 * 2_f64.sqrt() * number("mcse_q50"));
        assert!(
            (median - expected).abs() < tolerance,
            "{quantity}: median {median}, {expected} ± {tolerance} expected"
        );
    }
    for (field, most) in ERRORS {
        let rmse = run["rmse"][field].as_f64().unwrap();
        assert!(rmse < most, "{field}: RMSE {rmse} ms against the truth, at most {most} expected");
        writeln!(lines, "{field:<14} RMSE {} ms (to 1)", rmse.round()).unwrap();
    }
    lines
}

#[test]
fn the_default_experiment_is_recovered() {
    let place = Workplace::new().with_erp();
    insta::assert_snapshot!(recovered(&place, "erp.rs", &ERP));
}

#[test]
fn the_default_experiment_is_recovered_by_the_robust_model() {
    let place = Workplace::new();
    place.file("erp_robust.rs", include_str!("../models/erp_robust.rs"));
    insta::assert_snapshot!(recovered(&place, "erp_robust.rs", &ERP_ROBUST));
}
