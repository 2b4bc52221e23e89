//! Compiles a model file that only a compiler understands, and hands the command line over to the result.
//!
//! What is compiled is eplat again, with this one model in it, so it takes the same command line. It takes
//! one to two seconds, once there is a library to compile it against ([`super::library`]). The result is
//! kept ([`super::programs`]): an unchanged model starts at once.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Output, Stdio};
use std::time::{Instant, SystemTime};

use serde_json::json;

use super::library::{LIBRARY, TEXT, linked_from, with_cargo};
use super::models::ModelFile;
use super::programs::{self, PROGRAM, READ, Sources};
use super::rustc::{has_errors, rendered};
use super::voice::{note, tell};
use crate::error::Failure;
use crate::store::{cache, free_on_disk};

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
    let cache = std::path::absolute(&cache).map_err(|e| Failure::io("find", &cache, &e))?;
    let path = fs::canonicalize(&file.path).map_err(|e| Failure::io("find", &file.path, &e))?;
    let place = path.display().to_string();
    let key = cache::key(&[file.source.as_bytes(), place.as_bytes(), TEXT.as_bytes()]);
    if let Some(program) = programs::find(&cache, &key) {
        return Ok(program);
    }
    let package = cache.join("packages").join(&cache::key(&[place.as_bytes()])[..16]);
    let _alone = alone_in(&package).map_err(|e| unwritable(&package, &e))?;
    // another process may have compiled it meanwhile
    if let Some(program) = programs::find(&cache, &key) {
        return Ok(program);
    }
    tell(
        "compiling",
        format_args!("compiling {} …", file.path.display()),
        json!({ "file": file.path }),
    );
    let begun = SystemTime::now();
    let main =
        write_main(&package, &path, &name, &file.source).map_err(|e| unwritable(&package, &e))?;
    let unfinished = tempfile::Builder::new()
        .prefix(UNFINISHED)
        .tempdir_in(&package)
        .map_err(|error| unwritable(&package, &error))?;
    let output = build(&cache, &main, unfinished.path()).map_err(|error| {
        Failure::new(format_args!(
            "cannot compile {}: {error}\nhelp: install Rust (https://rustup.rs): `{}` needs its compiler; what the language says itself needs none",
            file.path.display(),
            file.needs_a_compiler_for()
        ))
    })?;
    if !output.status.success() {
        let said = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
        let said = said.concat();
        return Err(
            full_disk(&cache, &said).unwrap_or_else(|| does_not_compile(file, &path, &said))
        );
    }
    let sources = Sources::read(&unfinished.path().join(READ), &[&package, &cache.join(LIBRARY)])
        .map_err(|error| Failure::io("read", &unfinished.path().join(READ), &error))?;
    unchanged(file, &sources, begun)?;
    let program = programs::keep(&cache, &key, &unfinished.path().join(PROGRAM), &sources)
        .map_err(|error| unwritable(&cache.join("programs"), &error))?;
    cache::sweep(&cache, cache::LIMIT);
    for package in fs::read_dir(cache.join("packages")).into_iter().flatten().flatten() {
        sweep_package(&package.path());
    }
    Ok(program)
}

/// That a folder of the cache cannot be written: a model can be compiled nowhere else.
fn unwritable(folder: &Path, error: &std::io::Error) -> Failure {
    let is_full = error.kind() == std::io::ErrorKind::StorageFull;
    let first = if is_full { "make room there, or " } else { "" };
    Failure::new(format_args!(
        "cannot write {}: {error}\nhelp: {first}set EPLAT_CACHE to a folder that you may write to, with room for a program ({} MB)",
        folder.display(),
        ROOM / 1_000_000
    ))
}

/// Removes what killed processes left of another model, unless one compiles it now.
fn sweep_package(package: &Path) {
    let lock = File::open(package.join("lock"));
    if lock.is_ok_and(|lock| lock.try_lock().is_ok()) {
        // what cannot be removed takes room, no more
        let _ = remove_unfinished(package);
    }
}

fn remove_unfinished(package: &Path) -> std::io::Result<()> {
    for entry in fs::read_dir(package)?.flatten() {
        if entry.file_name().to_string_lossy().starts_with(UNFINISHED) {
            fs::remove_dir_all(entry.path())?;
        }
    }
    Ok(())
}

/// How the names of folders begin in which a model is compiled.
const UNFINISHED: &str = ".tmp";

/// Waits until no other process compiles in `package`, and removes what killed ones left there; the file is a lock.
fn alone_in(package: &Path) -> std::io::Result<File> {
    fs::create_dir_all(package)?;
    let lock = File::create(package.join("lock"))?;
    match lock.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            note("another eplat compiles this model: waiting for it …");
            lock.lock()?;
        }
        // a file system without locks: two processes may do the same work
        Err(TryLockError::Error(_)) => return Ok(lock),
    }
    remove_unfinished(package)?;
    Ok(lock)
}

/// Makes [`PROGRAM`] and [`READ`] in the folder `unfinished`.
fn build(cache: &Path, main: &Path, unfinished: &Path) -> std::io::Result<Output> {
    match linked_from().map(|library| with_rustc(main, unfinished, &library)) {
        Some(Ok(output)) if !is_of_another_compiler(&output) => Ok(output),
        Some(Err(error)) => Err(error),
        _ => with_cargo(cache, unfinished),
    }
}

/// Complains if the compiler may have read another text than the one that the program is kept for.
fn unchanged(file: &ModelFile, sources: &Sources, begun: SystemTime) -> Result<(), Failure> {
    let is_same = fs::read_to_string(&file.path).is_ok_and(|text| text == file.source);
    let own = (!is_same).then(|| file.path.display().to_string());
    let Some(changed) = own.or_else(|| sources.changed_since(begun).map(str::to_owned)) else {
        return Ok(());
    };
    Err(Failure::new(format_args!(
        "{changed} was saved while the model was compiled\nhelp: give the command again"
    )))
}

/// The program around the model: `main.rs`, left alone if it is there already.
#[allow(clippy::unnecessary_debug_formatting, reason = "escapes as Rust needs it")]
fn write_main(package: &Path, model: &Path, name: &str, source: &str) -> std::io::Result<PathBuf> {
    let file = model.file_name().unwrap_or(model.as_os_str());
    let text = format!(
        "#![recursion_limit = \"512\"]\n\n#[path = {model:?}]\nmod model;\n\n\
         fn main() -> std::process::ExitCode {{\n    \
         eplat::cli::main(&[eplat::cli::Compiled {{ file: {file:?}, source: {source:?}, model: &model::{name} }}])\n}}\n"
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
fn with_rustc(main: &Path, unfinished: &Path, library: &Path) -> std::io::Result<Output> {
    let mut dependencies = std::ffi::OsString::from("dependency=");
    dependencies.push(library.parent().unwrap_or(Path::new(".")));
    let mut eplat = std::ffi::OsString::from("eplat=");
    eplat.push(library);
    Command::new("rustc")
        .current_dir(unfinished)
        .args(["--edition", "2024", "-C", "opt-level=3", "-C", "codegen-units=1"])
        .args([format!("--emit=link={PROGRAM}"), format!("--emit=dep-info={READ}")])
        .args(["--error-format=json", "--extern"])
        .arg(eplat)
        .arg("-L")
        .arg(dependencies)
        .arg(main)
        .stdin(Stdio::null())
        .output()
}

/// What a model takes on the disk while it is compiled, bytes.
const ROOM: u64 = 64_000_000;

/// That a disk is full, if the compiler failed and found no error: a linker dies of it without a word of the disk.
fn full_disk(cache: &Path, said: &str) -> Option<Failure> {
    let temporary = std::env::temp_dir();
    let folders = [("EPLAT_CACHE", cache), ("TMPDIR", &*temporary)].into_iter();
    let mut free = folders.filter_map(|(variable, at)| Some((free_on_disk(at)?, variable, at)));
    let (free, variable, folder) = free.find(|(free, ..)| *free < ROOM && !has_errors(said))?;
    let megabytes = |bytes: u64| bytes / 1_000_000;
    Some(Failure::new(format_args!(
        "cannot write {}: No space left on device, or too little for a compiler: {} MB are free, {} MB are needed\n\
         help: make room there, or set {variable} to a folder on a disk that has it",
        folder.display(),
        megabytes(free),
        megabytes(ROOM)
    )))
}

/// What the compiler says of expressions: the model's own mistakes were found before.
fn does_not_compile(file: &ModelFile, path: &Path, said: &str) -> Failure {
    let given = file.path.display().to_string();
    let said = rendered(said).replace(&path.display().to_string(), &given);
    Failure::new(format_args!("{given} does not compile\n\n{said}\n\nhelp: {GENERIC}"))
}

const GENERIC: &str = "mend the expression there; a function that is given parameters or fields is generic: `fn f<D: Real>(x: D) -> D`";
