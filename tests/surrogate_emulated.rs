//! The emulators that ship against strips that they have not seen, and as modules of a model file.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests")]

use std::fs;
use std::path::Path;
use std::process::Command;

use eplat::ep::{Grid, Parameters, Protocol, StripOutcome, simulate_strips};
use eplat::surrogate::{DEFAULT_FILTER, ERP_INPUTS, design_points, emulated, five};

/// A design of another seed than the emulators', and what the strips do.
fn unseen(n: usize, vary: &[usize], restitution: &[u32]) -> Vec<(Parameters, StripOutcome)> {
    let parameters = design_points(n, vary, 77);
    let tissues: Vec<_> = parameters.iter().map(|p| p.tissue()).collect();
    let protocol = Protocol { restitution: restitution.to_vec(), ..Protocol::default() };
    let outcomes = simulate_strips(&tissues, &Grid::default(), &protocol, &|_| ()).unwrap();
    parameters.into_iter().zip(outcomes).collect()
}

/// Errors of predictions, each with its standard deviation.
type Errors = Vec<(f64, f64)>;

/// Root mean square and largest of errors in predictive standard deviations; the first must be about 1.
fn assert_honest(name: &str, errors: &Errors) {
    let n = errors.len() as f64;
    let mean_square = |of: &dyn Fn(&(f64, f64)) -> f64| errors.iter().map(of).sum::<f64>() / n;
    let rmse = mean_square(&|(error, _)| error * error).sqrt();
    let rms = mean_square(&|(error, sd)| (error / sd).powi(2)).sqrt();
    let largest = errors.iter().fold(0f64, |m, (error, sd)| (error / sd).abs().max(m));
    println!("{name}: {n} outcomes, RMSE {rmse:.4}, rms {rms:.2} sd, largest {largest:.2} sd");
    // an rms of n normal numbers has the standard error 1/√(2n); the errors are not normal, so twice that and 4.5
    assert!(rms < 1.0 + 9.0 / (2.0 * n).sqrt(), "{name}: too sure of itself: {rms}");
    assert!(rms > 1.0 - 4.5 / (2.0 * n).sqrt(), "{name}: too unsure: {rms}");
}

#[test]
fn erp_of_unseen_strips_is_as_far_off_as_the_emulators_say() {
    let strips = unseen(64, &ERP_INPUTS, &[]);
    let valid = |o: &StripOutcome| {
        o.erp_s2.is_ok_and(|erp| {
            f64::from(erp) > DEFAULT_FILTER.start && f64::from(erp) <= DEFAULT_FILTER.end
        })
    };
    let (mut s2, mut s3) = (vec![], vec![]);
    for (p, o) in strips.iter().filter(|(_, o)| valid(o)) {
        let (t, a) = (p.tau_out, p.apd_max);
        let erp_s2 = f64::from(o.erp_s2.unwrap());
        s2.push((erp_s2 - emulated::erp_s2(t, a), emulated::erp_s2_sd(t, a)));
        if let Ok(erp) = o.erp_s3 {
            s3.push((f64::from(erp) - emulated::erp_s3(t, a), emulated::erp_s3_sd(t, a)));
        }
    }
    assert!(s2.len() > 30 && s3.len() > 30, "{} {}", s2.len(), s3.len());
    assert_honest("ERP_S2", &s2);
    assert_honest("ERP_S3", &s3);
}

#[test]
fn outcomes_of_all_five_parameters_are_as_far_off_as_the_emulators_say() {
    let strips = unseen(120, &[0, 1, 2, 3, 4], &[310, 390, 530]);
    let (mut s2, mut s3, mut apd, mut cv) = (vec![], vec![], vec![], vec![]);
    for (place, (p, o)) in strips.iter().enumerate() {
        let [c, i, t, w, a] = p.to_array();
        let Ok(erp) = o.erp_s2.map(f64::from) else { continue };
        let predicted = five::erp_s2(c, i, t, w, a);
        s2.push((erp - predicted, five::erp_s2_sd(c, i, t, w, a)));
        if let (Ok(erp_s3), true) = (o.erp_s3, erp <= 270.0) {
            let error = f64::from(erp_s3) - five::erp_s3(c, i, t, w, predicted);
            s3.push((error, five::erp_s3_sd(c, i, t, w, predicted)));
        }
        // one beat of each, since beats of a strip share their errors
        let beats = o.restitution.iter().cycle().skip(place % 3).take(3);
        for (interval, beat) in beats {
            let interval = f64::from(*interval);
            let Ok(beat) = beat else { continue };
            if c >= 0.3 && interval >= erp + 50.0 {
                let r = five::unrecovered(predicted, w, interval);
                apd.push((beat.apd90 - five::apd90(c, i, t, a, r), five::apd90_sd(c, i, t, a, r)));
                cv.push((beat.cv - five::cv(c, i, t, w, r), five::cv_sd(c, i, t, w, r)));
                break;
            }
        }
    }
    assert!(s2.len() > 100 && s3.len() > 40 && apd.len() > 60, "{} {}", s2.len(), s3.len());
    assert_honest("ERP_S2", &s2);
    assert_honest("ERP_S3", &s3);
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
    let table = concat!(env!("CARGO_MANIFEST_DIR"), "/engine/src/surrogate/erp_design.csv");
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
    assert!(!done && said.contains("file not found for module `erp_mine`"), "{said}");
}

#[test]
fn what_makes_no_sense_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let (done, said) = eplat(at, "surrogate design --vary tau_oui --out d.csv");
    assert!(!done && said.contains("`tau_oui` is no parameter\nhelp: "), "{said}");
    let table = concat!(env!("CARGO_MANIFEST_DIR"), "/engine/src/surrogate/erp_design.csv");
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
