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

#[path = "../models/erp.rs"]
mod erp;
#[path = "support/cpu.rs"]
mod cpu;
#[path = "models/robust_candidates.rs"]
mod robust_candidates;
#[path = "support/truths.rs"]
mod truths;

use std::env;
use std::sync::Arc;

use eplat::experiment::{coverage, rms_error, thinned};
use eplat::model::{Declare, Maps};
use eplat::run::{Domain, Loaded, Problem, Settings};
use eplat::table::Measurements;
use truths::{Case, Condition, Origin};

/// What is told of a calibration, each a number whose mean over the seeds counts.
const COLUMNS: [&str; 13] = [
    "tau_out %", "apd_max %", "erp_s2 %", "erp_s3 %", "rows %", "tau rmse", "apd rmse", "s2 rmse",
    "s3 rmse", "unphys %", "CPU s", "conv %", "sd apd",
];

/// A calibration of `case` by `model`.
fn calibrate(model: &dyn Declare, domain: &Arc<Domain>, case: &Case, seed: u64) -> Vec<f64> {
    let placed = |table: &Measurements| {
        let mut table = table.clone();
        table.place_on(&domain.surface, domain.scale).unwrap();
        table.probe(&domain.surface, &domain.basis).unwrap();
        table
    };
    let measurements = placed(&case.train);
    let loaded = Loaded { domain: Some(domain.clone()), measurements, ..Loaded::default() };
    let problem = Problem::new(model, loaded).unwrap();
    let begun = cpu::cpu_seconds();
    let draws: usize = env::var("DRAWS").map_or(500, |d| d.parse().unwrap());
    let fit = problem.fit(&Settings { threads: 1, seed, draws, ..Settings::default() }).unwrap();
    let seconds = cpu::cpu_seconds() - begun;
    let maps = Maps::new(fit.model(), &domain.basis);
    let draws = thinned(fit.chains(), 400);
    let truth: Vec<&[f64]> = case.maps.iter().map(Vec::as_slice).collect();
    let (summary, unphysical) = maps.summarise(&draws);
    let mut out: Vec<f64> =
        maps.ranks(&draws, &truth).iter().map(|ranks| 100.0 * coverage(ranks)[1]).collect();
    out.push(rows_held(&fit.predict(&case.heldout).unwrap(), &case.heldout));
    out.extend(summary.iter().zip(&truth).map(|(map, truth)| rms_error(&map.mean, truth)));
    out.push(100.0 * unphysical.iter().sum::<f64>() / unphysical.len() as f64);
    out.push(seconds);
    let worst = fit.summary().iter().map(|row| row.summary.r_hat).filter(|r| r.is_finite());
    out.push(if worst.fold(0.0, f64::max) <= 1.02 { 100.0 } else { 0.0 });
    out.push(summary[1].sd.iter().sum::<f64>() / summary[1].sd.len() as f64);
    out
}

/// Share in % of held-out brackets whose middle lies in its predicted 90 % interval.
fn rows_held(predicted: &[eplat::run::Prediction], table: &Measurements) -> f64 {
    let held = predicted.iter().filter(|p| {
        let middle = 0.5 * (table.number(p.row, "lower", "").unwrap() + table.number(p.row, "upper", "").unwrap());
        (p.quantiles[0]..=p.quantiles[2]).contains(&middle)
    });
    100.0 * held.count() as f64 / predicted.len() as f64
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

/// Mean and its standard error.
fn mean(values: &[f64]) -> (f64, f64) {
    let known: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    let n = known.len() as f64;
    let mean = known.iter().sum::<f64>() / n;
    let squares: f64 = known.iter().map(|x| (x - mean).powi(2)).sum();
    (mean, (squares / (n - 1.0) / n).sqrt())
}

#[test]
#[ignore = "the study of docs/robust.md: an hour"]
fn the_study() {
    let conditions = env::var("CONDITIONS").unwrap_or_else(|_| "paper,10,10".into());
    let seeds = env::var("SEEDS").unwrap_or_else(|_| "1..40".into());
    let (first, last) = seeds.split_once("..").unwrap();
    let (first, last): (u64, u64) = (first.parse().unwrap(), last.parse().unwrap());
    let domain = truths::domain();
    let all = robust_candidates::all();
    let names = env::var("MODELS").unwrap_or_default();
    let models: Vec<&dyn Declare> = all.into_iter().filter(|m| names.is_empty() || names.split(',').any(|n| n == m.name())).collect();
    println!("| condition | model | {} |", COLUMNS.join(" | "));
    println!("|---|---|{}", "---|".repeat(COLUMNS.len()));
    for text in conditions.split(';') {
        let condition = condition(text);
        let mut results: Vec<Vec<Vec<f64>>> = vec![vec![]; models.len()];
        for seed in first..=last {
            let case = condition.case(&domain, &erp::Erp, seed);
            for (model, results) in models.iter().zip(&mut results) {
                results.push(calibrate(*model, &domain, &case, seed));
            }
        }
        for (model, results) in models.iter().zip(&results) {
            let column = |i: usize| mean(&results.iter().map(|r| r[i]).collect::<Vec<f64>>());
            let cells = (0..COLUMNS.len()).map(|i| { let (m, e) = column(i); format!("{m:.1} ± {e:.1}") });
            println!("| {text} | {} | {} |", model.name(), cells.collect::<Vec<_>>().join(" | "));
        }
    }
}
