//! Models that ship and those of the tests are read, and none has a mistake.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::fs;
use std::path::{Path, PathBuf};

use eplat_language::syntax::{Item, Model, Param};
use eplat_language::vocabulary::{PRELUDE, find};
use eplat_language::{File, check, equations, parse};
use proc_macro2::{TokenStream, TokenTree};

/// The Rust files of a folder of the package.
fn files(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder);
    let mut files: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "rs"))
        .collect();
    files.sort();
    files
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap()
}

fn stem(path: &Path) -> &str {
    path.file_stem().unwrap().to_str().unwrap()
}

#[test]
fn model_files_have_no_mistakes() {
    let is_one_model = |path: &PathBuf| read(path).matches("model! {").count() == 1;
    let mut paths = files("models");
    paths.extend(files("examples/validation"));
    paths.extend(files("tests/models").into_iter().filter(is_one_model));
    let mut n = 0;
    for path in paths.iter().filter(|path| stem(path) != "joint_parts") {
        let text = read(path);
        let show = |mistake: &eplat_language::Mistake| mistake.show(path.to_str().unwrap(), &text);
        let file = File::read(&text).unwrap_or_else(|mistake| panic!("{}", show(&mistake)));
        let mistakes: Vec<String> = file.check().iter().map(show).collect();
        assert!(mistakes.is_empty(), "{}", mistakes.join("\n\n"));
        n += 1;
    }
    assert!(n >= 25, "{n}");
}

/// Every `model! { … }` within `tokens`, however deep.
fn models(tokens: TokenStream, found: &mut Vec<TokenStream>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    for (i, token) in tokens.iter().enumerate() {
        let TokenTree::Group(group) = token else { continue };
        let word = i.checked_sub(2).map(|i| tokens[i].to_string());
        if word.as_deref() == Some("model") && tokens[i - 1].to_string() == "!" {
            found.push(group.stream());
        } else {
            models(group.stream(), found);
        }
    }
}

#[test]
fn models_in_modules_have_no_mistakes() {
    let mut n = 0;
    for path in files("tests/models").iter().filter(|path| stem(path) != "joint_parts") {
        let mut found = vec![];
        models(read(path).parse().unwrap(), &mut found);
        for tokens in found {
            let model = parse(tokens).unwrap_or_else(|m| panic!("{}: {}", stem(path), m.message));
            let mistakes = check(&model);
            let said: Vec<&str> = mistakes.iter().map(|m| m.message.as_str()).collect();
            assert!(said.is_empty(), "{}, {}: {said:?}", stem(path), model.name);
            n += 1;
        }
    }
    assert!(n >= 25, "{n}");
}

#[test]
fn equations_are_as_a_person_would_write_them() {
    for path in files("models") {
        let text = read(&path);
        let model = File::read(&text).unwrap().model;
        let said = equations(&model, &|name| Some(support(&model, name).into()));
        let expected = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/equations");
        let expected = expected.join(format!("{}.txt", stem(&path)));
        if std::env::var_os("UPDATE").is_some() {
            fs::write(&expected, &said).unwrap();
        }
        assert_eq!(said, read(&expected), "{}", path.display());
        let widest = said.lines().map(|line| line.chars().count()).max();
        assert!(widest <= Some(100), "{}: a line of {widest:?} columns", path.display());
    }
}

/// What the library says of where a parameter's values lie, of the priors in these models.
fn support(model: &Model, name: &str) -> &'static str {
    let (of, short) = name.split_once('.').unwrap_or(("", name));
    let params = model.statements.iter().flat_map(|statement| match &statement.item {
        Item::Param(p) if of.is_empty() => std::slice::from_ref(p),
        Item::Hyper(h) if h.name == of => &h.params,
        Item::Field(f) if f.name == of => &f.params,
        _ => &[],
    });
    // a field that takes a block has the block's parameters under its own name
    let blocks = model.statements.iter().flat_map(|statement| match &statement.item {
        Item::Hyper(h) => &h.params[..],
        _ => &[],
    });
    let param: Vec<&Param> = params.chain(blocks).filter(|p| p.name == short).collect();
    let prior = eplat_language::print(&param.first().unwrap().prior.expr);
    let (family, arguments) = prior.split_once('(').unwrap_or((&prior, ""));
    match (family, arguments) {
        ("Normal" | "Flat" | "Gumbel", _) => "real",
        ("FlatBetween", "0.0, 1.0)") => "in (0, 1)",
        ("TruncatedNormal", _) => "in (120, 270)",
        ("FlatBetween", _) => "between its bounds",
        _ => "positive",
    }
}

#[test]
fn the_prelude_is_the_one_that_the_library_exports() {
    let text = read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../engine/src/prelude.rs"));
    let file: syn::File = syn::parse_str(&text).unwrap();
    let mut names = vec![];
    for item in file.items {
        let syn::Item::Use(item) = item else { continue };
        leaves(&item.tree, &mut names);
    }
    assert!(names.len() > 40);
    for name in names.iter().filter(|name| *name != "_") {
        let is_known = find(name).is_some() || PRELUDE.contains(&name.as_str());
        assert!(is_known, "{name} is exported, and language/src/vocabulary.rs has no such word");
    }
}

/// The names that a tree of imports ends in.
fn leaves(tree: &syn::UseTree, found: &mut Vec<String>) {
    match tree {
        syn::UseTree::Path(path) => leaves(&path.tree, found),
        syn::UseTree::Group(group) => group.items.iter().for_each(|tree| leaves(tree, found)),
        syn::UseTree::Name(name) => found.push(name.ident.to_string()),
        syn::UseTree::Rename(name) => found.push(name.rename.to_string()),
        syn::UseTree::Glob(_) => {}
    }
}
