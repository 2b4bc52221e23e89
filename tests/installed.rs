//! The installed program, in an empty home, runs a model of one's own: the README's, edited.
//!
//! Without what an installation leaves, the library is built for the first model, as on a user's machine: minutes. So
//! it is asked for by name (`cargo test --release --test installed -- --ignored`), as `.ci/run` does.
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

    let (_, after) = include_str!("../README.md").split_once("```rust\n").unwrap();
    let (model, _) = after.split_once("```").unwrap();
    fs::write(
        work.join("mine.rs"),
        model.replace("m     [ms] ~ Flat", "m     [ms] ~ Normal(150.0, 200.0)"),
    )
    .unwrap();
    let path = std::env::join_paths([toolchain(), "/usr/bin".into(), "/bin".into()]).unwrap();
    let eplat = |arguments: &[&str]| {
        Command::new(root.join("bin/eplat"))
            .args(arguments)
            .env_clear()
            .env("HOME", &home)
            .env("CARGO_HOME", cargo_home())
            .env("PATH", &path)
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
    let run = eplat(&["run", "mine.rs", "--out", "again"]);
    let words = said(&run);
    assert_eq!(run.status.code(), Some(0), "{words}");
    assert!(words.contains("minutes, this once") && words.contains("Converged"), "{words}");
    let words = said(&eplat(&["doctor"]));
    assert!(words.contains("built: a model of your own compiles in seconds"), "{words}");
}
