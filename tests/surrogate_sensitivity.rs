//! Sensitivity indices of stored strip simulations against pygam's on the same rows.
//!
//! `tests/tables/sensitivity_500.csv` was made by
//! `eplat surrogate design --vary all --n 500 --seed 1` and `eplat surrogate run`, of which seven columns are kept;
//! pygam's figures by `tests/python/pygam_indices.py`.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

use std::path::{Path, PathBuf};
use std::process::Command;

use eplat::ep::table::read_rows;
use eplat::surrogate::{OutcomeSensitivity, SensitivityRow, analyse};

fn table() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tables/sensitivity_500.csv")
}

/// Rows, effective degrees of freedom and indices of `cv_max`, `tau_in`, `tau_out`, `tau_open`, `apd_max` by pygam 0.12.0.
const PYGAM: [(&str, usize, f64, [f64; 5]); 2] = [
    ("ERP_S2", 279, 8.513, [0.01766, 0.23667, 0.33436, 0.00859, 0.96650]),
    ("ERP_S3", 241, 14.511, [0.02312, 0.10200, 0.76859, 0.06883, 0.24940]),
];

#[test]
fn additive_indices_are_pygams() {
    let rows: Vec<SensitivityRow> =
        read_rows(&table()).unwrap().into_iter().map(|(_, row)| row).collect();
    let result = analyse(&rows, 280.0).unwrap();
    assert_eq!(result.inputs, [0, 1, 2, 3, 4]);
    assert_eq!(result.outcomes.len(), 2, "the table has two outcomes");
    for (outcome, (name, n, degrees, indices)) in result.outcomes.iter().zip(PYGAM) {
        assert_eq!((outcome.name, outcome.gam.n_points), (name, n));
        println!("{name}: {:?}", outcome.gam.smooths.iter().map(|s| s.index).collect::<Vec<_>>());
        assert!((outcome.gam.degrees_of_freedom - degrees).abs() < 1e-3, "{:?}", outcome.gam);
        for (smooth, index) in outcome.gam.smooths.iter().zip(indices) {
            assert!((smooth.index - index).abs() < 2e-5, "{name}: {} {index}", smooth.index);
        }
        // what is caused alone is at most what is caused in all
        for s in &outcome.sobol {
            assert!(s.first.value < s.total.value + 4.5 * (s.first.error + s.total.error));
        }
    }
    // over the whole ranges tau_out and apd_max determine ERP_S2, as the paper says; over the short apd_max that keeps
    // ERP_S3 from being void, tau_out does
    let [s2, s3] = [0, 1].map(|i| &result.outcomes[i]);
    let total = |outcome: &OutcomeSensitivity, i: usize| outcome.sobol[i].total.value;
    assert!((s2.sobol_box[4].1 - 270.0).abs() < 1e-9 && s3.sobol_box[4].1 < 200.0);
    assert!(
        total(s2, 4) > 0.5
            && [0, 1, 3].iter().all(|&i| total(s2, 2) + total(s2, 4) > 3.0 * total(s2, i))
    );
    assert!([0, 3, 4].iter().all(|&i| total(s3, 2) > 3.0 * total(s3, i)));
}

#[test]
fn the_command_prints_tables_and_draws_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_eplat"))
        .args(["surrogate", "sensitivity", "--out", "s.csv", "--figure", "s.svg", "--table"])
        .arg(table())
        .current_dir(folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    assert!(said.contains("ERP_S2 additive") && said.contains("without ERP_S2"), "{said}");
    let csv = std::fs::read_to_string(folder.path().join("s.csv")).unwrap();
    assert!(csv.starts_with("output,input,gam_index,sobol_first,"), "{csv}");
    assert_eq!(csv.lines().count(), 1 + 2 * 5);
    let svg = std::fs::read_to_string(folder.path().join("s.svg")).unwrap();
    assert!(svg.starts_with("<svg xmlns") && svg.trim_end().ends_with("</svg>"));
}
