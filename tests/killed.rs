//! Every long command, killed at any step: what it had written by then is whole, and the command given again ends
//! with the files of one that nobody disturbed.
//!
//! A step is what can be seen from outside: a file that appears, grows or is replaced in the output folder or the
//! cache, or a line of `--json`. Kills are drawn in steps, not in time, and are seeded.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/contents.rs"]
mod contents;
#[path = "support/program.rs"]
mod program;
#[path = "support/sheet.rs"]
mod sheet;
#[path = "support/sphere.rs"]
mod sphere;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use contents::{contents, same_files};
use eplat::store::seal_of;
use program::{Workplace, text};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Records, each of which names the files beside it.
const RECORDS: [&str; 10] = [
    "run.json",
    "map.json",
    "finding.json",
    "predictions.json",
    "figures.json",
    "simulation.json",
    "cell.json",
    "export.json",
    "import.json",
    "experiment.json",
];

/// A command that writes into the folder `OUT`, and is killed `kills` times.
struct Long {
    arguments: &'static str,
    /// What to add to go on with it; nothing, where it is simply given again.
    resume: &'static str,
    /// Whether other commands may write into the folder at the same time.
    is_shared: bool,
    /// With what words it refuses to begin again when it had ended before the kill; empty, where it does not.
    refusal: &'static str,
    kills: usize,
}

/// How a command ended that was watched.
#[derive(Debug)]
enum End {
    Killed,
    /// Exit code, and what it said.
    Ended(Option<i32>, String),
}

/// Length, date and place of every file below the folders.
fn files(folders: &[PathBuf], found: &mut BTreeMap<PathBuf, (u64, i64, u64)>) {
    for entry in folders.iter().filter_map(|folder| fs::read_dir(folder).ok()).flatten().flatten() {
        // it may be gone by now
        let Ok(metadata) = entry.metadata() else { continue };
        if metadata.is_dir() {
            files(&[entry.path()], found);
        } else {
            let stamp = (metadata.len(), metadata.mtime_nsec(), metadata.ino());
            found.insert(entry.path(), stamp);
        }
    }
}

/// Runs a command and kills it at its step `until`; how it ended, and after how many steps.
fn watch(mut command: Command, folders: &[PathBuf], until: usize) -> (End, usize) {
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let stderr = BufReader::new(child.stderr.take().unwrap());
    let n_lines = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&n_lines);
    let listener = std::thread::spawn(move || {
        let lines = stderr.lines().map_while(Result::ok);
        let count = |_: &String| {
            counted.fetch_add(1, Ordering::Relaxed);
        };
        lines.inspect(count).collect::<Vec<_>>().join("\n")
    });
    let (mut before, mut n_changes) = (BTreeMap::new(), 0);
    files(folders, &mut before);
    loop {
        // asked before the folders are looked at: what a command did last is counted as well
        let status = child.try_wait().unwrap();
        let mut now = BTreeMap::new();
        files(folders, &mut now);
        n_changes += now.iter().filter(|(path, stamp)| before.get(*path) != Some(stamp)).count();
        before = now;
        if let Some(status) = status {
            let said = listener.join().unwrap();
            return (End::Ended(status.code(), said), n_changes + n_lines.load(Ordering::Relaxed));
        }
        let steps = n_changes + n_lines.load(Ordering::Relaxed);
        if steps >= until {
            child.kill().unwrap();
            child.wait().unwrap();
            return (End::Killed, steps);
        }
        std::thread::sleep(Duration::from_micros(200));
    }
}

/// Whether this is the record of a study that is not complete: it does not name its files yet.
fn is_begun(bytes: &[u8], whole: Option<&Vec<u8>>) -> bool {
    let record = |bytes: &[u8]| serde_json::from_slice::<serde_json::Map<_, _>>(bytes).ok();
    let mut whole = whole.and_then(|whole| record(whole));
    let files = whole.as_mut().and_then(|whole| whole.remove("files"));
    files.is_some() && record(bytes) == whole
}

/// What a killed command may leave besides final files: what it goes on from, and what the next one sweeps.
fn is_unfinished(path: &Path) -> bool {
    path.iter().any(|name| name == "checkpoint" || name.to_str().unwrap().starts_with(".eplat-"))
}

/// Whether a folder has a record of its own, or all that is in it has.
fn has_own(path: &Path) -> bool {
    let below = || fs::read_dir(path).into_iter().flatten().map(|entry| entry.unwrap().path());
    RECORDS.iter().any(|record| path.join(record).exists())
        || below().next().is_some() && below().all(|path| has_own(&path))
}

/// Every file that a killed command left is named in the record beside it, with its hash; or something else there
/// tells the next command that this one was not through.
fn is_named(folder: &Path) {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let entries: Vec<PathBuf> = entries.filter(|path| !is_unfinished(path)).collect();
    let name = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
    let told = entries.iter().find(|path| RECORDS.contains(&&*name(path))).map(|path| {
        let told: serde_json::Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
        (path, told["files"].as_object().unwrap().clone())
    });
    if let Some((record, named)) = &told {
        for path in entries.iter().filter(|path| path != record && !has_own(path)) {
            // or all that is in a folder is, or has records of its own
            let below = fs::read_dir(path).into_iter().flatten().map(|entry| entry.unwrap().path());
            let mut below = below.filter(|path| !has_own(path)).peekable();
            let is_named =
                |at: &Path| named.contains_key(at.strip_prefix(folder).unwrap().to_str().unwrap());
            let is_whole = below.peek().is_some() && below.all(|path| is_named(&path));
            assert!(is_named(path) || is_whole, "{} is not named", path.display());
        }
        for (name, seal) in named {
            let found = seal_of(&folder.join(name)).unwrap();
            assert_eq!(seal.as_str(), Some(&*found), "{name} in {}", folder.display());
        }
    }
    let tellers = [".eplat-replacing", "checkpoint", "settings.json"];
    let is_told = tellers.iter().any(|name| folder.join(name).exists());
    for path in entries.iter().filter(|_| told.is_none() && !is_told) {
        assert!(path.is_dir(), "of {} no record tells", path.display());
        is_named(path);
    }
    entries.iter().filter(|path| has_own(path)).for_each(|path| is_named(path));
}

impl Long {
    fn command(&self, place: &Workplace, out: &str, resume: &str) -> Command {
        let mut command =
            place.command(&format!("{} {resume}", self.arguments.replace("OUT", out)));
        command.env("EPLAT_CACHE", place.path("cache"));
        command
    }

    /// Gives the command, as its own words advise after an interruption, and kills it at step `until`.
    fn go_on(&self, place: &Workplace, until: usize) -> End {
        let folders = ["cut", "cache"].map(|name| place.path(name));
        let (end, _) = watch(self.command(place, "cut", self.resume), &folders, until);
        match end {
            End::Ended(Some(1), said) if said.contains("no interrupted run") => {
                watch(self.command(place, "cut", ""), &folders, until).0
            }
            end => end,
        }
    }

    fn check(&self, place: &Workplace) {
        let name = self.arguments;
        for folder in ["whole", "cut", "cache"] {
            fs::remove_dir_all(place.path(folder)).unwrap_or_default();
            fs::create_dir(place.path(folder)).unwrap();
        }
        let folders = ["whole", "cache"].map(|name| place.path(name));
        let (end, n_steps) = watch(self.command(place, "whole", ""), &folders, usize::MAX);
        let End::Ended(code, said) = end else { unreachable!() };
        assert!(matches!(code, Some(0 | 3 | 4)), "{name}: {said}");
        let whole: BTreeMap<PathBuf, Vec<u8>> =
            contents(&place.path("whole")).into_iter().collect();
        let mut rng = ChaCha8Rng::seed_from_u64(name.bytes().map(u64::from).sum());
        let (mut kills, mut ends) = (0, 0);
        while kills < self.kills || ends == 0 {
            assert!(ends <= 10 * self.kills, "{name}: it is hardly ever killed");
            let is_last = kills == self.kills;
            let until = if is_last { usize::MAX } else { rng.random_range(1..=n_steps) };
            match self.go_on(place, until) {
                End::Killed => {
                    kills += 1;
                    for (path, bytes) in contents(&place.path("cut")) {
                        let is_whole = whole.get(&path) == Some(&bytes)
                            || path.ends_with("study.json") && is_begun(&bytes, whole.get(&path));
                        assert!(is_whole || is_unfinished(&path), "{name}: {}", path.display());
                    }
                    if !self.is_shared {
                        is_named(&place.path("cut"));
                    }
                }
                End::Ended(again, said) => {
                    let was_there = !self.refusal.is_empty() && said.contains(self.refusal);
                    assert!(again == code || was_there, "{name}: {again:?} {said}");
                    ends += 1;
                    self.forget_unfinished(place);
                    same_files(&place.path("whole"), &place.path("cut"));
                    for folder in ["cut", "cache"] {
                        fs::remove_dir_all(place.path(folder)).unwrap_or_default();
                    }
                    fs::create_dir_all(place.path("cut")).unwrap();
                }
            }
        }
    }

    /// Where several commands may write at a time, or a folder is made beside others, what a killed one left is swept
    /// when it is older than a minute.
    fn forget_unfinished(&self, place: &Workplace) {
        if self.is_shared {
            let mut found = BTreeMap::new();
            files(&[place.path("cut")], &mut found);
            let is_left = |path: &&PathBuf| is_unfinished(Path::new(path.file_name().unwrap()));
            found.keys().filter(is_left).for_each(|path| fs::remove_file(path).unwrap());
        } else if self.arguments.contains("OUT/") {
            let entries = fs::read_dir(place.path("cut")).unwrap().map(|entry| entry.unwrap());
            let left = entries.filter(|entry| is_unfinished(Path::new(&entry.file_name())));
            left.for_each(|entry| fs::remove_dir_all(entry.path()).unwrap());
        }
    }
}

#[test]
fn runs() {
    let long = "--chains 2 --json --checkpoint-every 0 --out OUT";
    for (arguments, kills) in [
        (format!("run erp --sampler nuts --warmup 60 --draws 60 {long}"), 9),
        (format!("run erp --warmup 60 --draws 100 {long}"), 9),
        (format!("run voltage --warmup 60 --draws 60 {long}"), 6),
    ] {
        let arguments = arguments.leak();
        Long { arguments, resume: "--resume", is_shared: false, refusal: "", kills }
            .check(&Workplace::new());
    }
}

#[test]
fn a_loop() {
    let place = Workplace::new();
    sheet::write(&place.path("sheet.vtp"));
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for (name, first) in [("train.csv", 0), ("heldout.csv", 2)] {
        let mut table = "site,vertex,protocol,lower,upper,force_g\n".to_owned();
        for vertex in (first..sheet::N).step_by(4) {
            let force: f64 = rng.random_range(-2.0..2.0);
            let mean = 90.0 - 10.0 * force + rng.random_range(-3.0..3.0);
            let lower = 10.0 * (mean / 10.0).floor();
            let _ = writeln!(table, "{vertex},{vertex},S1S2,{lower},{},{force:.3}", lower + 10.0);
        }
        place.file(name, table);
    }
    let arguments = "loop recovery --mesh sheet.vtp --units mm --data train.csv --heldout heldout.csv \
                     --nulls 19 --json --out OUT";
    Long { arguments, resume: "--resume", is_shared: false, refusal: "", kills: 9 }.check(&place);
}

#[test]
fn a_study() {
    let place = Workplace::new().with_erp();
    let plan = "model = \"erp.rs\"\nlengthscales = [64.0, 128.0]\nsites = [5]\nresolutions = [10.0]\nfields = 2\n\
                designs = 1\nwarmup = 60\ndraws = 60\n";
    place.file("plan.toml", plan);
    let arguments = "study run plan.toml --json --out OUT";
    Long { arguments, resume: "", is_shared: true, refusal: "", kills: 8 }.check(&place);
}

#[test]
fn an_experiment() {
    let place = Workplace::new();
    sphere::write(&place.path("sphere.vtk"));
    let arguments = "study experiment --mesh sphere.vtk --units mm --lengthscale 12 --sites 5 --chains 2 --warmup 60 \
                     --draws 40 --beats 1 --json --out OUT";
    Long { arguments, resume: "", is_shared: false, refusal: "", kills: 6 }.check(&place);
}

#[test]
fn the_simulator() {
    let place = Workplace::new();
    sheet::write(&place.path("sheet.vtp"));
    let sets = "cv_max_m_per_s,tau_in_ms,tau_out_ms,tau_open_ms,apd_max_ms\n0.7,0.05,10,120,200\n0.8,0.05,10,120,210\n";
    place.file("sets.csv", sets);
    let design = include_str!("../engine/src/surrogate/erp_design.csv");
    place.file("design.csv", design);
    let atrium = "simulate atrium --fields sheet.vtp --units mm --refine 1 --tau-out 8 --apd-max 200 --pace 0 --beats 1 \
                  --last 300 --snapshots 30 --json --checkpoint-every 0 --out OUT";
    Long { arguments: atrium, resume: "--resume", is_shared: false, refusal: "", kills: 7 }
        .check(&place);
    let strip = "simulate strip --params sets.csv --beats 2 --cable --json --out OUT/o.csv --restitution OUT/c.csv";
    Long { arguments: strip, resume: "", is_shared: true, refusal: "", kills: 3 }.check(&place);
    let table = "surrogate run --design sets.csv --json --out OUT/table.csv";
    Long { arguments: table, resume: "", is_shared: true, refusal: "", kills: 3 }.check(&place);
    let fit = "surrogate fit --form gp --table design.csv --json --out OUT/fit.rs";
    Long { arguments: fit, resume: "", is_shared: true, refusal: "", kills: 3 }.check(&place);
}

/// Short commands, too: they have fewer steps, but all of them write several files.
#[test]
fn what_is_made_of_a_run_and_of_a_study() {
    let place = Workplace::new();
    let run = place.eplat("run erp --chains 2 --warmup 60 --draws 60 --out run");
    assert!(matches!(run.status.code(), Some(0 | 3 | 4)), "{}", text(&run.stderr));
    sheet::write(&place.path("sheet.vtp"));
    let mut log = "site,x,y,z,s1,s2,captured\n".to_owned();
    for i in 0..40 {
        let _ = writeln!(
            log,
            "s{},1,{},0,600,{},{}",
            i / 4,
            i / 4,
            260 - i % 4 * 10,
            if i % 4 < 2 { "yes" } else { "no" }
        );
    }
    place.file("log.csv", log);
    let is_there = ": it exists";
    for (arguments, resume, refusal, kills) in [
        ("predict run run/measurements.csv --json --out OUT", "", "", 3),
        ("plot run --only traces --json --out OUT", "", "", 3),
        ("export --run run --draws 4 --out OUT/carp", "", is_there, 3),
        ("import log.csv --mesh sheet.vtp --units mm --out OUT/study", "--force", "", 2),
        ("run erp --optimize --json --out OUT", "", "", 2),
        ("simulate cell --out OUT", "", "", 2),
    ] {
        Long { arguments, resume, is_shared: false, refusal, kills }.check(&place);
    }
}

/// A model of one's own, and what `eplat check` says of it.
#[test]
fn a_compilation() {
    let place = Workplace::new();
    let model = "use eplat::prelude::*;\nmodel! {\n    model Plain;\n    param mean ~ Normal(1.0, 2.0);\n    \
                 observe y(row): Number ~ Normal(mean, 1.0);\n}\n/// Rust, which is compiled.\nstruct Own;\n";
    place.file("m.rs", model).file("table.csv", "y\n1\n2\n");
    // of its own for each round: the compiler of a killed command still writes into the last one
    let cache = |round: usize| [place.path(&format!("cache{round}"))];
    let check = |round: usize| {
        let mut command = place.command("check m.rs --data table.csv");
        command.env("EPLAT_CACHE", &cache(round)[0]);
        command
    };
    let log_density = |round: usize| {
        let output = check(round).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        let said = text(&output.stdout);
        said.split_once("log density ").unwrap().1.split(' ').next().unwrap().to_owned()
    };
    let (_, n_steps) = watch(check(0), &cache(0), usize::MAX);
    let expected = log_density(0);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut kills, mut round) = (0, 0);
    while kills < 6 {
        round += 1;
        for _ in 0..2 {
            let (end, _) = watch(check(round), &cache(round), rng.random_range(1..n_steps));
            kills += usize::from(matches!(end, End::Killed));
        }
        // what a killed command's compiler still writes is nobody's program
        assert_eq!(log_density(round), expected);
        // one whose kill came before it was recorded may stand beside the one that is used
        let names = fs::read_dir(cache(round)[0].join("programs")).unwrap().flatten();
        let names: Vec<_> = names
            .map(|entry| entry.file_name().into_string().unwrap())
            .filter(|name| !is_unfinished(Path::new(name)))
            .collect();
        assert!(names.len() == 2, "{names:?}");
    }
}
