//! The likeliest mistakes in a model file (`tests/mistakes/*.rs`), and what a user then sees.
//!
//! The texts are those of the Rust release that `rust-version` names. After a change:
//! `INSTA_UPDATE=always cargo test --release --test mistakes`, and read them as a newcomer would.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;

use std::fs;
use std::path::Path;

use program::{Workplace, text};
use rayon::prelude::*;

#[test]
fn mistakes_are_explained_at_their_token() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mistakes");
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    assert_eq!(files.len(), 31);
    let said: Vec<_> = files.par_iter().map(|file| (file, show(file))).collect();
    for (file, said) in said {
        let name = file.file_stem().unwrap().to_str().unwrap();
        assert!(said.contains(&format!("{name}.rs:")), "{name}: the place is not named\n{said}");
        assert!(said.contains("\nhelp: "), "{name}: {said}");
        insta::assert_snapshot!(name, said);
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
