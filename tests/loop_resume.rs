//! A loop that is killed in its searches and in its fits goes on to the same files.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;
#[path = "support/sheet.rs"]
mod sheet;

use std::fmt::Write as _;
use std::fs;
use std::process::Stdio;
use std::time::{Duration, Instant};

use program::{Workplace, text};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Brackets at every fourth vertex, less by 10 ms per sd of the contact force.
fn workplace() -> Workplace {
    let place = Workplace::new();
    sheet::write(&place.path("sheet.vtp"));
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for (name, first) in [("train.csv", 0), ("heldout.csv", 2)] {
        let mut table = "site,vertex,protocol,lower,upper,force_g,wall_mm\n".to_owned();
        for vertex in (first..sheet::N).step_by(4) {
            let [force, wall, noise] = [0, 1, 2].map(|_| rng.sample::<f64, _>(StandardNormal));
            let mean = 90.0 + 10.0 * (vertex as f64 / 30.0).sin() - 10.0 * force + 2.0 * noise;
            let lower = 10.0 * (mean / 10.0).floor();
            let _ = writeln!(
                table,
                "{vertex},{vertex},S1S2,{lower},{},{force:.3},{wall:.3}",
                lower + 10.0
            );
        }
        place.file(name, table);
    }
    place
}

const LOOP: &str =
    "loop recovery --mesh sheet.vtp --units mm --data train.csv --heldout heldout.csv --nulls 39";

#[test]
fn a_killed_loop_goes_on_to_the_same_files() {
    let place = workplace();
    let whole = place.eplat(&format!("{LOOP} --out whole"));
    let code = whole.status.code();
    assert!(matches!(code, Some(0 | 3 | 4)), "{}", text(&whole.stderr));
    assert!(text(&whole.stdout).contains("lacks an effect of force_g"), "{}", text(&whole.stdout));
    assert!(!place.path("whole/checkpoint").exists());
    assert!(!place.path("whole/declared/checkpoint").exists());

    let mut resume = "";
    for (threads, until) in [
        (1, "checkpoint/chain-0"),
        (2, "declared/checkpoint/identity.json"),
        (1, "after/checkpoint/identity.json"),
    ] {
        let arguments = format!("{LOOP} --out cut --threads {threads} {resume}");
        let mut command = place.command(&arguments);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let begun = Instant::now();
        while !place.path("cut").join(until).exists() {
            assert!(child.try_wait().unwrap().is_none(), "it ended before {until}");
            assert!(begun.elapsed() < Duration::from_mins(3), "{until}");
            std::thread::sleep(Duration::from_millis(2));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        resume = "--resume";
        // at once, not after the searches
        let again = place.eplat(&format!("{LOOP} --out cut"));
        let said = text(&again.stderr);
        assert!(
            said.contains(
                "cut/checkpoint holds an interrupted run\nhelp: go on with it by --resume"
            ),
            "{said}"
        );
        let other = place.eplat(&format!("{} --out cut --resume", LOOP.replace("39", "49")));
        assert!(text(&other.stderr).contains("nulls is 39 there, 49 here"));
    }
    let end = place.eplat(&format!("{LOOP} --out cut --resume"));
    assert_eq!(end.status.code(), code, "{}", text(&end.stderr));
    for name in [
        "finding.json",
        "report.html",
        "heldout_predictions.csv",
        "recovery_plus_force_g.rs",
        "declared/draws.csv",
        "after/draws.csv",
        "after/summary.csv",
        "after/model.rs",
    ] {
        let [a, b] =
            ["whole", "cut"].map(|folder| fs::read(place.path(folder).join(name)).unwrap());
        assert!(a == b, "{name} differs");
    }
    let names = |folder: &str| {
        let entries = fs::read_dir(place.path(folder)).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    assert_eq!(names("whole"), names("cut"));
}
