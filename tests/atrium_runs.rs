//! Atrium simulations that are interrupted and gone on with, and ensembles of a posterior.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;
#[path = "support/sheet.rs"]
mod sheet;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use eplat::mesh::{self, Units};
use eplat::report::FieldDraws;
use program::{Workplace, text};
use serde_json::Value;

/// Long enough to be interrupted several times.
const ONE: &str =
    "simulate atrium --run run --refine 2 --pace 0 --beats 2 --s1 300 --last 300 --snapshots 30";
const MANY: &str = "simulate atrium --run run --refine 1 --pace 0 --beats 1 --last 400 --draws 5";

/// A run of a posterior in which both fields are flat, five draws of them; in the last tau_out is out of range.
fn place() -> Workplace {
    let place = Workplace::new();
    fs::create_dir(place.path("run")).unwrap();
    sheet::write(&place.path("run/fields.vtp"));
    let flat = |means: [f64; 5]| means.iter().flat_map(|m| [*m, 0.0]).collect::<Vec<f64>>();
    let coefficients = BTreeMap::from([
        ("tau_out".to_owned(), flat([6.0, 7.0, 8.0, 9.0, 31.0])),
        ("apd_max".to_owned(), flat([180.0, 200.0, 190.0, 210.0, 185.0])),
    ]);
    let draws = FieldDraws {
        n_modes: 1,
        eigenfunctions: vec![0.1; sheet::N].into(),
        coefficients,
        within: BTreeMap::new(),
    };
    draws.write(&place.path("run/field_draws.npz")).unwrap();
    place
}

/// Every file of a simulation by name; of the record all but the time.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        let name = entry.file_name().unwrap().to_str().unwrap().to_owned();
        if entry.is_dir() {
            let below = contents(&entry).into_iter();
            found.extend(below.map(|(path, bytes)| (format!("{name}/{path}"), bytes)));
            continue;
        }
        let mut bytes = fs::read(&entry).unwrap();
        if name == "simulation.json" {
            let mut record: Value = serde_json::from_slice(&bytes).unwrap();
            assert!(record.as_object_mut().unwrap().remove("seconds").is_some());
            bytes = record.to_string().into_bytes();
        }
        found.insert(name, bytes);
    }
    found
}

/// Waits until `file` of the checkpoint has been written anew.
fn await_saving(place: &Workplace, file: &str, child: &mut Child) {
    let path = place.path("cut/checkpoint").join(file);
    let before = fs::read(&path).ok();
    let begun = Instant::now();
    while fs::read(&path).ok() == before {
        assert!(begun.elapsed() < Duration::from_mins(2), "{file} is not kept");
        assert!(child.try_wait().unwrap().is_none(), "it ended before it was interrupted");
        sleep(Duration::from_millis(2));
    }
}

/// Interrupts a simulation by kill, by Ctrl-C, and by Ctrl-C again, and goes on with it.
fn survives(arguments: &str, file: &str) {
    let place = place();
    let whole = place.eplat(&format!("{arguments} --out whole"));
    assert!(whole.status.success(), "{}", text(&whole.stderr));
    let arguments = format!("{arguments} --checkpoint-every 0 --out cut");
    for (round, signal) in ["KILL", "INT", "TERM"].into_iter().enumerate() {
        let resume = if round == 0 { "" } else { " --resume" };
        let mut child = place.command(&format!("{arguments}{resume}"));
        let mut child = child.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        await_saving(&place, file, &mut child);
        let id = child.id().to_string();
        assert!(Command::new("kill").args(["-s", signal, &id]).status().unwrap().success());
        let output = child.wait_with_output().unwrap();
        if signal != "KILL" {
            assert_eq!(output.status.code(), Some(130));
            assert!(text(&output.stderr).contains("--resume"), "{}", text(&output.stderr));
        }
        assert!(
            !place.path("cut/simulation.json").exists() && !place.path("cut/beat.vtp").exists()
        );
    }
    // another simulation neither replaces it nor goes on with it
    let again = place.eplat(&arguments);
    assert!(text(&again.stderr).contains("holds an interrupted run"), "{}", text(&again.stderr));
    let other = place.eplat(&format!("{arguments} --resume --dt 0.05"));
    assert!(text(&other.stderr).contains("dt is 0.1 there, 0.05 here"), "{}", text(&other.stderr));
    let end = place.eplat(&format!("{arguments} --resume"));
    assert!(end.status.success(), "{}", text(&end.stderr));
    let [whole, cut] = ["whole", "cut"].map(|folder| contents(&place.path(folder)));
    assert_eq!(whole.keys().collect::<Vec<_>>(), cut.keys().collect::<Vec<_>>());
    for (name, bytes) in &whole {
        assert!(cut[name] == *bytes, "{name} differs");
    }
    let done = place.eplat(&format!("{arguments} --resume"));
    assert!(text(&done.stderr).contains("nothing left to do"), "{}", text(&done.stderr));
    let other = place.eplat(&format!("{arguments} --resume --dt 0.05"));
    assert!(text(&other.stderr).contains("is complete, and another one: dt"));
}

#[test]
fn an_interrupted_simulation_goes_on_to_the_same_bits() {
    survives(ONE, "chain-0");
}

#[test]
fn an_interrupted_ensemble_goes_on_to_the_same_bits() {
    survives(MANY, "chain-1");
}

#[test]
fn an_ensemble_is_the_mean_of_its_draws() {
    let place = place();
    let output = place.eplat(&format!("{MANY} --out many"));
    let said = text(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert!(said.contains("5 of 5 draws of tau_out, apd_max"), "{said}");
    assert!(said.contains("20.00 % of pairs out of range"), "{said}");
    let maps = |folder: &str| {
        mesh::read(&place.path(folder).join("beat.vtp"), Units::Mm).unwrap().scalars()
    };
    let many = maps("many");
    let mut apd90 = vec![];
    for (i, (tau_out, apd_max)) in [(6, 180), (7, 200), (8, 190), (9, 210)].into_iter().enumerate()
    {
        let one = MANY.replace("--draws 5", &format!("--tau-out {tau_out} --apd-max {apd_max}"));
        assert!(place.eplat(&format!("{one} --out one{i}")).status.success());
        apd90.push(maps(&format!("one{i}")).remove("apd90").unwrap());
    }
    for v in [0, 77, 129, 300] {
        let values: Vec<f64> = apd90.iter().map(|map| map[v]).collect();
        let mean = values.iter().sum::<f64>() / 4.0;
        let sd = (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 3.0).sqrt();
        assert!((many["apd90_mean"][v] - mean).abs() < 1e-9, "{v}");
        assert!((many["apd90_sd"][v] - sd).abs() < 1e-9 && sd > 5.0, "{v}");
        assert_eq!(many["in_range"][v].to_bits(), 0.8_f64.to_bits());
    }
    assert!(many["captured"].iter().all(|share| share.to_bits() == 1.0_f64.to_bits()));
}

#[test]
fn draws_that_are_not_there_are_named() {
    let place = place();
    let fails = |arguments: &str, expected: &str| {
        let output = place.eplat(&format!("{arguments} --out none"));
        assert!(!output.status.success() && !place.path("none").exists());
        assert!(text(&output.stderr).contains(expected), "{}", text(&output.stderr));
    };
    fails(&MANY.replace("--draws 5", "--draws 6"), "kept 5 draws at 130 vertices");
    let none = format!("{MANY} --tau-out 8 --apd-max 190");
    fails(
        &none,
        "no parameter is the mean of a field that was drawn; these were: apd_max, tau_out",
    );
    fs::remove_file(place.path("run/field_draws.npz")).unwrap();
    fails(MANY, "field_draws.npz");
}
