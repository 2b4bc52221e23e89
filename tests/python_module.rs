//! The installed Python package: its tests run where it is (`pip install .`), as CI does.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::path::{Path, PathBuf};
use std::process::Command;

use program::text;

/// A Python that has the package and what its tests need, or none.
fn python() -> Option<PathBuf> {
    // not the sources, which the tests' own folder could be taken for
    program::python(
        "import eplat._eplat, pytest, nbclient, arviz, pandas, pyvista",
        "eplat, pytest and nbclient",
    )
}

/// Runs the tests in a file of `tests/python/module`; pytest says which failed.
fn pytest(file: &str) {
    let Some(python) = python() else { return };
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = Command::new(python)
        .args(["-m", "pytest", "-q", "-p", "no:cacheprovider", "-rs"])
        .arg(root.join("tests/python/module").join(file))
        .env("EPLAT_CACHE", concat!(env!("CARGO_TARGET_TMPDIR"), "/cache"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .unwrap();
    let said = text(&output.stdout);
    assert!(output.status.success(), "{said}\n{}", text(&output.stderr));
    // a test that cannot run says why
    for line in said.lines().filter(|line| line.starts_with("SKIPPED")) {
        program::skipped::skipped(line);
    }
}

#[test]
fn runs() {
    pytest("test_run.py");
}

#[test]
fn errors_and_interruptions() {
    pytest("test_errors.py");
}

#[test]
fn work_in_memory() {
    pytest("test_memory.py");
}

#[test]
fn the_loop() {
    pytest("test_loop.py");
}

#[test]
fn the_package() {
    pytest("test_program.py");
}

#[test]
fn the_notebooks() {
    pytest("test_notebooks.py");
}
