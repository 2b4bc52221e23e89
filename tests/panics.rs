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
fn a_function_without_end_is_told_too() {
    let place = Workplace::new();
    let endless = "if x.re() < 1e300 { broken(x + 1.0) - x.sqrt() } else { x }";
    let (head, tail) = MODEL.split_once("    let none").unwrap();
    let (_, tail) = tail.split_once("\n}").unwrap();
    place.file("endless.rs", format!("{head}    {endless}\n}}{tail}"));
    place.file("table.csv", "y\n1\n2\n");
    let output = place.eplat("run endless.rs --data table.csv --out out");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(70), "{said}");
    assert!(said.contains("has overflowed its stack"), "{said}");
}

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
