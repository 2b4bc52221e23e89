//! Every dependency is used by the crate that names it.
#![allow(clippy::unwrap_used, reason = "tests")]

use std::fs;
use std::path::Path;

/// Folders of the crates of this repository, and dependencies that none of their files names, with the reason.
const CRATES: [(&str, &[&str]); 8] = [
    // with their features, program and Python module share one build
    ("", &["num-complex", "num-integer", "once_cell"]),
    ("engine", &[]),
    ("language", &[]),
    ("macros", &[]),
    ("shipped", &[]),
    ("python", &[]),
    ("book", &[]),
    ("fuzz", &[]),
];

/// The texts of all Rust files of a crate, without those of crates below it.
fn sources(folder: &Path, text: &mut String) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            let is_other = path.join("Cargo.toml").exists() || path.ends_with("target");
            if !is_other {
                sources(&path, text);
            }
        } else if path.extension().is_some_and(|e| e == "rs") && !path.ends_with(file!()) {
            *text += &fs::read_to_string(path).unwrap();
        }
    }
}

/// Dependencies that no file names.
fn unused(manifest: &str, text: &str) -> Vec<String> {
    let manifest: toml::Table = manifest.parse().unwrap();
    let tables = ["dependencies", "dev-dependencies", "build-dependencies"];
    let named = tables.iter().filter_map(|table| manifest.get(*table)?.as_table());
    let is_unused = |name: &&String| {
        let name = name.replace('-', "_");
        let ends = |rest: &str| rest.starts_with(|c: char| !c.is_alphanumeric() && c != '_');
        let mut places = text.match_indices(&name);
        !places.any(|(at, _)| {
            ends(&text[at + name.len()..])
                && !text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_')
        })
    };
    named.flat_map(toml::Table::keys).filter(is_unused).cloned().collect()
}

#[test]
fn every_dependency_is_used() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for (folder, known) in CRATES {
        let mut text = String::new();
        sources(&root.join(folder), &mut text);
        let manifest = fs::read_to_string(root.join(folder).join("Cargo.toml")).unwrap();
        assert_eq!(unused(&manifest, &text), known, "{folder}/Cargo.toml");
    }
}

#[test]
fn one_that_nobody_names_is_found() {
    let manifest = "[dependencies]\nserde_json = \"1\"\nserde = \"1\"\n[dev-dependencies]\nrand-distr = \"1\"\n";
    assert_eq!(unused(manifest, "use serde_json::Value;"), ["serde", "rand-distr"]);
    assert!(unused(manifest, "serde_json::x; serde::y; rand_distr::z").is_empty());
}
