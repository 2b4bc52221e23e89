//! Every dependency is used by the crate that names it; all of them have a licence that `deny.toml` allows, come from
//! the registry, and are there once, but for the doubles that it names. So this is held where cargo-deny is not
//! installed, too. (What has become known of a dependency since needs a database; `.ci/run` asks it where
//! cargo-deny has fetched one.)
#![allow(clippy::unwrap_used, reason = "tests")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;

/// Folders of the crates of this repository, and dependencies that none of their files names, with the reason.
const CRATES: [(&str, &[&str]); 8] = [
    // with their features, program, Python module and tests share one build; the name of another, `either`, is a word
    // that comments use
    ("", &["num-complex", "num-integer", "once_cell", "simd-adler32"]),
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

/// What is wrong with packages, each in a line: of all of them, `NAME VERSION (WHERE)|LICENCE` as `cargo tree` prints
/// them, and of those that the program is built with.
fn objections(all: &str, built: &str, allowed: &Allowed) -> Vec<String> {
    let lines = |text: &str| -> BTreeSet<String> {
        text.lines().filter(|line| !line.is_empty()).map(String::from).collect()
    };
    let mut found = vec![];
    for line in lines(all) {
        let (package, licence) = line.split_once('|').unwrap();
        if !is_free(licence, &allowed.licences) {
            found.push(format!("{package}: licence {licence}"));
        }
        // a folder of this repository, or no place at all, which is the registry
        if package.contains("://") {
            found.push(format!("{package}: not from the registry"));
        }
    }
    let mut versions: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for line in lines(built) {
        let mut words = line.split([' ', '|']);
        let [name, version] = [(); 2].map(|()| words.next().unwrap().to_owned());
        let version = version.trim_start_matches('v').to_owned();
        let is_skipped = allowed.doubles.iter().any(|double| {
            let (of, begin) = double.split_once('@').unwrap();
            of == name && format!("{version}.").starts_with(&format!("{begin}."))
        });
        if !is_skipped {
            versions.entry(name).or_default().insert(version);
        }
    }
    for (name, versions) in versions.into_iter().filter(|(_, versions)| versions.len() > 1) {
        found.push(format!("{name}: {}", Vec::from_iter(versions).join(" and ")));
    }
    found
}

#[test]
fn dependencies_are_free_from_the_registry_and_there_once() {
    let tree = |edges: &str| {
        let arguments =
            "tree --workspace --offline --locked --prefix none --no-dedupe --format {p}|{l} -e";
        let mut command = Command::new(env!("CARGO"));
        command.args(arguments.split(' ')).arg(edges).current_dir(env!("CARGO_MANIFEST_DIR"));
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let (all, built) = (tree("normal,build,dev"), tree("normal,build"));
    assert!(all.lines().collect::<BTreeSet<_>>().len() > 100);
    assert_eq!(objections(&all, &built, &allowed()), Vec::<String>::new());
}

#[test]
fn one_that_is_not_free_or_there_twice_is_found() {
    let packages = "a v1.0.0|MIT OR GPL-3.0\na v2.0.0 (proc-macro)|(MIT OR GPL-3.0) AND Zlib\n\n\
                    b v1.0.0|MIT AND GPL-3.0\nc v1.0.0 (https://example.org/c.git#1)|\n\
                    syn v1.0.9|MIT/Apache-2.0\nsyn v3.0.0|Apache-2.0 WITH LLVM-exception\nsyn v3.0.0|MIT\n";
    let expected = [
        "b v1.0.0: licence MIT AND GPL-3.0",
        "c v1.0.0 (https://example.org/c.git#1): licence ",
        "c v1.0.0 (https://example.org/c.git#1): not from the registry",
        "a: 1.0.0 and 2.0.0",
    ];
    assert_eq!(objections(packages, packages, &allowed()), expected);
    assert_eq!(objections("", packages, &allowed()), expected[3..]);
}
