//! Every dependency is used by the crate that names it; all of them have a licence that `deny.toml` allows, come from
//! the registry, and are there once, but for the doubles that it names. So this is held where cargo-deny is not
//! installed, too. (What has become known of a dependency since needs a network: `cargo deny check advisories`.)
#![allow(clippy::unwrap_used, reason = "tests")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

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

/// What `deny.toml` allows.
struct Allowed {
    licences: Vec<String>,
    /// Older versions, as `NAME@BEGIN`.
    doubles: Vec<String>,
}

fn allowed() -> Allowed {
    let read: toml::Table = include_str!("../deny.toml").parse().unwrap();
    let text = |value: &toml::Value| value.as_str().unwrap().to_owned();
    let doubles = read["bans"]["skip"].as_array().unwrap().iter();
    Allowed {
        licences: read["licenses"]["allow"].as_array().unwrap().iter().map(text).collect(),
        doubles: doubles.map(|skipped| text(&skipped["crate"])).collect(),
    }
}

/// Whether one of the licences may be chosen: `A OR B`, `A AND B`, brackets, and `A/B` of old.
fn is_free(expression: &str, allowed: &[String]) -> bool {
    let expression = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let mut words: Vec<&str> = expression.split_whitespace().rev().collect();
    either(&mut words, allowed) && words.is_empty()
}

fn either(words: &mut Vec<&str>, allowed: &[String]) -> bool {
    let mut is_free = both(words, allowed);
    while words.pop_if(|word| *word == "OR").is_some() {
        is_free |= both(words, allowed);
    }
    is_free
}

fn both(words: &mut Vec<&str>, allowed: &[String]) -> bool {
    let mut is_free = one(words, allowed);
    while words.pop_if(|word| *word == "AND").is_some() {
        is_free &= one(words, allowed);
    }
    is_free
}

fn one(words: &mut Vec<&str>, allowed: &[String]) -> bool {
    let Some(mut licence) = words.pop().map(String::from) else { return false };
    if licence == "(" {
        let is_free = either(words, allowed);
        return words.pop() == Some(")") && is_free;
    }
    if words.pop_if(|word| *word == "WITH").is_some() {
        licence = format!("{licence} WITH {}", words.pop().unwrap_or_default());
    }
    allowed.contains(&licence)
}

/// What is wrong with the packages that `cargo metadata` tells, each in a line.
fn objections(metadata: &Value, allowed: &Allowed) -> Vec<String> {
    let mut found = vec![];
    let mut versions: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for package in metadata["packages"].as_array().unwrap() {
        let [name, version] = ["name", "version"].map(|key| package[key].as_str().unwrap());
        let licence = package["license"].as_str().unwrap_or("none");
        if !is_free(licence, &allowed.licences) {
            found.push(format!("{name} {version}: licence {licence}"));
        }
        let source = package["source"].as_str();
        if source.is_some_and(|source| !source.starts_with("registry+")) {
            found.push(format!("{name} {version}: from {}", source.unwrap_or_default()));
        }
        let is_skipped = allowed.doubles.iter().any(|double| {
            let (of, begin) = double.split_once('@').unwrap();
            of == name && format!("{version}.").starts_with(&format!("{begin}."))
        });
        if !is_skipped {
            versions.entry(name).or_default().push(version);
        }
    }
    let doubles = versions.iter().filter(|(_, versions)| versions.len() > 1);
    found.extend(doubles.map(|(name, versions)| format!("{name}: {}", versions.join(" and "))));
    found
}

#[test]
fn dependencies_are_free_from_the_registry_and_there_once() {
    let root = env!("CARGO_MANIFEST_DIR");
    let metadata = ["metadata", "--format-version", "1", "--offline", "--locked"];
    let output = Command::new(env!("CARGO")).args(metadata).current_dir(root).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(metadata["packages"].as_array().unwrap().len() > 100);
    assert_eq!(objections(&metadata, &allowed()), Vec::<String>::new());
}

#[test]
fn one_that_is_not_free_or_there_twice_is_found() {
    let packages = json!({ "packages": [
        { "name": "a", "version": "1.0.0", "license": "MIT OR GPL-3.0", "source": "registry+x" },
        { "name": "a", "version": "2.0.0", "license": "(MIT OR GPL-3.0) AND Zlib", "source": "registry+x" },
        { "name": "syn", "version": "1.0.0", "license": "MIT/Apache-2.0", "source": null },
        { "name": "syn", "version": "3.0.0", "license": "Apache-2.0 WITH LLVM-exception", "source": null },
        { "name": "b", "version": "1.0.0", "license": "MIT AND GPL-3.0", "source": "registry+x" },
        { "name": "c", "version": "1.0.0", "license": null, "source": "git+x" },
    ] });
    let expected = [
        "b 1.0.0: licence MIT AND GPL-3.0",
        "c 1.0.0: licence none",
        "c 1.0.0: from git+x",
        "a: 1.0.0 and 2.0.0",
    ];
    assert_eq!(objections(&packages, &allowed()), expected);
}
