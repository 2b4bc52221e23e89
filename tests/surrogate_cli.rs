//! The commands that make the surrogate, run as a user runs them, and the files they made.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// The table from which the committed coefficients were fitted.
const COMMITTED_TABLE: &str =
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/engine/src/surrogate/erp_design.csv"));

fn eplat(folder: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_eplat"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .unwrap()
}

fn succeed(folder: &Path, arguments: &str) {
    let output = eplat(folder, arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Standard error of a command that must fail with exit code 1.
fn fail(folder: &Path, arguments: &str) -> String {
    let output = eplat(folder, arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments}");
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn the_committed_table_is_what_the_commands_make() {
    let folder = tempfile::tempdir().unwrap();
    succeed(folder.path(), "surrogate design --n 100 --seed 1 --out design.csv");
    let design = fs::read_to_string(folder.path().join("design.csv")).unwrap();
    let inputs = COMMITTED_TABLE.lines().skip(1).map(|line| {
        let cells: Vec<&str> = line.split(',').skip(1).take(5).collect();
        cells.join(",")
    });
    assert!(design.lines().skip(1).eq(inputs));

    // Five rows stand for the hundred: the simulator is the same.
    let first: Vec<&str> = design.lines().take(6).collect();
    fs::write(folder.path().join("first.csv"), first.join("\n")).unwrap();
    succeed(folder.path(), "surrogate run --design first.csv --out table.csv");
    let table = fs::read_to_string(folder.path().join("table.csv")).unwrap();
    assert!(table.lines().eq(COMMITTED_TABLE.lines().take(6)));
}

#[test]
fn fitting_writes_coefficients_as_csv_and_reports_the_fit() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("table.csv"), COMMITTED_TABLE).unwrap();
    let output = eplat(folder.path(), "surrogate fit --table table.csv --out c.csv");
    let report = String::from_utf8(output.stderr).unwrap();
    assert!(report.contains("ERP_S2: 63 used, residual RMSE 0.460 ms"), "{report}");
    let text = fs::read_to_string(folder.path().join("c.csv")).unwrap();
    assert!(text.starts_with("term,erp_s2,erp_s3\n1,"));
    assert_eq!(text.lines().count(), 11);
}

#[test]
fn bad_input_is_named_and_nothing_is_left_behind() {
    let folder = tempfile::tempdir().unwrap();
    let header = "cv_max_m_per_s,tau_in_ms,tau_out_ms,tau_open_ms,apd_max_ms\n";
    fs::write(folder.path().join("bad.csv"), format!("{header}0.7,0.05,10,120,2000\n")).unwrap();
    fs::write(folder.path().join("good.csv"), format!("{header}0.7,0.05,10,120,200\n")).unwrap();
    let at = folder.path();

    let missing = fail(at, "simulate strip --params none.csv --out o.csv");
    assert!(missing.contains("cannot read none.csv") && missing.contains("help:"), "{missing}");
    let width = fail(at, "simulate strip --params good.csv --out o.csv --width 0.5");
    assert!(width.contains("--width 0.5 is no multiple of the spacing 0.3"), "{width}");
    let across = fail(at, "simulate strip --params good.csv --out o.csv --width 0.9");
    assert!(across.contains("a strip of 4 nodes across cannot be simulated"), "{across}");
    let nowhere = fail(at, "simulate strip --params good.csv --out no/such/o.csv");
    assert!(nowhere.contains("cannot write no/such/o.csv"), "{nowhere}");
    let column = fail(at, "surrogate fit --table good.csv --out o.csv");
    assert!(column.contains("good.csv has no column erp_s2_ms"), "{column}");
    assert_eq!(fs::read_dir(at).unwrap().count(), 2, "only the two inputs are there");
}

#[test]
fn a_set_out_of_range_is_a_labelled_absence_among_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let table = "cv_max_m_per_s,tau_in_ms,tau_out_ms,tau_open_ms,apd_max_ms\n\
                 0.7,0.05,10,120,2000\n0.7,0.05,10,120,200\n";
    fs::write(folder.path().join("in.csv"), table).unwrap();
    let quick = "--beats 1 --cable --restitution curves.csv";
    succeed(folder.path(), &format!("simulate strip --params in.csv --out o.csv {quick}"));
    let text = fs::read_to_string(folder.path().join("o.csv")).unwrap();
    let rows: Vec<&str> = text.lines().collect();
    let reason = "apd_max = 2000 ms is outside its valid range 120 to 270 ms";
    assert!(rows[1].ends_with(&format!(",,,,{reason},{reason}")), "{}", rows[1]);
    assert!(rows[2].ends_with(",,") && !rows[2].contains(",,,"), "{}", rows[2]);
    let curves = fs::read_to_string(folder.path().join("curves.csv")).unwrap();
    assert_eq!(curves.lines().filter(|line| line.starts_with("1,")).count(), 21);
}

#[test]
fn an_empty_design_is_a_usage_error() {
    let folder = tempfile::tempdir().unwrap();
    let output = eplat(folder.path(), "surrogate design --n 0 --out d.csv");
    assert_eq!(output.status.code(), Some(2));
}
