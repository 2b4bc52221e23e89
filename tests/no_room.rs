//! A disk that is full, and a cache that cannot be written: every command says so in a sentence that names the file
//! and what to do, and leaves no half-written file under a final name.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;
#[path = "support/sheet.rs"]
mod sheet;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};

use program::{Workplace, skipped, text};

const SMALL: &str = "run erp --chains 2 --warmup 40 --draws 40";

const PLAIN: &str = "use eplat::prelude::*;\nmodel! {\n    model Plain;\n    param mean ~ Normal(1.0, 2.0);\n    \
                     observe y(row): Number ~ Normal(mean, 1.0);\n}\n/// Rust, which is compiled.\nstruct Own;\n";

/// The commands that write, each to `full`.
const WRITING: [&str; 22] = [
    "run erp --chains 2 --warmup 40 --draws 40 --out full/o",
    "run erp --optimize --out full/o",
    "run voltage --prior --chains 2 --draws 40 --out full/o",
    "predict run run/measurements.csv --out full/o",
    "plot run --out full/o",
    "init full/o",
    "mesh atrium --edge 3 --out full/o.vtk",
    "mesh basis sheet.vtp --units mm --modes 20 --out full/o.npz",
    "simulate cell --out full/o",
    "simulate strip --params sets.csv --beats 1 --cable --out full/o.csv --restitution full/c.csv",
    "simulate atrium --fields sheet.vtp --units mm --refine 1 --tau-out 8 --apd-max 200 --pace 0 --beats 1 --last 60 --out full/o",
    "export --run run --draws 2 --out full/o",
    "import log.csv --mesh sheet.vtp --units mm --out full/o",
    "mesh repair sheet.vtp full/o.vtp --units mm",
    "mesh convert sheet.vtp full/o.ply --units mm",
    "surrogate design --n 400 --out full/o.csv",
    "surrogate run --design sets.csv --out full/o.csv",
    "surrogate fit --form gp --table design.csv --out full/o.rs",
    "study experiment --skip-simulation --chains 2 --warmup 60 --draws 40 --out full/o",
    "study run plan.toml --out full/o",
    "study slurm plan.toml --out full/o",
    "loop recovery --mesh sheet.vtp --units mm --data train.csv --nulls 19 --out full/o",
];

fn workplace() -> Workplace {
    let place = Workplace::new().with_erp();
    assert!(place.eplat(&format!("{SMALL} --out run")).status.code().is_some_and(|c| c != 1));
    sheet::write(&place.path("sheet.vtp"));
    let sets = "cv_max_m_per_s,tau_in_ms,tau_out_ms,tau_open_ms,apd_max_ms\n0.7,0.05,10,120,200\n";
    let plan = "model = \"erp.rs\"\nlengthscales = [64.0]\nsites = [5]\nresolutions = [10.0]\nfields = 1\ndesigns = 1\n\
                warmup = 40\ndraws = 40\n";
    let mut table = "site,vertex,protocol,lower,upper,force_g\n".to_owned();
    for v in (0..sheet::N).step_by(4) {
        let lower = 10 * (8 + v * 7 % 5);
        let _ = writeln!(table, "{v},{v},S1S2,{lower},{},{}", lower + 10, v * 13 % 7);
    }
    let mut log = "site,x,y,z,s1,s2,captured\n".to_owned();
    for i in 0..800 {
        let captured = if i % 4 < 2 { "yes" } else { "no" };
        let _ = writeln!(log, "s{0},1,{0},0,600,{1},{captured}", i / 4, 260 - i % 4 * 10);
    }
    place.file("sets.csv", sets).file("plan.toml", plan).file("train.csv", table);
    place.file("log.csv", log);
    place.file("design.csv", include_str!("../engine/src/surrogate/erp_design.csv"));
    place
}

/// Runs a command on a disk of so many kilobytes, which is mounted on `full` for it alone, and copies to `left` what
/// it left there.
fn on_small_disk(place: &Workplace, arguments: &str, kilobytes: usize) -> Output {
    let cache = concat!(env!("CARGO_TARGET_TMPDIR"), "/cache");
    on_small_disk_with(place, arguments, kilobytes, cache)
}

/// The same, with a cache of one's own.
fn on_small_disk_with(place: &Workplace, arguments: &str, kilobytes: usize, cache: &str) -> Output {
    let script = format!(
        "mount -t tmpfs -o size={kilobytes}k tmpfs full || exit 99\n\"$0\" {arguments}\ncode=$?\n\
         cp -r full left\nexit $code"
    );
    let _ = std::fs::remove_dir_all(place.path("left"));
    std::fs::create_dir_all(place.path("full")).unwrap();
    Command::new("unshare")
        .args(["-rm", "sh", "-c", &script, env!("CARGO_BIN_EXE_eplat")])
        .current_dir(place.path(""))
        .env("EPLAT_CACHE", cache)
        .output()
        .unwrap()
}

fn can_mount(place: &Workplace) -> bool {
    std::fs::create_dir_all(place.path("full")).unwrap();
    let mount = ["-rm", "mount", "-t", "tmpfs", "tmpfs", "full"];
    let tried = Command::new("unshare").args(mount).current_dir(place.path("")).output();
    tried.is_ok_and(|output| output.status.success())
}

/// Contents of the files below a folder, by path, without those that have no final name yet.
fn finished(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().into_string().unwrap();
        if name.starts_with(".eplat-") || name == "checkpoint" {
            continue;
        }
        if entry.path().is_dir() {
            let below = finished(&entry.path()).into_iter();
            found.extend(below.map(|(path, bytes)| (format!("{name}/{path}"), bytes)));
        } else {
            found.insert(name, std::fs::read(entry.path()).unwrap());
        }
    }
    found
}

/// One sentence of what and where, and one of what to do; no temporary name.
fn explains(output: &Output, arguments: &str) {
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{arguments}: {said}");
    let at = said.find("error: ").unwrap_or_else(|| panic!("{arguments}: {said}"));
    let (error, help) =
        said[at..].split_once("\nhelp: ").unwrap_or_else(|| panic!("{arguments}: {said}"));
    assert!(error.starts_with("error: cannot write ") && !error.contains('\n'), "{error}");
    assert!(error.contains("full") && !error.contains(".eplat-tmp-"), "{error}");
    assert!(error.contains("No space left on device"), "{error}");
    assert!(help.starts_with("make room there") || help.contains("--out"), "{help}");
}

#[test]
fn a_full_disk_is_told_and_leaves_no_half_file() {
    let place = workplace();
    if !can_mount(&place) {
        skipped::skipped("no disk can be mounted here (unshare -rm)");
        return;
    }
    for arguments in WRITING {
        let whole = on_small_disk(&place, arguments, 64_000);
        assert!(
            matches!(whole.status.code(), Some(0 | 3 | 4)),
            "{arguments}: {}",
            text(&whole.stderr)
        );
        let expected = finished(&place.path("left"));
        let mut n_refused = 0;
        for kilobytes in [4, 24, 120] {
            let output = on_small_disk(&place, arguments, kilobytes);
            if matches!(output.status.code(), Some(0 | 3 | 4)) {
                break;
            }
            n_refused += 1;
            explains(&output, arguments);
            for (name, bytes) in finished(&place.path("left")) {
                // records and pages tell times
                let is_timed = ["json", "html"].iter().any(|end| name.ends_with(end));
                let whole = expected.get(&name).unwrap_or_else(|| panic!("{arguments}: {name}"));
                assert!(is_timed || *whole == bytes, "{arguments}: {name} is not whole");
            }
        }
        // the smallest disk has a page
        let is_small = expected.values().map(Vec::len).sum::<usize>() < 4096;
        assert!(n_refused > 0 || is_small, "{arguments} found room");
    }
}

/// What was sampled is kept, and gone on with where there is room.
#[test]
fn a_disk_without_room_for_draws_is_told_and_the_run_goes_on_later() {
    let place = Workplace::new();
    if !can_mount(&place) {
        skipped::skipped("no disk can be mounted here (unshare -rm)");
        return;
    }
    let run = "run erp --chains 2 --warmup 40 --draws 6000";
    let script = format!(
        "mount -t tmpfs -o size=3000k tmpfs full || exit 99\n\"$0\" {run} --out full/o 2>said\necho $? >code\n\
         mount -o remount,size=200000k full\n\"$0\" {run} --out full/o --resume\ncode=$?\ncp -r full left\nexit $code"
    );
    let resumed = Command::new("unshare")
        .args(["-rm", "sh", "-c", &script, env!("CARGO_BIN_EXE_eplat")])
        .current_dir(place.path(""))
        .env("EPLAT_CACHE", concat!(env!("CARGO_TARGET_TMPDIR"), "/cache"))
        .output()
        .unwrap();
    let said = place.read("said");
    assert_eq!(place.read("code"), "1\n", "{said}");
    let error = &said[said.find("error: ").unwrap()..];
    assert!(error.contains(": cannot write full/o/checkpoint/draws-"), "{said}");
    assert!(error.contains(": No space left on device"), "{said}");
    let help = "\nhelp: make room there, then give the command again with --resume\n";
    assert!(error.ends_with(help), "{said}");
    let said = text(&resumed.stderr);
    assert!(matches!(resumed.status.code(), Some(0 | 3 | 4)), "{said}");
    let whole = place.eplat(&format!("{run} --out whole"));
    assert_eq!(whole.status.code(), resumed.status.code());
    for name in ["draws.csv", "summary.csv", "loo.csv", "rows.csv"] {
        assert!(place.read(&format!("left/o/{name}")) == place.read(&format!("whole/{name}")));
    }
    assert!(!place.path("left/o/checkpoint").exists());
}

/// Of a linker on a full disk nothing is heard but that it died.
#[test]
fn a_disk_that_fills_while_a_model_compiles_is_told() {
    let place = Workplace::new();
    if !can_mount(&place) {
        skipped::skipped("no disk can be mounted here (unshare -rm)");
        return;
    }
    place.file("m.rs", PLAIN).file("table.csv", "y\n1\n2\n");
    let check = "check m.rs --data table.csv";
    let on = |kilobytes| on_small_disk_with(&place, check, kilobytes, "full/cache");
    for kilobytes in [16, 200, 2_000, 10_000] {
        let output = on(kilobytes);
        explains(&output, &format!("{check} on {kilobytes} kB"));
        println!("{}", text(&output.stderr));
    }
    let whole = on(64_000);
    assert_eq!(whole.status.code(), Some(0), "{}", text(&whole.stderr));
    // an error in the model is told on a small disk, too
    place.file("m.rs", PLAIN.replace("mean ~ Normal(1.0, 2.0)", "mean ~ Normal(1.0, Num(\"2\"))"));
    let said = text(&on(2_000).stderr);
    assert!(said.contains("m.rs does not compile"), "{said}");
}

/// A cache on a disk that nobody may write to, not even a superuser.
fn on_sealed_cache(place: &Workplace, arguments: &str) -> Output {
    let script = format!("mount -t tmpfs -o ro tmpfs sealed || exit 99\nexec \"$0\" {arguments}");
    Command::new("unshare")
        .args(["-rm", "sh", "-c", &script, env!("CARGO_BIN_EXE_eplat")])
        .current_dir(place.path(""))
        .env("EPLAT_CACHE", place.path("sealed"))
        .output()
        .unwrap()
}

#[test]
fn with_a_read_only_cache_every_command_leaves_the_same_files() {
    let place = workplace();
    if !can_mount(&place) {
        skipped::skipped("no disk can be mounted here (unshare -rm)");
        return;
    }
    std::fs::create_dir(place.path("sealed")).unwrap();
    for arguments in WRITING {
        let written = |output: Output| {
            let said = text(&output.stderr);
            assert!(matches!(output.status.code(), Some(0 | 3 | 4)), "{arguments}: {said}");
            let found = finished(&place.path("full"));
            std::fs::remove_dir_all(place.path("full")).unwrap();
            std::fs::create_dir(place.path("full")).unwrap();
            assert!(!found.is_empty(), "{arguments}");
            // records and pages tell times
            let is_timed = |name: &str| ["json", "html"].iter().any(|end| name.ends_with(end));
            (
                output.status.code(),
                found.into_iter().filter(move |(name, _)| !is_timed(name)).collect::<Vec<_>>(),
                said,
            )
        };
        let (code, files, _) = written(place.eplat(arguments));
        let (sealed_code, sealed_files, said) = written(on_sealed_cache(&place, arguments));
        assert_eq!(code, sealed_code, "{arguments}");
        assert!(files == sealed_files, "{arguments}: other files");
        assert!(said.matches("cannot be written").count() <= 1, "{arguments}: {said}");
    }
    assert_eq!(std::fs::read_dir(place.path("sealed")).unwrap().count(), 0);
}

/// Permissions do not bind a superuser: a file stands where the folder would be.
#[test]
fn without_a_cache_everything_works_but_what_is_compiled() {
    let place = Workplace::new();
    place.file("cache", "").file("m.rs", PLAIN).file("table.csv", "y\n1\n2\n");
    let without = |arguments: &str| {
        place.command(arguments).env("EPLAT_CACHE", place.path("cache")).output().unwrap()
    };
    let output = without(&format!("{SMALL} --out out"));
    let said = text(&output.stderr);
    assert!(matches!(output.status.code(), Some(0 | 3 | 4)), "{said}");
    let warning = "cache cannot be written, so every run computes its eigenfunctions anew\nhelp: set EPLAT_CACHE";
    assert_eq!(said.matches(warning).count(), 1, "{said}");
    // the results are the same
    let with = place.eplat(&format!("{SMALL} --out with"));
    assert!(!text(&with.stderr).contains("warning: the cache"), "{}", text(&with.stderr));
    assert_eq!(place.read("out/summary.csv"), place.read("with/summary.csv"));

    let compiled = without("check m.rs --data table.csv");
    let said = text(&compiled.stderr);
    assert_eq!(compiled.status.code(), Some(1), "{said}");
    assert!(
        said.starts_with("error: cannot write ") && said.contains("/cache/packages/"),
        "{said}"
    );
    assert!(said.contains("\nhelp: set EPLAT_CACHE to a folder that you may write to"), "{said}");
}

/// Runs into folders of their own that all miss the same entry of the cache.
#[test]
fn four_processes_on_one_cache() {
    let place = Workplace::new();
    let start = |i: usize| {
        let mut command = place.command(&format!("{SMALL} --out out{i}"));
        command.env("EPLAT_CACHE", place.path("cache"));
        command.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::piped());
        command.spawn().unwrap()
    };
    let together: Vec<_> = (0..4).map(start).collect();
    for child in together {
        let output = child.wait_with_output().unwrap();
        assert!(matches!(output.status.code(), Some(0 | 3 | 4)), "{}", text(&output.stderr));
    }
    for i in 1..4 {
        assert_eq!(place.read("out0/draws.csv"), place.read(&format!("out{i}/draws.csv")));
    }
    let entries = std::fs::read_dir(place.path("cache")).unwrap().flatten();
    let names: Vec<_> = entries.map(|entry| entry.file_name().into_string().unwrap()).collect();
    assert!(names.len() == 1 && names[0].starts_with("basis-"), "{names:?}");
}
