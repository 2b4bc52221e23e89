//! The likeliest mistakes in a model file (`tests/mistakes/*.rs`), and what a user then sees.
//!
//! All but four are told from the text, without a compiler. After a change of these texts:
//! `UPDATE=1 cargo test -p eplat-language --test mistakes`, and read them as a newcomer would.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::fs;
use std::path::{Path, PathBuf};

use program::{Workplace, text};
use rayon::prelude::*;

/// A function that takes no derivatives: a type error, which is the Rust compiler's to explain.
const OF_TYPES: &str = "f64_function";

/// Plain numbers and columns may stand on the left, with or without a decimal point.
const LEGAL: [&str; 3] = ["column_on_the_left", "integer_in_an_expression", "number_on_the_left"];

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mistakes").join(format!("{name}.rs"))
}

#[test]
fn mistakes_are_explained_at_their_token() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mistakes");
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut names: Vec<String> =
        names.map(|path| path.file_stem().unwrap().to_str().unwrap().to_string()).collect();
    names.sort();
    assert_eq!(names.len(), 32);
    names.retain(|name| name != OF_TYPES && !LEGAL.contains(&name.as_str()));
    let said: Vec<_> = names.par_iter().map(|name| (name, show(&file(name)))).collect();
    for (name, said) in said {
        assert!(said.contains(&format!("{name}.rs:")), "{name}: the place is not named\n{said}");
        assert!(said.contains("\nhelp: "), "{name}: {said}");
        assert!(!said.contains("compiling"), "{name}: {said}");
        insta::assert_snapshot!(name.as_str(), said);
    }
}

#[test]
fn errors_of_types_are_shown_as_the_compiler_says_them() {
    let said = show(&file(OF_TYPES));
    assert!(said.contains(&format!("--> {OF_TYPES}.rs:15:")), "{said}");
    assert!(said.contains("refractory(f(x))"), "{said}");
    assert!(said.ends_with("`fn f<D: Real>(x: D) -> D`\n"), "{said}");
}

#[test]
fn plain_numbers_may_stand_on_the_left() {
    for name in LEGAL {
        let place = Workplace::new();
        place.file("legal.rs", fs::read_to_string(file(name)).unwrap());
        let output = place.eplat("show legal.rs");
        assert!(output.status.success(), "{name}: {}", text(&output.stderr));
    }
}

/// Not a mistake of the language: only a number tells.
const LOGARITHM_OF_A_NEGATIVE_NUMBER: &str = "use eplat::prelude::*;
model! {
    model NoStart;
    column dose;
    param mu ~ Normal(0, 1);
    observe y(row): Number ~ Normal((mu + row.dose).ln(), 1);
}
";

#[test]
fn check_says_which_measurement_leaves_no_start() {
    let place = Workplace::new();
    place.file("ln.rs", LOGARITHM_OF_A_NEGATIVE_NUMBER);
    for (doses, code) in [("1,2\n1,3\n", 0), ("1,2\n1,-3\n", 1)] {
        place.file("y.csv", format!("y,dose\n{doses}"));
        let output = place.eplat("check ln.rs --data y.csv");
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{said}");
        let row = "observe y: the log likelihood of row 2 of the table is NaN\nhelp: ";
        assert_eq!(said.contains(row), code == 1, "{said}");
    }
}

/// What `eplat show` says of a model file with a mistake.
fn show(file: &Path) -> String {
    let name = file.file_name().unwrap().to_str().unwrap();
    let place = Workplace::new();
    place.file(name, fs::read_to_string(file).unwrap());
    let output = place.eplat(&format!("show {name}"));
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{name}: {said}");
    said
}
