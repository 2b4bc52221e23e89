//! Compiles a model file that is not in this program, and hands the command line over to the result.
//!
//! What is compiled is eplat again, with this one model in it, so it takes the same command line. In
//! a checkout the model is compiled against the library that lies beside this program: one to two seconds.
//! An installed program has no library beside it: a generated package then builds one, once, from the
//! sources embedded here. The result is kept under a hash of model and eplat: an unchanged model
//! starts at once.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Output, Stdio};
use std::time::{Instant, SystemTime};

use include_dir::{Dir, include_dir};
use serde_json::json;

use super::cargo::counted;
use super::models::ModelFile;
use super::rustc::rendered;
use super::voice::tell;
use crate::error::Failure;
use crate::store::cache;
use crate::store::write_folder;

static SOURCES: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/src");
static ENGINE: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/engine/src");
static LANGUAGE: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/language/src");
static MACROS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/macros/src");
static ASSETS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/assets");
static MODELS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/models");
const MANIFEST: &str = include_str!("../../Cargo.toml");
const ENGINE_MANIFEST: &str = include_str!("../../engine/Cargo.toml");
const LANGUAGE_MANIFEST: &str = include_str!("../../language/Cargo.toml");
const MACROS_MANIFEST: &str = include_str!("../../macros/Cargo.toml");
const LOCK: &str = include_str!("../../Cargo.lock");

/// Tells the compiled program how long its compilation took, s.
pub(super) const COMPILE_SECONDS: &str = "EPLAT_COMPILE_SECONDS";

/// Runs this process's command line in a program that has `file`'s model in it.
pub(super) fn run_compiled(file: &ModelFile) -> Result<ExitCode, Failure> {
    let begun = Instant::now();
    let program = compiled(file)?;
    let seconds = begun.elapsed().as_secs_f64();
    let mut command = Command::new(&program);
    command.args(std::env::args_os().skip(1)).env(COMPILE_SECONDS, seconds.to_string());
    hand_over(command).map_err(|error| Failure::io("start", &program, &error))
}

/// Becomes the program, so that a signal to this process reaches it.
#[cfg(unix)]
fn hand_over(mut command: Command) -> std::io::Result<ExitCode> {
    Err(std::os::unix::process::CommandExt::exec(&mut command))
}

/// Waits for the program.
#[cfg(not(unix))]
fn hand_over(mut command: Command) -> std::io::Result<ExitCode> {
    let status = command.status()?;
    Ok(ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1)))
}

/// The program with `file`'s model in it, compiled if need be.
fn compiled(file: &ModelFile) -> Result<PathBuf, Failure> {
    let name = file.checked()?.model.name.to_string();
    let cache = cache::folder().ok_or_else(|| {
        Failure::new(
            "no folder to compile the model in\nhelp: set HOME or EPLAT_CACHE to a writable folder",
        )
    })?;
    let path = fs::canonicalize(&file.path).map_err(|e| Failure::io("find", &file.path, &e))?;
    let place = path.display().to_string();
    let modules = modules(&file.source, &path)?;
    let key = cache::key(&[
        file.source.as_bytes(),
        modules.as_bytes(),
        place.as_bytes(),
        identity().as_bytes(),
    ]);
    let program = cache.join("programs").join(&key[..32]);
    if program.is_file() {
        return Ok(program);
    }
    tell(
        "compiling",
        format_args!("compiling {} …", file.path.display()),
        json!({ "file": file.path }),
    );
    let package = cache.join("packages").join(&cache::key(&[place.as_bytes()])[..16]);
    let main =
        write_main(&package, &path, &name).map_err(|e| Failure::io("write", &package, &e))?;
    let unfinished = tempfile::Builder::new()
        .tempdir_in(&package)
        .map_err(|error| Failure::io("write", &package, &error))?;
    let built = unfinished.path().join("program");
    let output = match library_beside_this_program() {
        Some(library) => with_rustc(&main, &built, &library),
        None => with_cargo(&cache, &package, &built),
    }
    .map_err(|error| {
        Failure::new(format_args!(
            "cannot compile {}: {error}\nhelp: install Rust, or run a model that ships unedited",
            file.path.display()
        ))
    })?;
    if !output.status.success() {
        return Err(does_not_compile(file, &path, &output));
    }
    fs::create_dir_all(cache.join("programs"))
        .and_then(|()| fs::rename(&built, &program))
        .map_err(|error| Failure::io("write", &program, &error))?;
    Ok(program)
}

/// The text of the files that the model at `path` has as modules (`mod NAME;`), such as emulators.
fn modules(source: &str, path: &Path) -> Result<String, Failure> {
    let names =
        source.lines().filter_map(|line| line.trim().strip_prefix("mod ")?.strip_suffix(';'));
    let files = names.map(|name| path.with_file_name(name.trim()).with_extension("rs"));
    files
        .map(|file| fs::read_to_string(&file).map_err(|error| Failure::io("read", &file, &error)))
        .collect()
}

/// What tells this build of eplat from another.
fn identity() -> String {
    let file = |path: PathBuf| fs::metadata(path).map(|m| (m.len(), m.modified().ok())).ok();
    let program = std::env::current_exe().ok().and_then(file);
    let library = library_beside_this_program().and_then(file);
    format!("{} {program:?} {library:?}", env!("CARGO_PKG_VERSION"))
}

/// The library this program was linked from, among its dependencies in the folder `deps` beside it:
/// the newest that is not newer than the program. (Cargo refreshes `libeplat.rlib` itself only where
/// the library is asked for, which `cargo run` does not.)
fn library_beside_this_program() -> Option<PathBuf> {
    let program = std::env::current_exe().ok()?;
    let linked = fs::metadata(&program).and_then(|m| m.modified()).ok()?;
    newest_library(&program.parent()?.join("deps"), Some(linked))
}

/// The newest library of eplat in a folder of compiled crates, made no later than `last`.
fn newest_library(folder: &Path, last: Option<SystemTime>) -> Option<PathBuf> {
    let modified = |path: &Path| fs::metadata(path).and_then(|m| m.modified()).ok();
    let libraries = fs::read_dir(folder).ok()?.flatten().map(|e| e.path());
    let is_eplat = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("libeplat-") && name.ends_with(".rlib")
    };
    let dated = libraries.filter(is_eplat).filter_map(|path| Some((modified(&path)?, path)));
    dated.filter(|(time, _)| last.is_none_or(|last| *time <= last)).max().map(|(_, path)| path)
}

/// What a model of the user's own is compiled against.
#[derive(Clone, Copy, Debug)]
pub(super) enum Library {
    /// The library beside this program, in a checkout.
    Beside,
    /// The library that an installed program has built from its own sources.
    Built,
    /// An installed program has not built it yet.
    ToBuild,
}

/// What there is now.
pub(super) fn library() -> Library {
    let is_built = |cache: PathBuf| {
        let compiled = newest_library(&cache.join("target/release/deps"), None);
        unpacked_in(&cache).is_dir() && compiled.is_some()
    };
    if library_beside_this_program().is_some() {
        Library::Beside
    } else if cache::folder().is_some_and(is_built) {
        Library::Built
    } else {
        Library::ToBuild
    }
}

/// Where the sources of this build of eplat are unpacked.
fn unpacked_in(cache: &Path) -> PathBuf {
    cache.join("eplat").join(&cache::key(&[identity().as_bytes()])[..16])
}

/// The program around the model: `main.rs`, left alone if it is there already.
#[allow(clippy::unnecessary_debug_formatting, reason = "escapes as Rust needs it")]
fn write_main(package: &Path, model: &Path, name: &str) -> std::io::Result<PathBuf> {
    let file = model.file_name().unwrap_or(model.as_os_str());
    let text = format!(
        "#![recursion_limit = \"512\"]\n\n#[path = {model:?}]\nmod model;\n\n\
         fn main() -> std::process::ExitCode {{\n    \
         eplat::cli::main(&[eplat::cli::Compiled {{ file: {file:?}, source: include_str!({model:?}), model: &model::{name} }}])\n}}\n"
    );
    let main = package.join("src").join("main.rs");
    fs::create_dir_all(package.join("src"))?;
    if fs::read_to_string(&main).is_ok_and(|old| old == text) {
        return Ok(main); // untouched, so that cargo does not see a change
    }
    fs::write(&main, text)?;
    Ok(main)
}

/// In one codegen unit: a model is small, and several share so much that it is compiled twice.
fn with_rustc(main: &Path, built: &Path, library: &Path) -> std::io::Result<Output> {
    let mut dependencies = std::ffi::OsString::from("dependency=");
    dependencies.push(library.parent().unwrap_or(Path::new(".")));
    let mut eplat = std::ffi::OsString::from("eplat=");
    eplat.push(library);
    Command::new("rustc")
        .args(["--edition", "2024", "-C", "opt-level=3", "-C", "codegen-units=1"])
        .args(["--error-format=json", "--extern"])
        .arg(eplat)
        .arg("-L")
        .arg(dependencies)
        .arg("-o")
        .arg(built)
        .arg(main)
        .stdin(Stdio::null())
        .output()
}

fn with_cargo(cache: &Path, package: &Path, built: &Path) -> std::io::Result<Output> {
    let eplat = unpacked_in(cache);
    let is_first = !eplat.is_dir();
    if is_first {
        let text = "building the library that models are compiled against: minutes, this once …";
        tell("building_library", text, json!({}));
        fs::create_dir_all(cache.join("eplat"))?;
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
        fs::copy(target.join("release").join(name), built)?;
    }
    Ok(output)
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

/// What the compiler says of expressions: the model's own mistakes were found before.
fn does_not_compile(file: &ModelFile, path: &Path, output: &Output) -> Failure {
    let text = |bytes| String::from_utf8_lossy(bytes).into_owned();
    let said = rendered(&(text(&output.stdout) + &text(&output.stderr)));
    let given = file.path.display().to_string();
    let said = said.replace(&path.display().to_string(), &given);
    Failure::new(format_args!("{given} does not compile\n\n{said}\n\nhelp: {GENERIC}"))
}

const GENERIC: &str = "mend the expression there; a function that is given parameters or fields is generic: `fn f<D: Real>(x: D) -> D`";

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

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
