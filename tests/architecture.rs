//! The layer table of `src/lib.rs`: a module imports only from layers below its own.
//!
//! Within a layer only what the table's order cannot avoid is allowed, by name in [`SAME_LAYER`]. A model
//! file sees the prelude alone. Unit tests, comments and doc links may look anywhere.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// Layer of each module of the crate.
const LAYERS: &[(u32, &[&str])] = &[
    (7, &["main", "cli"]),
    (6, &["study", "closed_loop"]),
    (5, &["run", "report", "import"]),
    (4, &["experiment", "criticism"]),
    (3, &["model", "prelude"]),
    (2, &["table", "field", "surrogate", "infer", "diagnostics", "anatomy"]),
    (1, &["dist", "likelihood", "manifold", "ep"]),
    (0, &["mesh", "num", "random", "error", "store"]),
];

/// Imports within a layer: (who, whom).
const SAME_LAYER: &[(&str, &str)] = &[
    ("likelihood", "dist"),   // a likelihood of a Number is a distribution
    ("surrogate", "infer"),   // a Gaussian process is fitted by the optimiser
    ("infer", "diagnostics"), // regimes that draws of the warm-up fall into
    ("mesh", "store"),        // files appear whole or not at all
    ("error", "store"),       // what to do about a file that cannot be written
    ("run", "report"),        // what renders it writes its page and tables
    ("main", "cli"),
];

fn layer(module: &str) -> u32 {
    let row = LAYERS.iter().find(|(_, modules)| modules.contains(&module));
    row.unwrap_or_else(|| panic!("module {module} is in no layer: add it to the table")).0
}

/// Modules of the crate that a source names: `crate::x`, `crate::{x, y::z}` over any number of lines, and `eplat::x`
/// in the program and models. Comments, texts and unit tests are left out.
fn imports(source: &str) -> Vec<String> {
    let mut found = vec![];
    collect(&without_tests(tokens(source)), &mut found);
    found.sort();
    found.dedup();
    found
}

fn tokens(source: &str) -> Vec<TokenTree> {
    source.parse::<TokenStream>().unwrap().into_iter().collect()
}

/// The tokens without `#[cfg(test)] mod … { … }`.
fn without_tests(tokens: Vec<TokenTree>) -> Vec<TokenTree> {
    let is_marked = |i: usize| i > 0 && tokens[i].to_string().replace(' ', "") == "[cfg(test)]";
    let Some(at) = (0..tokens.len()).find(|i| is_marked(*i)) else { return tokens };
    let is_module = tokens[at..].iter().take(4).any(|token| token.to_string() == "mod");
    let end = |token: &TokenTree| matches!(token, TokenTree::Group(g) if g.delimiter() == Delimiter::Brace);
    let length = tokens[at + 1..].iter().position(|t| end(t) || t.to_string() == ";");
    let end = length.map_or(tokens.len(), |length| at + length + 2);
    let kept = if is_module { vec![] } else { tokens[at..end].to_vec() };
    let rest = without_tests(tokens[end..].to_vec());
    [tokens[..at].to_vec(), kept, rest].concat()
}

fn collect(tokens: &[TokenTree], found: &mut Vec<String>) {
    for (i, token) in tokens.iter().enumerate() {
        if let TokenTree::Group(group) = token {
            collect(&group.stream().into_iter().collect::<Vec<_>>(), found);
        }
        let is_root = matches!(token, TokenTree::Ident(word) if word == "crate" || word == "eplat");
        let is_punct = |i: usize, sign: char| matches!(tokens.get(i), Some(TokenTree::Punct(p)) if p.as_char() == sign);
        let is_macro = i > 0 && is_punct(i - 1, '$');
        if !is_root || is_macro || !is_punct(i + 1, ':') || !is_punct(i + 2, ':') {
            continue;
        }
        match tokens.get(i + 3) {
            Some(TokenTree::Ident(module)) => found.push(module.to_string()),
            Some(TokenTree::Group(group)) => {
                let mut begins = true;
                for token in group.stream() {
                    if let (TokenTree::Ident(module), true) = (&token, begins) {
                        found.push(module.to_string());
                    }
                    begins = token.to_string() == ",";
                }
            }
            _ => {}
        }
    }
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

/// The folders of the two crates that hold the rooms.
fn roots() -> [PathBuf; 2] {
    ["src", "engine/src"].map(|folder| Path::new(env!("CARGO_MANIFEST_DIR")).join(folder))
}

#[test]
fn every_layer_imports_only_from_below() {
    let mut wrong = vec![];
    for (root, file) in roots().iter().flat_map(|r| sources(r).into_iter().map(move |f| (r, f))) {
        let place = file.strip_prefix(root).unwrap();
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
    let [lib, engine] = roots().map(|root| fs::read_to_string(root.join("lib.rs")).unwrap());
    let modules = lib.lines().chain(engine.lines());
    let modules = modules.filter_map(|l| l.strip_prefix("pub mod ")?.strip_suffix(';'));
    let mut n = 0;
    for module in modules {
        let row = format!("//! | {} |", layer(module));
        let documented =
            lib.lines().any(|l| l.starts_with(&row) && l.contains(&format!("[`{module}`]")));
        assert!(module == "prelude" || documented, "{module} is not in the docs' row {row}");
        n += 1;
    }
    assert_eq!(
        n,
        LAYERS.iter().map(|(_, modules)| modules.len()).sum::<usize>() - 1,
        "all but main"
    );
}

#[test]
fn the_checker_sees_what_it_forbids() {
    let cases: &[(&str, &str, usize)] = &[
        ("infer", "use crate::field::Kernel;", 1),
        ("infer", "fn f(x: crate::mesh::TriMesh) {}", 0),
        ("mesh", "use crate::{model::Model, num, cli, store};", 3),
        ("ep", "use crate::dist::Normal;", 1),
        ("model", "use crate::{\n    num::Num,\n    cli::{main, run},\n    report,\n};", 2),
        ("model", "fn f() { crate::cli::main() }", 1),
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

/// The files of the crate that a file takes names from: the file of the longest module path that it writes.
fn files_named(file: &Path, root: &Path, modules: &BTreeMap<String, PathBuf>) -> BTreeSet<PathBuf> {
    let own = module_of(file, root);
    let mut found = BTreeSet::new();
    let tokens = without_tests(tokens(&fs::read_to_string(file).unwrap()));
    for path in used_paths(&tokens) {
        let mut place: Vec<String> =
            own.split("::").filter(|p| !p.is_empty()).map(String::from).collect();
        let mut rest = path.as_slice();
        while let [first, others @ ..] = rest {
            match first.as_str() {
                "crate" => place.clear(),
                "super" => drop(place.pop()),
                "self" => {}
                _ => break,
            }
            rest = others;
        }
        place.extend(rest.iter().cloned());
        // a name that a folder's own file hands on is another file's: only what is defined there counts
        let named = (1..=place.len()).rev().find_map(|n| modules.get(&place[..n].join("::")));
        if let Some(named) = named.filter(|named| *named != file && !named.ends_with("mod.rs")) {
            found.insert(named.clone());
        }
    }
    found
}

/// `model::builder::fields` of `engine/src/model/builder/fields.rs`.
fn module_of(file: &Path, root: &Path) -> String {
    let place = file.strip_prefix(root).unwrap().with_extension("");
    let parts: Vec<&str> = place.iter().map(|part| part.to_str().unwrap()).collect();
    let parts = if parts.last() == Some(&"mod") { &parts[..parts.len() - 1] } else { &parts[..] };
    parts.join("::")
}

/// Paths after `use` that begin with `crate`, `super` or `self`, groups taken apart.
fn used_paths(tokens: &[TokenTree]) -> Vec<Vec<String>> {
    let mut paths = vec![];
    let mut rest = tokens;
    while let Some(at) = rest.iter().position(|t| t.to_string() == "use") {
        let end =
            rest[at..].iter().position(|t| t.to_string() == ";").map_or(rest.len(), |n| at + n);
        let is_reexport = at > 0
            && (rest[at - 1].to_string() == "pub" || matches!(&rest[at - 1], TokenTree::Group(_)));
        if !is_reexport {
            tree(&rest[at + 1..end], &[], &mut paths);
        }
        rest = &rest[end..];
    }
    let is_ours = |path: &Vec<String>| ["crate", "super", "self"].contains(&path[0].as_str());
    paths.retain(|path| !path.is_empty() && is_ours(path));
    paths
}

fn tree(tokens: &[TokenTree], before: &[String], paths: &mut Vec<Vec<String>>) {
    let mut path = before.to_vec();
    for token in tokens {
        match token {
            TokenTree::Ident(word) => path.push(word.to_string()),
            TokenTree::Group(group) => {
                let inner: Vec<TokenTree> = group.stream().into_iter().collect();
                for part in inner.split(|token| token.to_string() == ",") {
                    tree(part, &path, paths);
                }
                return;
            }
            TokenTree::Punct(_) | TokenTree::Literal(_) => {}
        }
    }
    paths.push(path);
}

#[test]
fn no_file_takes_names_in_a_circle() {
    for root in roots() {
        let circles = circles(&root);
        assert!(circles.is_empty(), "in a circle, or on the way to one:\n{}", circles.join("\n"));
    }
}

/// The files of a crate that are in a circle, or on the way to one.
fn circles(root: &Path) -> Vec<String> {
    let files = sources(root);
    let modules = files.iter().map(|file| (module_of(file, root), file.clone())).collect();
    let mut named: BTreeMap<PathBuf, BTreeSet<PathBuf>> =
        files.iter().map(|file| (file.clone(), files_named(file, root, &modules))).collect();
    // what names nothing that is left cannot be in a circle
    loop {
        let done: Vec<PathBuf> = named
            .iter()
            .filter(|(_, names)| names.is_empty())
            .map(|(file, _)| file.clone())
            .collect();
        if done.is_empty() {
            break;
        }
        named.retain(|file, _| !done.contains(file));
        for names in named.values_mut() {
            names.retain(|name| !done.contains(name));
        }
    }
    let shown = |file: &PathBuf| file.strip_prefix(root).unwrap().display().to_string();
    let line = |(file, names): (&PathBuf, &BTreeSet<PathBuf>)| {
        format!("{} -> {:?}", shown(file), names.iter().map(shown).collect::<Vec<_>>())
    };
    named.iter().map(line).collect()
}
