//! ArviZ opens and uses what real runs leave, with fields and without, and finds the same leave-one-out figures.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::path::{Path, PathBuf};
use std::process::Command;

use program::{Workplace, text};

/// A Python with ArviZ of at least 1, or none.
fn python() -> Option<PathBuf> {
    program::python("import sys, arviz; sys.exit(int(arviz.__version__[0]) < 1)", "ArviZ >= 1")
}

/// Runs `arguments` into `out`, and the scripts of `tests/python` on what that leaves.
fn used_by_arviz(place: &Workplace, arguments: &str) {
    let Some(python) = python() else { return };
    let run = place.eplat(&format!("run {arguments} --warmup 200 --draws 200 --out out"));
    assert!(matches!(run.status.code(), Some(0 | 3)), "{}", text(&run.stderr));
    let scripts = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python");
    for (script, file) in [("check_loo.py", "out"), ("check_zarr.py", "out/posterior.zarr")] {
        let checked =
            Command::new(&python).arg(scripts.join(script)).arg(place.path(file)).output().unwrap();
        assert!(checked.status.success(), "{script}: {}", text(&checked.stderr));
    }
}

#[test]
fn a_run_with_fields() {
    used_by_arviz(&Workplace::new().with_erp(), "erp.rs");
}

#[test]
fn a_run_without_fields() {
    let place = Workplace::new();
    place.file("schools.rs", include_str!("../models/eight_schools.rs"));
    place.file("schools.csv", include_str!("../models/eight_schools.csv"));
    used_by_arviz(&place, "schools.rs --data schools.csv");
}
