//! The gradient of every model file against finite differences, 1e-6 relative.

#![allow(clippy::unwrap_used, reason = "a test")]

#[path = "support/as_written.rs"]
mod as_written;
#[path = "models/called.rs"]
mod called;
#[path = "models/forms.rs"]
mod forms;
#[path = "models/language.rs"]
mod language;
#[path = "models/posteriors.rs"]
mod posteriors;
#[path = "support/shipped.rs"]
mod shipped;
mod support;
#[allow(dead_code, reason = "another test uses the rest")]
#[path = "models/vector_priors.rs"]
mod vector_priors;

use as_written::same;
use eplat::cli::shipped_models;
use eplat::infer::LogDensity;
use eplat::model::{Declare, Interpreted, Model};
use eplat::table::Measurements;
use eplat_language::File;
use rand::RngExt;
use shipped::shipped;
use support::{basis, rng, table};

/// Models that only a compiler understands: they hold Rust code, densities that are written out, or words that the
/// interpreter does not know.
const COMPILED: [&str; 9] = [
    "Answers",
    "Autoregression",
    "Curve",
    "Custom",
    "Garch",
    "Mixed",
    "Nested",
    "OneCompartment",
    "Shares",
];

/// The same model, read from its text and evaluated without a compiler.
fn interpreted(model: &dyn Declare) -> Option<Interpreted> {
    let named = format!("model {};", model.name());
    let shipped = shipped_models().into_values().find(|source| source.contains(&named));
    let own = || match model.name() {
        "Called" => include_str!("models/called.rs").into(),
        _ => format!("use eplat::prelude::*;\nmodel! {{ {} }}\n", model.source()),
    };
    let source = shipped.map_or_else(own, Into::into);
    let file = File::read(&source).unwrap_or_else(|mistake| panic!("{}", mistake.message));
    let read = Interpreted::of(&file);
    assert_eq!(
        read.is_err(),
        COMPILED.contains(&model.name()),
        "{}: {:?}",
        model.name(),
        read.err()
    );
    read.ok()
}

/// The gradient against central differences with Richardson's extrapolation; and that the model gives the same bits as it
/// is written.
fn check(declared: &dyn Declare, data: &Measurements) {
    let basis = basis(200, 60);
    let model = Model::new(declared, Some(&basis), data).unwrap();
    let written = interpreted(declared);
    let written = written.map(|own| Model::new(&own, Some(&basis), data).unwrap());
    let mut rng = rng(7);
    for point in 0..3 {
        let mut u = model.initial();
        for x in &mut u {
            *x += rng.random_range(-0.4..0.4);
        }
        if let Some(written) = &written {
            same(&model, written, &u);
        }
        let mut evaluator = model.evaluator();
        let mut gradient = vec![0.0; model.dim()];
        let lp = evaluator.ln_density(&u, &mut gradient);
        assert!(lp.is_finite(), "{}: {lp}", model.name);
        let mut f = |at: usize, h: f64| {
            let mut x = u.clone();
            x[at] += h;
            evaluator.ln_density(&x, &mut vec![0.0; u.len()])
        };
        for (i, &by_adjoint) in gradient.iter().enumerate() {
            let mut central = |h: f64| (f(i, h) - f(i, -h)) / (2.0 * h);
            let difference = (4.0 * central(5e-4) - central(1e-3)) / 3.0;
            let error = (difference - by_adjoint).abs() / (1.0 + by_adjoint.abs());
            let name = &model.unknown_names()[i];
            assert!(
                error < 1e-6,
                "{}: {name} at point {point}: {difference} {}",
                model.name,
                by_adjoint
            );
        }
    }
}

/// `n` rows at vertices 3i, protocols in turn, with every column that the test models read.
fn rows(n: usize, protocols: &[&str]) -> Measurements {
    let mut rng = rng(3);
    let header = "protocol,vertex,lower,upper,value,force_g,dose,catheter,school,se,dist_mm,hour";
    let mut lines = vec![];
    for i in 0..n {
        let protocol = protocols[i % protocols.len()];
        let lower = 190.0 + 10.0 * (i % 3) as f64;
        let upper = if protocol == "open" && i % 2 == 0 {
            String::new()
        } else {
            (lower + 10.0).to_string()
        };
        let value = if protocol == "event" { i % 2 } else { i % 9 };
        let (force, dose) = (rng.random_range(0.0..3.0), rng.random_range(0.0..2.0));
        lines.push(format!(
            "{protocol},{},{lower},{upper},{value},{force},{dose},c{},s{i},{},{},{}",
            3 * i,
            i % 3,
            8 + i,
            i % 25,
            7 * i % 24
        ));
    }
    place(table(header, &lines))
}

/// Puts rows on the 200 vertices of the made-up basis.
fn place(mut data: Measurements) -> Measurements {
    data.place_at_indices(200).unwrap();
    data
}

#[test]
fn erp() {
    check(shipped("erp"), &rows(20, &["S1S2", "S1S2S3"]));
}

#[test]
fn erp_with_emulators_and_their_error() {
    check(shipped("erp_emulated"), &rows(20, &["S1S2", "S1S2S3"]));
}

#[test]
fn restitution_curves() {
    let line = |value: fn(usize) -> f64| {
        let line = |i: usize| format!("{},{},{}", 7 * (i / 4), 240 + 90 * (i % 4), value(i));
        let lines: Vec<String> = (0..24).map(line).collect();
        place(table("vertex,s2_ms,value", &lines))
    };
    check(shipped("apd_restitution"), &line(|i| 150.0 + 20.0 * (i % 4) as f64));
    check(shipped("cv_restitution"), &line(|i| 0.5 + 0.1 * (i % 4) as f64));
}

#[test]
fn erp_apd_and_cv_together() {
    let kinds = ["s1s2,300,200,210,", "s1s2s3,300,180,190,", "apd,320,,,180", "speed,400,,,0.7"];
    let lines: Vec<String> = (0..24).map(|i| format!("{},{}", 7 * i, kinds[i % 4])).collect();
    check(shipped("joint"), &place(table("vertex,protocol,s2_ms,lower,upper,value", &lines)));
}

#[test]
fn erp_with_exact_intervals_and_open_brackets() {
    let line = |i: usize| {
        let (lower, upper) = [("210", "220"), ("", "205"), ("230", "")][i % 3];
        format!("{},{},{lower},{upper}", ["s1s2", "s1s2s3"][i % 2], 5 * i)
    };
    let lines: Vec<String> = (0..24).map(line).collect();
    check(shipped("erp_exact"), &place(table("protocol,vertex,lower,upper", &lines)));
}

#[test]
fn erp_on_two_length_scales() {
    check(shipped("erp_multiscale"), &rows(20, &["S1S2", "S1S2S3"]));
}

#[test]
fn recovery() {
    check(shipped("recovery"), &rows(20, &["S1S2"]));
}

#[test]
fn measured_data_without_fields() {
    let mut rng = rng(10);
    let mut line = |_| format!("{},{}", rng.random_range(5.0..90.0), rng.random_range(5.0..90.0));
    let lines: Vec<String> = (0..20).map(&mut line).collect();
    check(shipped("restitution"), &table("amp_s1,amp_s2", &lines));
    check(shipped("lat"), &table("path_mm,lat", &lines));
}

#[test]
fn censored_voltages() {
    let row = |i: usize| format!("{},{}", 0.03 * i as f64, ["a", "b"][i % 2]);
    let data = table("bipolar,catheter", &(0..12).map(row).collect::<Vec<_>>());
    check(&posteriors::censored::CensoredVoltage, &data);
}

#[test]
fn effects_of_every_form() {
    check(&forms::Plain, &rows(30, &["s1s2", "direct"]));
}

#[test]
fn numbers_and_a_line_through_them() {
    let mut rng = rng(9);
    let mut number = || rng.random_range(-3.0..3.0f64);
    let mut line = |_| format!("{},{},{},{}", number(), number(), number(), number());
    let data = table("y,x1,x2,x3", &(0..20).map(&mut line).collect::<Vec<_>>());
    check(shipped("normal"), &data);
    check(shipped("regression"), &data);
}

#[test]
fn densities_over_the_table() {
    let line = |i: usize| {
        let (x, y) = (i as f64, (1.3 * i as f64).sin() + 2.0);
        format!("{x},{y},{y},{},{y}", x + 1.0)
    };
    let data = table("x,y,n,time,concentration", &(0..12).map(line).collect::<Vec<_>>());
    check(shipped("garch"), &data);
    check(shipped("one_compartment"), &data);
    check(&posteriors::autoregression::Autoregression, &data);
    check(&posteriors::curve::Curve, &data);
    check(&posteriors::shares::Shares, &data);
}

#[test]
fn counts_and_numbers_of_every_kind() {
    let kinds = ["successes", "events", "delay", "outlier"];
    let line = |i: usize| format!("{},{},{},{},{}", kinds[i % 4], i % 3, i % 5 + 1, 7, i % 3);
    let data = table("protocol,x,value,trials,answer", &(0..24).map(line).collect::<Vec<_>>());
    check(&posteriors::counts::Counts, &data);
    let lines: Vec<String> = (0..12).map(|i| format!("{},{}", i % 5, i % 3)).collect();
    check(&posteriors::answers::Answers, &table("x,answer", &lines));
}

#[test]
fn eight_schools() {
    check(shipped("eight_schools"), &rows(8, &["effect_size"]));
    check(&language::centred::EightSchoolsCentred, &rows(8, &["effect_size"]));
}

#[test]
fn logistic_with_thirty_coefficients() {
    let header = (1..=30).map(|i| format!("x{i}")).collect::<Vec<_>>().join(",") + ",event";
    let mut rng = rng(5);
    let line = |i: usize| {
        let x: Vec<String> = (0..30).map(|_| rng.random_range(-1.0..1.0f64).to_string()).collect();
        format!("{},{}", x.join(","), i % 2)
    };
    let lines: Vec<String> = (0..60).map(line).collect();
    check(&language::logistic::Logistic, &table(&header, &lines));
}

#[test]
fn everything_mixed() {
    let protocols = ["warm_up", "s1s2", "open", "direct", "beats"];
    check(&language::mixed::Mixed, &rows(50, &protocols));
}

#[test]
fn vectors_with_constraints() {
    check(&language::vectors::Vectors, &rows(12, &["y"]));
    check(&vector_priors::nested::Nested, &rows(12, &["y"]));
}

#[test]
fn everything_that_an_expression_may_call() {
    let line = |i: usize| {
        let protocol = ["near", "far", "low", "ratio"][i % 4];
        format!(
            "{protocol},{},{},{},{},{}",
            7 * i,
            0.1 * i as f64,
            0.3 * (i % 5) as f64,
            i % 3,
            0.2 * (i % 7) as f64
        )
    };
    let lines: Vec<String> = (0..24).map(line).collect();
    let data = place(table("protocol,vertex,value,dose,seen1,seen2", &lines));
    check(&called::Called, &data);
}

#[test]
fn a_prior_a_kernel_and_a_likelihood_of_the_users_own() {
    check(shipped("custom"), &rows(30, &["arrival", "offset_seen"]));
}
