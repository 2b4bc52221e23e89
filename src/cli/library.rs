//! The library that models of a user's own are compiled against: the one that this program was linked
//! from, where its folder is still there; else one that is built, once, from the sources embedded here.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use include_dir::{Dir, include_dir};
use serde_json::json;

use super::cargo::counted;
use super::programs::{PROGRAM, READ};
use super::voice::tell;
use crate::store::{cache, write_folder};

static SOURCES: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/src");
static ENGINE: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/engine/src");
static LANGUAGE: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/language/src");
static MACROS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/macros/src");
static ASSETS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/assets");
static MODELS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/models");
const MANIFEST: &str = include_str!("../../Cargo.toml");
const BUILD: &str = include_str!("../../build.rs");
const ENGINE_MANIFEST: &str = include_str!("../../engine/Cargo.toml");
const LANGUAGE_MANIFEST: &str = include_str!("../../language/Cargo.toml");
const MACROS_MANIFEST: &str = include_str!("../../macros/Cargo.toml");
const LOCK: &str = include_str!("../../Cargo.lock");

/// The text that this program was compiled from (`build.rs`), as it stands in its library's file, too.
pub(super) static TEXT: &str = concat!("eplat's text ", env!("EPLAT_TEXT"));

/// The folder of the cache that embedded sources are unpacked in.
pub(super) const LIBRARY: &str = "eplat";

/// What a model of the user's own is compiled against.
#[derive(Clone, Copy, Debug)]
pub(super) enum Library {
    /// The library that this program was linked from.
    LinkedFrom,
    /// The library that an installed program has built from its own sources.
    Built,
    /// An installed program has not built it yet.
    ToBuild,
}

/// What there is now.
pub(super) fn library() -> Library {
    if linked_from().is_some() {
        Library::LinkedFrom
    } else if cache::folder().is_some_and(|cache| is_built(&cache)) {
        Library::Built
    } else {
        Library::ToBuild
    }
}

/// The library that this program was linked from: in the folder `deps` beside it, as in a checkout, or where
/// it was built.
pub(super) fn linked_from() -> Option<PathBuf> {
    let program = std::env::current_exe().ok()?;
    let beside = program.parent()?.join("deps");
    [beside, env!("EPLAT_LIBRARIES").into()].iter().find_map(|folder| of_this_text(folder))
}

/// The newest library of this text in a folder of compiled crates.
fn of_this_text(folder: &Path) -> Option<PathBuf> {
    let modified = |path: &Path| fs::metadata(path).and_then(|m| m.modified()).ok();
    let libraries = fs::read_dir(folder).ok()?.flatten().map(|e| e.path());
    let is_eplat = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("libeplat-") && name.ends_with(".rlib")
    };
    let mut dated: Vec<_> =
        libraries.filter(is_eplat).filter_map(|path| Some((modified(&path)?, path))).collect();
    dated.sort();
    let is_ours = |path: &PathBuf| fs::read(path).is_ok_and(|file| holds(&file, TEXT.as_bytes()));
    dated.into_iter().rev().map(|(_, path)| path).find(is_ours)
}

/// Whether `text` stands in `file`.
fn holds(file: &[u8], text: &[u8]) -> bool {
    let Some(first) = text.first() else { return true };
    let mut rest = file;
    while let Some(at) = rest.iter().position(|byte| byte == first) {
        if rest[at..].starts_with(text) {
            return true;
        }
        rest = &rest[at + 1..];
    }
    false
}

/// Whether the library of this text is built in the cache.
fn is_built(cache: &Path) -> bool {
    of_this_text(&cache.join("target/release/deps")).is_some()
}

/// Compiles the package that the folder `unfinished` is in, whose `src/main.rs` is written, and the library before
/// it where that is still to be done. Program and what was read are put in `unfinished`.
pub(super) fn with_cargo(cache: &Path, unfinished: &Path) -> std::io::Result<Output> {
    let package = unfinished.parent().unwrap_or(unfinished);
    let eplat = cache.join(LIBRARY).join(&cache::key(&[TEXT.as_bytes()])[..16]);
    let is_first = !is_built(cache);
    if is_first {
        let text = "building the library that models are compiled against: minutes, this once …";
        tell("building_library", text, json!({}));
        sweep_built(cache, cache::LIMIT);
    }
    if !eplat.is_dir() {
        fs::create_dir_all(cache.join(LIBRARY))?;
        write_folder(&eplat, unpack)?;
    }
    let name = format!("model-{}", package.file_name().unwrap_or_default().display());
    let profile = MANIFEST
        .split("[profile.release]")
        .nth(1)
        .and_then(|text| text.split("[profile.test]").next())
        .map(str::trim_end);
    let manifest = format!(
        "[package]\nname = \"{name}\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n\
         [dependencies]\neplat = {{ path = \"{}\" }}\n\n[workspace]\n\n[profile.release]{}\n\n\
         [profile.release.package.{name}]\ncodegen-units = 1\n",
        eplat.display(),
        profile.unwrap_or_default(),
    );
    fs::write(package.join("Cargo.toml"), manifest)?;
    if !package.join("Cargo.lock").exists() {
        fs::write(package.join("Cargo.lock"), LOCK)?;
    }
    let (target, manifest) = (cache.join("target"), package.join("Cargo.toml"));
    let mut command = Command::new("cargo");
    command
        .args(["build", "--release", "--quiet"])
        .args(["--message-format", "json", "--manifest-path"])
        .arg(&manifest)
        .env("CARGO_TARGET_DIR", &target)
        .stdin(Stdio::null());
    let output = if is_first { counted(&mut command, &manifest)? } else { command.output()? };
    if output.status.success() {
        let release = target.join("release");
        fs::copy(release.join(&name), unfinished.join(PROGRAM))?;
        fs::copy(release.join(format!("{name}.d")), unfinished.join(READ))?;
    }
    Ok(output)
}

/// Removes the libraries that earlier versions have built, once they take more than `limit` bytes. What cannot be
/// removed stays: it takes room, no more.
fn sweep_built(cache: &Path, limit: u64) {
    let target = cache.join("target");
    if bytes_in(&target) > limit {
        let _ = fs::remove_dir_all(target);
        let _ = fs::remove_dir_all(cache.join(LIBRARY));
    }
}

fn bytes_in(folder: &Path) -> u64 {
    let of = |entry: fs::DirEntry| match entry.metadata() {
        Ok(found) if found.is_dir() => bytes_in(&entry.path()),
        found => found.map_or(0, |found| found.len()),
    };
    fs::read_dir(folder).into_iter().flatten().flatten().map(of).sum()
}

/// The embedded sources as a package, for cargo to build; once, or cargo would see a change.
fn unpack(folder: &Path) -> std::io::Result<()> {
    for (name, dir) in [
        ("src", &SOURCES),
        ("engine/src", &ENGINE),
        ("language/src", &LANGUAGE),
        ("macros/src", &MACROS),
        ("assets", &ASSETS),
        ("models", &MODELS),
    ] {
        fs::create_dir_all(folder.join(name))?;
        dir.extract(folder.join(name))?;
    }
    fs::write(folder.join("engine/Cargo.toml"), ENGINE_MANIFEST)?;
    fs::write(folder.join("language/Cargo.toml"), LANGUAGE_MANIFEST)?;
    fs::write(folder.join("macros/Cargo.toml"), MACROS_MANIFEST)?;
    fs::write(folder.join("README.md"), "")?;
    fs::write(folder.join("build.rs"), BUILD)?;
    fs::write(folder.join("Cargo.toml"), library_alone(MANIFEST))?;
    fs::write(folder.join("Cargo.lock"), LOCK)
}

/// The texts of the models that ship, by the names of their files without the ending.
pub fn shipped_models() -> BTreeMap<String, &'static str> {
    let models = MODELS.files().filter(|file| file.path().extension().is_some_and(|e| e == "rs"));
    let named = models.filter_map(|file| {
        let name = file.path().file_stem()?.to_str()?;
        Some((name.to_owned(), file.contents_utf8()?))
    });
    named.collect()
}

/// The manifest without what is not embedded: tests, benches, the program and its models, Python.
fn library_alone(manifest: &str) -> String {
    let mut kept = true;
    let is_kept = |line: &&str| {
        if line.starts_with('[') {
            kept = !["[[test]]", "[[bench]]"].contains(line);
        }
        kept && !line.starts_with("eplat-models =") && !line.starts_with("default-run")
    };
    let lines = manifest.lines().filter(is_kept).collect::<Vec<_>>().join("\n") + "\n";
    lines.replace(", \"shipped\"", "").replace(", \"python\"", "")
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn libraries_of_earlier_versions_go_when_they_take_too_much() {
        let cache = tempfile::tempdir().unwrap();
        let [library, sources, other] =
            ["target/release/deps/libeplat-1.rlib", "eplat/abc/Cargo.toml", "programs/abc"]
                .map(|name| cache.path().join(name));
        for path in [&library, &sources, &other] {
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, [0; 100]).unwrap();
        }
        sweep_built(cache.path(), 100);
        assert!(library.exists() && sources.exists());
        sweep_built(cache.path(), 99);
        assert!(!library.exists() && !sources.exists() && other.exists());
    }

    /// Cargo reads all of the manifest before it misses a program that nobody has. (`cargo metadata` does not
    /// look for the files of tests and benches. `tests/installed.rs` builds the package, which takes minutes.)
    #[test]
    fn cargo_understands_the_unpacked_package() {
        let folder = tempfile::tempdir().unwrap();
        unpack(folder.path()).unwrap();
        let said = Command::new("cargo")
            .args(["build", "--offline", "--bin", "none"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&said.stderr).into_owned();
        assert!(said.contains("no bin target named `none`"), "{said}");
    }
}
