//! Whether 90 % intervals hold what they say: `models/erp_robust.rs` beside `models/erp.rs`, on the same
//! truths and the same measurements. `docs/robust.md` has the figures.
//!
//! ```sh
//! CONDITIONS=paper,10,10;strip,10,10 SEEDS=1..40 \
//!     cargo test --release --test coverage the_study -- --ignored --nocapture
//! ```
//! A condition is the origin of the truth (bounded, paper, strip), the number of sites, and the width of the
//! brackets in ms.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test")]

#[path = "support/cpu.rs"]
mod cpu;
#[path = "support/robust_variants.rs"]
mod robust_variants;
#[path = "support/shipped.rs"]
mod shipped;
#[path = "support/truths.rs"]
mod truths;

use std::env;
use std::fmt::Write as _;
use std::sync::Arc;

use eplat::criticism::{predict_rows, with_heldout};
use eplat::experiment::{coverage, rms_error, thinned};
use eplat::model::{Declare, Maps, Model};
use eplat::run::{Domain, Fit, Loaded, Problem, Settings};
use eplat::table::Measurements;
use shipped::shipped;
use truths::{Case, Condition, Origin};

/// What is told of a calibration, each a number whose mean over the seeds counts.
const COLUMNS: [&str; 12] = [
    "tau_out",
    "apd_max",
    "erp_s2",
    "erp_s3",
    "brackets",
    "tau_out, ms",
    "apd_max, ms",
    "erp_s2, ms",
    "erp_s3, ms",
    "unphysical",
    "CPU s",
    "converged",
];
/// Of the columns those of root mean squared errors.
const ERRORS: std::ops::Range<usize> = 5..9;
/// Intervals are judged at one in so many vertices.
const STRIDE: usize = 5;

/// A calibration of `case` by `model`: [`COLUMNS`].
fn calibrate(model: &dyn Declare, domain: &Arc<Domain>, case: &Case, seed: u64) -> Vec<f64> {
    let measurements = placed(&case.train, domain);
    let loaded = Loaded { domain: Some(domain.clone()), measurements, ..Loaded::default() };
    let problem = Problem::new(model, loaded).unwrap();
    let begun = cpu::cpu_seconds();
    let settings = Settings { threads: 1, seed, draws: 500, ..Settings::default() };
    let fit = problem.fit(&settings).unwrap();
    let seconds = cpu::cpu_seconds() - begun;
    let vertices: Vec<usize> = (0..domain.basis.n_vertices()).step_by(STRIDE).collect();
    let maps = Maps::new(fit.model(), &domain.basis);
    let draws = maps.draws_at(&thinned(fit.chains(), 400).unwrap(), &vertices);
    let (mut held, mut errors) = (vec![], vec![]);
    for (i, truth) in case.maps.iter().enumerate() {
        let truth: Vec<f64> = vertices.iter().map(|v| truth[*v]).collect();
        let own = || draws.iter().map(|maps| maps[i].as_slice());
        let ranks: Vec<f64> = own().zip(&truth).map(|(draws, x)| rank(draws, *x)).collect();
        held.push(100.0 * coverage(&ranks)[1]);
        errors.push(rms_error(&own().map(mean_of_known).collect::<Vec<f64>>(), &truth));
    }
    held.push(brackets_held(&fit, domain, case, seed));
    // beyond its range ERP_S2 is void, or a field is
    let void = draws.iter().flat_map(|maps| &maps[2]).filter(|x| x.is_nan()).count();
    let n = draws.iter().map(|maps| maps[2].len()).sum::<usize>();
    let r_hat = fit.summary().iter().map(|row| row.summary.r_hat).filter(|r| r.is_finite());
    let converged = if r_hat.fold(0.0, f64::max) <= 1.02 { 100.0 } else { 0.0 };
    [held, errors, vec![100.0 * void as f64 / n as f64, seconds, converged]].concat()
}

/// The share of known draws below `truth`; NaN where there is nothing to compare.
fn rank(draws: &[f64], truth: f64) -> f64 {
    let known = draws.iter().filter(|x| !x.is_nan()).count() as f64;
    let below = draws.iter().filter(|x| **x < truth).count() as f64;
    if truth.is_nan() { f64::NAN } else { below / known }
}

fn mean_of_known(draws: &[f64]) -> f64 {
    let known: Vec<f64> = draws.iter().copied().filter(|x| !x.is_nan()).collect();
    known.iter().sum::<f64>() / known.len() as f64
}

/// Share in % of held-out brackets that lie in the central 90 % of their replicates; ties are split at random, since
/// brackets are steps of a grid.
fn brackets_held(fit: &Fit<'_>, domain: &Domain, case: &Case, seed: u64) -> f64 {
    let table = placed(&with_heldout(&case.train, &case.heldout, &[]), domain);
    let joint = Model::new(fit.problem().declared(), Some(&domain.basis), &table).unwrap();
    let draws = fit.thinned(400).unwrap();
    let predicted = predict_rows(&joint, fit.model(), &draws, case.train.len(), seed);
    let ranks: Vec<f64> = predicted.rows.iter().map(|p| p.quantile).collect();
    100.0 * coverage(&ranks)[1]
}

fn placed(table: &Measurements, domain: &Domain) -> Measurements {
    let mut table = table.clone();
    table.place_on(&domain.surface, domain.scale).unwrap();
    table.probe(&domain.surface, &domain.basis).unwrap();
    table
}

fn condition(text: &str) -> Condition {
    let parts: Vec<&str> = text.split(',').collect();
    let origin = match parts[0] {
        "bounded" => Origin::Bounded,
        "paper" => Origin::Paper,
        "strip" => Origin::Strip,
        other => panic!("no origin {other}"),
    };
    Condition { origin, sites: parts[1].parse().unwrap(), width: parts[2].parse().unwrap() }
}

#[test]
#[ignore = "the study of docs/robust.md: an hour"]
fn the_study() {
    let conditions = env::var("CONDITIONS").unwrap_or_else(|_| "paper,10,10".into());
    let seeds = env::var("SEEDS").unwrap_or_else(|_| "1..40".into());
    let (first, last) = seeds.split_once("..").unwrap();
    let (first, last): (u64, u64) = (first.parse().unwrap(), last.parse().unwrap());
    let domain = truths::domain();
    let names = env::var("MODELS").unwrap_or_default();
    let is_asked = |m: &&dyn Declare| names.is_empty() || names.split(',').any(|n| n == m.name());
    let models: Vec<&dyn Declare> = robust_variants::all().into_iter().filter(is_asked).collect();
    println!("truth, sites, width, model, seed, {}", COLUMNS.join(", "));
    for text in conditions.split(';') {
        let condition = condition(text);
        let mut results: Vec<Vec<Vec<f64>>> = vec![vec![]; models.len()];
        for seed in first..=last {
            let case = condition.case(&domain, shipped("erp"), seed);
            for (model, results) in models.iter().zip(&mut results) {
                let found = calibrate(*model, &domain, &case, seed);
                let cells: Vec<String> = found.iter().map(|x| format!("{x:.2}")).collect();
                println!("{text},{},{seed},{}", model.name(), cells.join(","));
                results.push(found);
            }
        }
        for (model, own) in models.iter().zip(&results) {
            println!("{}", line(text, model.name(), own, &results[0]));
        }
    }
}

/// A line of the table: means with their standard errors and, of the root mean squared errors, what they are more
/// than those of the first model.
fn line(condition: &str, model: &str, own: &[Vec<f64>], first: &[Vec<f64>]) -> String {
    let mut line = format!("| {condition} | {model} |");
    for i in 0..COLUMNS.len() {
        let (value, error) = mean(own.iter().map(|found| found[i]));
        let _ = write!(line, " {value:.1} ± {error:.1}");
        if ERRORS.contains(&i) {
            let (more, error) = mean(own.iter().zip(first).map(|(a, b)| a[i] - b[i]));
            let _ = write!(line, " ({more:+.2} ± {error:.2})");
        }
        line += " |";
    }
    line
}

/// Mean of what is known, and its standard error.
fn mean(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let known: Vec<f64> = values.filter(|x| x.is_finite()).collect();
    let n = known.len() as f64;
    let mean = known.iter().sum::<f64>() / n;
    let squares: f64 = known.iter().map(|x| (x - mean).powi(2)).sum();
    (mean, (squares / (n - 1.0) / n).sqrt())
}
