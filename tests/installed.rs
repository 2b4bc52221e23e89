//! The installed program, in an empty home, runs a model of one's own: the README's, edited.
//!
//! That needs the program alone. A model with Rust code in it is compiled; without what an installation leaves, the
//! library is built for the first of them, as on a user's machine: minutes. So that is asked for by name
//! (`cargo test --release --test installed -- --ignored`), as `.ci/run` does.
#![allow(clippy::unwrap_used, reason = "tests")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The folder of the compiler itself: the proxies of rustup look for it in the home that is empty here.
fn toolchain() -> PathBuf {
    let output = Command::new("rustc").args(["--print", "sysroot"]).output().unwrap();
    Path::new(String::from_utf8(output.stdout).unwrap().trim()).join("bin")
}

/// Where cargo keeps the packages that it has downloaded. It is the caller's: an empty one would be filled over
/// the network, which says nothing of eplat.
fn cargo_home() -> PathBuf {
    let home = || PathBuf::from(std::env::var_os("HOME").unwrap()).join(".cargo");
    std::env::var_os("CARGO_HOME").map_or_else(home, PathBuf::from)
}

/// Both streams.
fn said(output: &Output) -> String {
    let text = |bytes| String::from_utf8_lossy(bytes).into_owned();
    text(&output.stdout) + &text(&output.stderr)
}

/// Copies the crates below eplat's own that are compiled already beside this test: the installation would compile them
/// again just so. Its own crate knows where it was compiled.
fn bring_along(target: &Path) {
    let built = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("release");
    for folder in [".fingerprint", "build", "deps"] {
        let to = target.join("release").join(folder);
        fs::create_dir_all(&to).unwrap();
        let entries = fs::read_dir(built.join(folder)).unwrap();
        let entries = entries.map(|entry| entry.unwrap().path()).filter(|path| is_below(path));
        // with their times, by which cargo knows them
        Command::new("cp").arg("-a").args(entries).arg(&to).status().unwrap();
    }
}

/// Whether this is of another crate than eplat's own, and no program.
fn is_below(path: &Path) -> bool {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let package = name.rsplit_once('-').map_or(&*name, |(package, _)| package);
    let ending = path.extension().unwrap_or_default();
    let is_library = ["rlib", "rmeta", "so", "d"].iter().any(|own| ending == *own);
    package.trim_start_matches("lib") != "eplat" && (path.is_dir() || is_library)
}

/// The README's own model, edited.
fn model() -> String {
    let (_, after) = include_str!("../README.md").split_once("```rust\n").unwrap();
    let (model, _) = after.split_once("```").unwrap();
    let edited = model.replace("m     [ms] ~ Flat", "m     [ms] ~ Normal(150.0, 200.0)");
    assert_ne!(edited, model);
    edited
}

/// The program is copied, nothing else is there, and where this user may become another it is another.
#[cfg(unix)]
#[test]
fn a_copy_of_the_program_runs_a_model_of_ones_own_for_another_user() {
    use std::os::unix::fs::{PermissionsExt as _, chown};
    use std::os::unix::process::CommandExt as _;

    const NOBODY: u32 = 65534;
    let place = tempfile::tempdir().unwrap();
    fs::set_permissions(place.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let (program, home) = (place.path().join("eplat"), place.path().join("home"));
    fs::copy(env!("CARGO_BIN_EXE_eplat"), &program).unwrap();
    fs::create_dir(&home).unwrap();
    fs::write(home.join("mine.rs"), model()).unwrap();
    let is_other = chown(&home, Some(NOBODY), Some(NOBODY)).is_ok();
    let mut run = Command::new(&program);
    run.args(["run", "mine.rs", "--out", "out"]).env_clear().env("HOME", &home).current_dir(&home);
    if is_other {
        run.uid(NOBODY).gid(NOBODY);
    }
    let run = run.output().unwrap();
    assert_eq!(run.status.code(), Some(0), "{}", said(&run));
    assert!(said(&run).contains("Converged"), "{}", said(&run));
    assert!(home.join("out/run.json").is_file());
}

#[test]
#[ignore = "builds the library: minutes"]
fn the_installed_program_runs_a_model_of_ones_own() {
    let place = tempfile::tempdir().unwrap();
    let folder = |name: &str| {
        let folder = place.path().join(name);
        fs::create_dir(&folder).unwrap();
        folder
    };
    let [home, root, work, target] = ["home", "root", "work", "target"].map(folder);
    bring_along(&target);
    let installed = Command::new(env!("CARGO"))
        .args(["install", "--quiet", "--locked", "--path", env!("CARGO_MANIFEST_DIR"), "--root"])
        .arg(&root)
        .arg("--target-dir")
        .arg(&target)
        .output()
        .unwrap();
    assert!(installed.status.success(), "{}", said(&installed));

    fs::write(work.join("mine.rs"), model() + "\n/// Rust, which is compiled.\nstruct Own;\n")
        .unwrap();
    let path = std::env::join_paths([toolchain(), "/usr/bin".into(), "/bin".into()]).unwrap();
    // the library that is built below is not run for long
    let eplat = |arguments: &[&str]| {
        Command::new(root.join("bin/eplat"))
            .args(arguments)
            .env_clear()
            .env("HOME", &home)
            .env("CARGO_HOME", cargo_home())
            .env("PATH", &path)
            .env("CARGO_PROFILE_RELEASE_OPT_LEVEL", "0")
            .current_dir(&work)
            .output()
            .unwrap()
    };
    // compiled against what the installation left
    let run = eplat(&["run", "mine.rs", "--out", "out"]);
    let words = said(&run);
    assert_eq!(run.status.code(), Some(0), "{words}");
    assert!(!words.contains("minutes, this once") && words.contains("Converged"), "{words}");
    assert!(work.join("out/run.json").is_file(), "{words}");

    // and once it is compiled it starts at once
    let checked = eplat(&["check", "mine.rs"]);
    assert!(!said(&checked).contains("compiling"), "{}", said(&checked));

    // on another machine, or after `cargo clean`, there is nothing left of it
    fs::remove_dir_all(&target).unwrap();
    let edited = fs::read_to_string(work.join("mine.rs")).unwrap();
    fs::write(work.join("mine.rs"), edited.replace("Normal(150.0, 200.0)", "Normal(160.0, 200.0)"))
        .unwrap();
    let words = said(&eplat(&["doctor"]));
    assert!(words.contains("not built yet"), "{words}");
    let checked = eplat(&["check", "mine.rs"]);
    let words = said(&checked);
    assert_eq!(checked.status.code(), Some(0), "{words}");
    assert!(words.contains("minutes, this once") && words.contains("log density"), "{words}");
    let words = said(&eplat(&["doctor"]));
    assert!(words.contains("built: a model with Rust code compiles in seconds"), "{words}");
}
