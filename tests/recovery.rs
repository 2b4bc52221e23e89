//! The default experiment: what `eplat run models/erp.rs` finds, against its known truth.
//!
//! Medians are held to three Monte Carlo standard errors of a difference from those of one run, so that another
//! correct sampler, or a processor whose linear algebra has other last bits, passes; the snapshot holds errors.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::fmt::Write as _;

use program::{Workplace, text};
use serde_json::Value;

/// Medians of seed 1.
const MEDIANS: [(&str, f64); 6] = [
    ("tau_out.m", 10.77),
    ("tau_out.alpha", 2.43),
    ("tau_out.rho", 22.8),
    ("apd_max.m", 205.3),
    ("apd_max.alpha", 13.55),
    ("apd_max.rho", 52.2),
];

#[test]
fn the_default_experiment_is_recovered() {
    let place = Workplace::new().with_erp();
    let output = place.eplat("run erp.rs --json");
    let said = text(&output.stderr);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{said}");
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    let run = &result["run"];
    assert!(run["max_r_hat"].as_f64().unwrap() <= 1.02, "{}", result["verdict"]);

    let mut lines = String::new();
    for (quantity, expected) in MEDIANS {
        let number = |name: &str| result["summary"][quantity][name].as_f64().unwrap();
        let (median, tolerance) = (number("q50"), 3.0 * 2_f64.sqrt() * number("mcse_q50"));
        assert!(
            (median - expected).abs() < tolerance,
            "{quantity}: median {median}, {expected} ± {tolerance} expected"
        );
    }
    // 12 ms of ERP is what is asked of this design; for the parameters, three quarters of the truth's own
    // standard deviation over the surface (6.2 and 32.9 ms), which is the error of a constant field
    for (field, most) in [("erp_s2", 12.0), ("erp_s3", 12.0), ("tau_out", 4.6), ("apd_max", 24.7)] {
        let rmse = run["rmse"][field].as_f64().unwrap();
        assert!(rmse < most, "{field}: RMSE {rmse} ms against the truth, at most {most} expected");
        writeln!(lines, "{field:<14} RMSE {} ms (to 1)", rmse.round()).unwrap();
    }
    insta::assert_snapshot!(lines);
}
