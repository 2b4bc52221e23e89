//! The emulators that ship against strips that they have not seen, and as modules of a model file.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests")]

use std::fs;
use std::path::Path;
use std::process::Command;

use eplat::ep::{Grid, Parameters, Protocol, StripOutcome, simulate_strips};
use eplat::surrogate::{DEFAULT_FILTER, ERP_INPUTS, design_points, emulated};

/// A design of another seed than the emulators', and what the strips do.
fn unseen(n: usize, restitution: &[u32]) -> Vec<(Parameters, StripOutcome)> {
    let parameters = design_points(n, &ERP_INPUTS, 77);
    let tissues: Vec<_> = parameters.iter().map(|p| p.tissue()).collect();
    let protocol = Protocol { restitution: restitution.to_vec(), ..Protocol::default() };
    let outcomes = simulate_strips(&tissues, &Grid::default(), &protocol, &|_| ()).unwrap();
    parameters.into_iter().zip(outcomes).collect()
}

/// Root mean square and largest of errors in predictive standard deviations; the first must be about 1.
fn assert_honest(name: &str, errors: &[f64]) {
    let n = errors.len() as f64;
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
    let largest = errors.iter().fold(0f64, |m, e| e.abs().max(m));
    println!("{name}: {n} strips, rms {rms:.2} sd, largest {largest:.2} sd");
    // an rms of n normal numbers has the standard error 1/√(2n); the errors are not normal, so twice that and 4.5
    assert!(rms < 1.0 + 9.0 / (2.0 * n).sqrt(), "{name}: too sure of itself: {rms}");
    assert!(rms > 1.0 - 4.5 / (2.0 * n).sqrt(), "{name}: too unsure: {rms}");
}

#[test]
fn erp_of_unseen_strips_is_as_far_off_as_the_emulators_say() {
    let strips = unseen(64, &[]);
    let valid = |o: &StripOutcome| {
        o.erp_s2.is_ok_and(|erp| {
            f64::from(erp) > DEFAULT_FILTER.start && f64::from(erp) <= DEFAULT_FILTER.end
        })
    };
    let (mut s2, mut s3) = (vec![], vec![]);
    for (p, o) in strips.iter().filter(|(_, o)| valid(o)) {
        let (t, a) = (p.tau_out, p.apd_max);
        let erp_s2 = f64::from(o.erp_s2.unwrap());
        s2.push((erp_s2 - emulated::erp_s2(t, a)) / emulated::erp_s2_sd(t, a));
        if let Ok(erp) = o.erp_s3 {
            s3.push((f64::from(erp) - emulated::erp_s3(t, a)) / emulated::erp_s3_sd(t, a));
        }
    }
    assert!(s2.len() > 30 && s3.len() > 30, "{} {}", s2.len(), s3.len());
    assert_honest("ERP_S2", &s2);
    assert_honest("ERP_S3", &s3);
}

#[test]
fn beats_of_unseen_strips_are_as_far_off_as_the_emulators_say() {
    let strips = unseen(48, &[310, 390, 530]);
    let (mut apd, mut cv) = (vec![], vec![]);
    for (p, o) in strips.iter().filter(|(p, _)| p.cv_max >= 0.3) {
        let (c, t, a) = (p.cv_max, p.tau_out, p.apd_max);
        for (s2, beat) in &o.restitution {
            let (Ok(beat), Ok(erp)) = (beat, o.erp_s2) else { continue };
            if *s2 < erp + 50 {
                continue;
            }
            let s2 = f64::from(*s2);
            if c >= 0.5 {
                apd.push((beat.apd90 - emulated::apd90(t, a, s2)) / emulated::apd90_sd(t, a, s2));
            }
            cv.push((beat.cv - emulated::cv(c, t, a, s2)) / emulated::cv_sd(c, t, a, s2));
        }
    }
    assert!(apd.len() > 40, "{}", apd.len());
    assert_honest("APD90", &apd);
    assert_honest("CV", &cv);
}

fn eplat(folder: &Path, arguments: &str) -> (bool, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_eplat"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .env("EPLAT_CACHE", folder.join("cache"))
        .output()
        .unwrap();
    (output.status.success(), String::from_utf8(output.stderr).unwrap())
}

const MODEL: &str = "use eplat::prelude::*;
use surrogate::Emulator;
mod erp_mine;
model! {
    model Mine;
    param tau_out [ms] ~ Uniform(1.0, 30.0);
    param apd_max [ms] ~ Uniform(120.0, 270.0);
    let erp(row) [ms] = erp_mine::ERP_S2.mean([tau_out, apd_max]);
    let sd(row) [ms] = erp_mine::ERP_S2.sd([tau_out, apd_max]);
    observe s1s2(row): Bracket [ms] ~ Widened(TopHat(erp(row)), sd(row));
}
";

#[test]
fn an_emulator_is_a_module_of_a_model_file_and_a_change_of_it_is_seen() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let table = concat!(env!("CARGO_MANIFEST_DIR"), "/src/surrogate/erp_design.csv");
    let fit = format!("surrogate fit --form gp --table {table} --out erp_mine.rs --figure erp.svg");
    let (done, said) = eplat(at, &fit);
    assert!(done && said.contains("of 100 rows 63 are valid"), "{said}");
    assert!(said.contains("leave-one-out RMSE 0.5"), "{said}");
    assert!(fs::read_to_string(at.join("erp.svg")).unwrap().contains("ERP_S3 (ms)"));
    fs::write(at.join("mine.rs"), MODEL).unwrap();
    fs::write(at.join("data.csv"), "protocol,lower,upper\ns1s2,200,210\n").unwrap();
    let check = "check mine.rs --data data.csv";
    let (done, said) = eplat(at, check);
    assert!(done && said.contains("compiling mine.rs"), "{said}");
    assert!(!eplat(at, check).1.contains("compiling"), "nothing has changed");
    let text = fs::read_to_string(at.join("erp_mine.rs")).unwrap();
    fs::write(at.join("erp_mine.rs"), text + "\n").unwrap();
    assert!(eplat(at, check).1.contains("compiling mine.rs"), "the emulator has changed");
    fs::remove_file(at.join("erp_mine.rs")).unwrap();
    let (done, said) = eplat(at, check);
    assert!(!done && said.contains("cannot read") && said.contains("erp_mine.rs"), "{said}");
}

#[test]
fn what_makes_no_sense_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let (done, said) = eplat(at, "surrogate design --vary tau_oui --out d.csv");
    assert!(!done && said.contains("`tau_oui` is no parameter\nhelp: "), "{said}");
    let table = concat!(env!("CARGO_MANIFEST_DIR"), "/src/surrogate/erp_design.csv");
    let (done, said) = eplat(at, &format!("surrogate fit --form gp --table {table} --out e.csv"));
    assert!(!done && said.contains("emulators are written as Rust source\nhelp: "), "{said}");
    let up_to =
        |erp: u32| format!("surrogate fit --form gp --table {table} --out e.rs --erp-up-to {erp}");
    let (done, said) = eplat(at, &up_to(170));
    assert!(!done && said.contains("no point is left after filtering"), "{said}");
    let (done, said) = eplat(at, &up_to(180));
    assert!(!done && said.contains("needs at least 8 points, but only 5"), "{said}");
    let (done, said) =
        eplat(at, &format!("surrogate sensitivity --table {table} --out s.csv --erp-up-to 170"));
    assert!(
        !done && said.contains("ERP_S2: an additive model of 3 inputs needs more than 31 rows"),
        "{said}"
    );
    assert_eq!(fs::read_dir(at).unwrap().count(), 0, "nothing is left behind");
}
