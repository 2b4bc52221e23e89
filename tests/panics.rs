//! A function of a model's file may panic: the program says where and ends with a code of its own.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use program::{Workplace, text};

const MODEL: &str = "use eplat::prelude::*;

/// Ends the program.
fn broken<D: Real>(x: D) -> D {
    let none: Option<D> = None;
    x * none.expect(\"there is nothing here\")
}

model! {
    model Broken;
    param mean [ms] ~ Normal(10.0, 2.0);
    let shifted(row) [ms] = broken(mean);
    observe y(row): Number [ms] ~ Normal(shifted(row), 1.0);
}
";

#[test]
fn a_panic_in_a_model_is_told_with_its_place() {
    let place = Workplace::new();
    place.file("broken.rs", MODEL);
    place.file("table.csv", "y\n1\n2\n");
    let output = place.eplat("run broken.rs --data table.csv --out out");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(70), "{said}");
    assert!(said.contains("error: a panic at "), "{said}");
    assert!(
        said.contains("broken.rs:6: there is nothing here\nhelp: if this is in your model's file"),
        "{said}"
    );
    assert!(!said.contains("RUST_BACKTRACE") && !said.contains("thread '"), "{said}");
    assert!(!place.path("out/run.json").exists());
}
