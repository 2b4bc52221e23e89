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

/// Paths and line numbers that are not the user's.
const FILTERS: &[(&str, &str)] = &[
    (r"/\S*/(\w+\.rs:)", "$1"),
    (r"(src/[\w/]+\.rs|/rustc/\S+?\.rs):\d+:\d+", "$1"),
    (r"and \d+ others", "and others"),
];

#[test]
fn mistakes_are_explained_at_their_token() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mistakes");
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    assert_eq!(files.len(), 9);
    for file in files {
        let name = file.file_name().unwrap().to_str().unwrap();
        let place = Workplace::new();
        place.file(name, fs::read_to_string(&file).unwrap());
        let output = place.eplat(&format!("show {name}"));
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{name}: {said}");
        assert!(said.contains(&format!("{name}:")), "{name}: the place is not named\n{said}");
        assert!(said.contains(&format!("\nhelp: mend {name}")), "{name}: {said}");
        insta::with_settings!({ filters => FILTERS.to_vec() }, {
            insta::assert_snapshot!(name.trim_end_matches(".rs"), said);
        });
    }
}
