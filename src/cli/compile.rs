//! Compiles a model file that is not in this program, and hands the command line over to the result.
//!
//! A generated package in the cache folder has the model file as a module and eplat as its dependency:
//! from the checkout this program was built in, else from the sources embedded here. What it builds is
//! eplat again, with this one model in it, so it takes the same command line. The program is kept
//! under a hash of model and eplat: an unchanged model starts at once.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

use include_dir::{Dir, include_dir};

use super::models::ModelFile;
use crate::cache;
use crate::error::Failure;

static SOURCES: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/src");
static ASSETS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/assets");
static MODELS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/models");
const MANIFEST: &str = include_str!("../../Cargo.toml");
const LOCK: &str = include_str!("../../Cargo.lock");

/// Tells the compiled program how long its compilation took, s.
pub(super) const COMPILE_SECONDS: &str = "EPLAT_COMPILE_SECONDS";

/// Runs this process's command line in a program that has `file`'s model in it.
pub(super) fn run_compiled(file: &ModelFile) -> Result<ExitCode, Failure> {
    let begun = Instant::now();
    let program = compiled(file)?;
    let seconds = begun.elapsed().as_secs_f64();
    let status = Command::new(&program)
        .args(std::env::args_os().skip(1))
        .env(COMPILE_SECONDS, seconds.to_string())
        .status()
        .map_err(|error| Failure::io("start", &program, &error))?;
    Ok(ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1)))
}

/// The program with `file`'s model in it, compiled if need be.
fn compiled(file: &ModelFile) -> Result<PathBuf, Failure> {
    let name = file.model_name()?;
    let folder = cache::folder().ok_or_else(|| {
        Failure::new(
            "no folder to compile the model in\nhelp: set HOME or EPLAT_CACHE to a writable folder",
        )
    })?;
    let path = fs::canonicalize(&file.path).map_err(|e| Failure::io("find", &file.path, &e))?;
    let place = path.display().to_string();
    let key = cache::key(&[file.source.as_bytes(), place.as_bytes(), identity().as_bytes()]);
    let program = folder.join("programs").join(&key[..32]);
    if program.is_file() {
        return Ok(program);
    }
    eprintln!("compiling {} …", file.path.display());
    let package = Package {
        folder: folder.join("packages").join(&cache::key(&[place.as_bytes()])[..16]),
        eplat: eplat_sources(&folder)?,
        target: target_folder(&folder),
    };
    let built = package.build(&path, name, file)?;
    keep(&built, &program).map_err(|error| Failure::io("write", &program, &error))?;
    Ok(program)
}

/// What tells this build of eplat from another.
fn identity() -> String {
    let modified =
        std::env::current_exe().and_then(fs::metadata).map(|m| (m.len(), m.modified().ok()));
    format!("{} {modified:?}", env!("CARGO_PKG_VERSION"))
}

/// The checkout this program was built in, if it is still there; else the embedded sources, unpacked.
fn eplat_sources(cache: &Path) -> Result<PathBuf, Failure> {
    let checkout = Path::new(env!("CARGO_MANIFEST_DIR"));
    if fs::read_to_string(checkout.join("Cargo.toml")).is_ok_and(|text| text == MANIFEST) {
        return Ok(checkout.to_owned());
    }
    let folder = cache.join(format!("eplat-{}", env!("CARGO_PKG_VERSION")));
    unpack(&folder)
        .map_err(|error| Failure::io("unpack the sources of eplat into", &folder, &error))?;
    Ok(folder)
}

fn unpack(folder: &Path) -> std::io::Result<()> {
    for (name, dir) in [("src", &SOURCES), ("assets", &ASSETS), ("models", &MODELS)] {
        fs::create_dir_all(folder.join(name))?;
        dir.extract(folder.join(name))?;
    }
    fs::write(folder.join("Cargo.toml"), MANIFEST)?;
    fs::write(folder.join("Cargo.lock"), LOCK)
}

/// Where cargo keeps what it builds: shared with the checkout's own builds where this program is one
/// of them, so that no dependency is built twice.
fn target_folder(cache: &Path) -> PathBuf {
    let exe = std::env::current_exe().ok();
    let shared = exe
        .as_deref()
        .and_then(Path::parent)
        .filter(|dir| dir.ends_with("release") && Path::new(env!("CARGO_MANIFEST_DIR")).is_dir());
    match shared.and_then(Path::parent) {
        Some(target) => target.to_owned(),
        None => cache.join("target"),
    }
}

struct Package {
    folder: PathBuf,
    eplat: PathBuf,
    target: PathBuf,
}

impl Package {
    fn build(&self, model: &Path, name: &str, file: &ModelFile) -> Result<PathBuf, Failure> {
        let package =
            format!("model-{}", &cache::key(&[model.display().to_string().as_bytes()])[..16]);
        self.write(&package, model, name).map_err(|e| Failure::io("write", &self.folder, &e))?;
        let output = Command::new("cargo")
            .args(["build", "--release", "--offline", "--quiet", "--manifest-path"])
            .arg(self.folder.join("Cargo.toml"))
            .env("CARGO_TARGET_DIR", &self.target)
            .stdin(Stdio::null())
            .output()
            .map_err(|error| {
                Failure::new(format_args!(
                    "cannot start cargo to compile {}: {error}\nhelp: install Rust, or run a model that ships unedited",
                    file.path.display()
                ))
            })?;
        if output.status.success() {
            return Ok(self.target.join("release").join(package));
        }
        let text = String::from_utf8_lossy(&output.stderr);
        let own = |line: &&str| {
            !line.starts_with("error: could not compile")
                && !line.starts_with("For more information")
        };
        let text = text.lines().filter(own).collect::<Vec<_>>().join("\n");
        Err(Failure::new(format_args!(
            "the model file does not compile\n{}\nhelp: mend {} at the places above; `eplat show` prints a model's equations once it compiles",
            text.trim_end(),
            file.path.display()
        )))
    }

    #[allow(clippy::unnecessary_debug_formatting, reason = "escapes as Rust and TOML need it")]
    fn write(&self, package: &str, model: &Path, name: &str) -> std::io::Result<()> {
        let profile =
            MANIFEST.split("[profile.release]").nth(1).and_then(|t| t.split("\n\n").next());
        let manifest = format!(
            "[package]\nname = \"{package}\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n\
             [dependencies]\neplat = {{ path = {eplat:?} }}\n\n[workspace]\n\n[profile.release]{}\n",
            profile.unwrap_or_default(),
            eplat = self.eplat,
        );
        let main = format!(
            "#[path = {model:?}]\nmod model;\n\n\
             fn main() -> std::process::ExitCode {{\n    \
             eplat::cli::main(&[eplat::cli::Compiled {{ source: include_str!({model:?}), model: &model::{name} }}])\n}}\n"
        );
        fs::create_dir_all(self.folder.join("src"))?;
        if !self.folder.join("Cargo.lock").exists() {
            fs::write(self.folder.join("Cargo.lock"), LOCK)?;
        }
        for (path, text) in [("Cargo.toml", manifest), ("src/main.rs", main)] {
            let path = self.folder.join(path);
            if fs::read_to_string(&path).is_ok_and(|old| old == text) {
                continue; // untouched, so that cargo does not see a change
            }
            fs::write(path, text)?;
        }
        Ok(())
    }
}

/// Copies a built program to its place in one step.
fn keep(built: &Path, program: &Path) -> std::io::Result<()> {
    let folder = program.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let temporary = tempfile::Builder::new().tempfile_in(folder)?.into_temp_path();
    fs::copy(built, &temporary)?;
    temporary.persist(program)?;
    Ok(())
}
