//! Compiles a model file that is not in this program, and hands the command line over to the result.
//!
//! What is compiled is eplat again, with this one model in it, so it takes the same command line. It takes
//! one to two seconds, once there is a library to compile it against ([`super::library`]). The result is
//! kept under a hash of model and eplat: an unchanged model starts at once.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Output, Stdio};
use std::time::Instant;

use serde_json::json;

use super::library::{TEXT, linked_from, with_cargo};
use super::models::ModelFile;
use super::rustc::rendered;
use super::voice::tell;
use crate::error::Failure;
use crate::store::cache;

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
        TEXT.as_bytes(),
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
    let output = match linked_from().map(|library| with_rustc(&main, &built, &library)) {
        Some(Ok(output)) if !is_of_another_compiler(&output) => Ok(output),
        Some(Err(error)) => Err(error),
        _ => with_cargo(&cache, &package, &built),
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

/// Whether the library, or one below it, is not there or was made by another version of the compiler.
fn is_of_another_compiler(output: &Output) -> bool {
    let said = String::from_utf8_lossy(&output.stderr);
    ["E0460", "E0463", "E0514"].iter().any(|code| said.contains(&format!("\"code\":\"{code}\"")))
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

/// What the compiler says of expressions: the model's own mistakes were found before.
fn does_not_compile(file: &ModelFile, path: &Path, output: &Output) -> Failure {
    let text = |bytes| String::from_utf8_lossy(bytes).into_owned();
    let said = rendered(&(text(&output.stdout) + &text(&output.stderr)));
    let given = file.path.display().to_string();
    let said = said.replace(&path.display().to_string(), &given);
    Failure::new(format_args!("{given} does not compile\n\n{said}\n\nhelp: {GENERIC}"))
}

const GENERIC: &str = "mend the expression there; a function that is given parameters or fields is generic: `fn f<D: Real>(x: D) -> D`";
