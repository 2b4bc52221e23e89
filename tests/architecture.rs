//! The layer table of `src/lib.rs`: a module imports only from layers below its own.
//!
//! Within a layer only what the table's order cannot avoid is allowed, by name in [`SAME_LAYER`]. A model
//! file sees the prelude alone. Unit tests, comments and doc links may look anywhere.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::fs;
use std::path::{Path, PathBuf};

/// Layer of each module of the crate.
const LAYERS: &[(u32, &[&str])] = &[
    (7, &["main", "cli"]),
    (6, &["study", "criticism"]),
    (5, &["run", "report"]),
    (4, &["experiment"]),
    (3, &["model", "prelude"]),
    (2, &["table", "field", "surrogate", "infer", "diagnostics"]),
    (1, &["dist", "likelihood", "manifold", "ep"]),
    (0, &["mesh", "num", "random", "error", "store"]),
];

/// Imports within a layer: (who, whom).
const SAME_LAYER: &[(&str, &str)] = &[
    ("likelihood", "dist"), // a likelihood of a Number is a distribution
    ("surrogate", "infer"), // a Gaussian process is fitted by the optimiser
    ("mesh", "store"),      // files appear whole or not at all
    ("run", "report"),      // what renders it writes its page and tables
    ("main", "cli"),
];

fn layer(module: &str) -> u32 {
    let row = LAYERS.iter().find(|(_, modules)| modules.contains(&module));
    row.unwrap_or_else(|| panic!("module {module} is in no layer: add it to the table")).0
}

/// Modules of the crate that a source text names: `crate::x`, and `eplat::x` in the program and models.
/// Macros are left out: `$crate::x!` and the re-exported `model` have no module.
fn imports(source: &str) -> Vec<String> {
    let mut found = vec![];
    for line in without_tests(source).lines() {
        let code = line.split("//").next().unwrap();
        for path in ["crate::", "eplat::"] {
            for rest in code.split(path).skip(1) {
                let group = rest.strip_prefix('{').map(|r| r.split('}').next().unwrap());
                let names = group.unwrap_or(first_word(rest)).split(',').map(str::trim);
                let is_macro = rest[first_word(rest).len()..].starts_with('!');
                found.extend(names.filter(|_| !is_macro).map(|n| first_word(n).to_string()));
            }
        }
    }
    found.retain(|name| !name.is_empty());
    found.sort();
    found.dedup();
    found
}

fn first_word(text: &str) -> &str {
    text.split(|c: char| !(c.is_alphanumeric() || c == '_')).next().unwrap()
}

/// The text up to its unit tests, which come last.
fn without_tests(source: &str) -> &str {
    source.split("#[cfg(test)]\nmod tests {").next().unwrap()
}

/// Every import of `module` that its layer forbids.
fn violations(module: &str, source: &str) -> Vec<String> {
    let allowed = |other: &String| {
        other == module
            || module == "prelude" && layer(other) <= 3
            || layer(other) < layer(module)
            || SAME_LAYER.contains(&(module, other.as_str()))
    };
    imports(source)
        .into_iter()
        .filter(|other| !allowed(other))
        .map(|other| {
            format!("{module} (layer {}) imports {other} (layer {})", layer(module), layer(&other))
        })
        .collect()
}

/// Rust files below `folder`, without those that are unit tests alone.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut files = vec![];
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_string();
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") && !is_tests(&name) {
            files.push(path);
        }
    }
    files
}

fn is_tests(name: &str) -> bool {
    name == "tests" || name.ends_with("_tests") || name.starts_with("test_")
}

#[test]
fn every_layer_imports_only_from_below() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut wrong = vec![];
    for file in sources(&root) {
        let place = file.strip_prefix(&root).unwrap();
        let module = place.iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs");
        if module == "lib" {
            continue; // declares the modules
        }
        let found = violations(module, &fs::read_to_string(&file).unwrap());
        wrong.extend(found.into_iter().map(|what| format!("{}: {what}", place.display())));
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn models_see_the_prelude_alone() {
    for file in sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("models")) {
        let seen = imports(&fs::read_to_string(&file).unwrap());
        assert_eq!(seen, ["prelude"], "{}", file.display());
    }
}

#[test]
fn the_table_is_the_one_in_the_docs() {
    let lib = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs")).unwrap();
    for module in lib.lines().filter_map(|l| l.strip_prefix("pub mod ")?.strip_suffix(';')) {
        let row = format!("//! | {} |", layer(module));
        let documented =
            lib.lines().any(|l| l.starts_with(&row) && l.contains(&format!("[`{module}`]")));
        assert!(module == "prelude" || documented, "{module} is not in the docs' row {row}");
    }
}

#[test]
fn the_checker_sees_what_it_forbids() {
    let cases: &[(&str, &str, usize)] = &[
        ("infer", "use crate::field::Kernel;", 1),
        ("infer", "fn f(x: crate::mesh::TriMesh) {}", 0),
        ("mesh", "use crate::{model::Model, num, cli, store};", 3),
        ("ep", "use crate::dist::Normal;", 1),
        ("model", "fn f() { $crate::cli::main(); $crate::bind!{ } }", 1),
        ("likelihood", "use crate::dist::Normal;", 0),
        ("dist", "use crate::likelihood::Bracket;", 1),
        ("ep", "// crate::cli\n/// [`crate::model`]\nuse crate::ep::cell;", 0),
        ("num", "#[cfg(test)]\nmod tests {\n    use crate::cli;\n}", 0),
        ("prelude", "pub use crate::field::Rbf; pub use crate::report::Page;", 1),
    ];
    for (module, source, expected) in cases {
        assert_eq!(violations(module, source).len(), *expected, "{module}: {source}");
    }
}
