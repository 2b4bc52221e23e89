//! The leave-one-out figures of a run are those that ArviZ makes from the same run's draws.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::path::{Path, PathBuf};
use std::process::Command;

/// A Python with ArviZ of at least 1, or none.
fn python() -> Option<PathBuf> {
    let named = std::env::var_os("EPLAT_PYTHON").map(PathBuf::from);
    let usual = ["python3.13", "python3.12", "python3"].map(PathBuf::from);
    let test = "import sys, arviz; sys.exit(int(arviz.__version__[0]) < 1)";
    let fits = |python: &PathBuf| {
        Command::new(python).args(["-c", test]).output().is_ok_and(|output| output.status.success())
    };
    named.into_iter().chain(usual).find(fits)
}

#[test]
fn a_run_and_arviz_agree() {
    let Some(python) = python() else {
        println!("no Python with ArviZ >= 1 found (EPLAT_PYTHON): skipped");
        return;
    };
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let out = tempfile::tempdir().unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_eplat"))
        .arg("run")
        .arg(root.join("models/erp.rs"))
        .args(["--warmup", "200", "--draws", "200", "--out"])
        .arg(out.path())
        .output()
        .unwrap();
    assert!(matches!(run.status.code(), Some(0 | 3)), "{run:?}");
    let script = root.join("tests/python/check_loo.py");
    let checked = Command::new(python).arg(script).arg(out.path()).output().unwrap();
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
}
