//! Rows told with the fields integrated out, beside fits without each of them: default experiments of the seeds 1, 2, …
//!
//! ```text
//! cargo test --profile bench --test rows_left_out -- --ignored --nocapture
//! SITES=40 SEEDS=1 cargo test --profile bench --test rows_left_out -- --ignored --nocapture
//! ```
//! A row is *told* where the Pareto k of its weights is low enough. Prints how many are not, by how much the others are off
//! from fits of 4 × 2000 draws and those of the run together, and the CPU time of telling them.
#![allow(clippy::unwrap_used, reason = "a test")]

#[path = "support/posterior.rs"]
mod posterior;
#[path = "support/speed.rs"]
mod speed;

use std::env::var;

use eplat::diagnostics::{LooPoint, bridged, k_threshold};
use eplat::experiment::{Design, TRUTH_MODES, experiment};
use eplat::infer::{Chain, Settings, Silent, jittered_starts};
use eplat::manifold::{Basis, eigenpairs_cached};
use eplat::mesh::left_atrium;
use eplat::model::{Model, Noise, RowId, Sampler};
use eplat::table::Measurements;
use posterior::all;
use posterior::shipped::shipped;
use rayon::prelude::*;
use speed::cpu_seconds;

/// Draws of the posterior that rows are told from.
const KEPT: usize = 1000;

fn number(name: &str, default: usize) -> usize {
    var(name).map_or(default, |s| s.parse().unwrap())
}

fn fit(model: &Model, starts: &[Vec<f64>], settings: &Settings) -> Vec<Chain> {
    all(Sampler::of(model).sample(model, starts, settings, &Silent).unwrap())
}

/// Log predictive density of a row, by a fit without it that starts where these chains ended.
fn by_a_fit(basis: &Basis, data: &Measurements, id: RowId, chains: &[Chain], seed: u64) -> f64 {
    let mut model = Model::new(shipped("erp"), Some(basis), data).unwrap();
    model.leave_out(id);
    let settings = Settings { seed, draws: 2000, warmup: 600, threads: 1, ..Settings::default() };
    let starts: Vec<Vec<f64>> =
        chains.iter().map(|c| c.draw(c.n_draws() - 1).unwrap().into_owned()).collect();
    let (cells, mut tape, mut locals) = (model.measured_row(id), model.tape(), vec![]);
    let mut ln_at = |chains: &[Chain]| {
        let mut ln = vec![];
        for (chain, i) in chains.iter().flat_map(|c| (0..c.n_draws()).map(move |i| (c, i))) {
            model.locals_at(&mut tape, &chain.draw(i).unwrap(), &[id], &mut locals);
            ln.push(model.row_ln(id, &cells, &locals, &Noise::default()));
        }
        ln
    };
    bridged(&ln_at(chains), &ln_at(&fit(&model, &starts, &settings)))
}

#[test]
#[ignore = "a measurement, 2 minutes"]
fn rows_are_told_as_fits_without_them_tell() {
    let n_sites = number("SITES", 10);
    let mesh = left_atrium(1.5).mesh;
    let basis = eigenpairs_cached(&mesh, TRUTH_MODES).unwrap();
    let (mut off, mut n_rows, mut time) = (vec![], 0, 0.0);
    for seed in 1..=number("SEEDS", 4) as u64 {
        let design = Design { n_sites, seed, ..Design::default() };
        let data = experiment(shipped("erp"), &mesh, &basis, &design).unwrap().measurements;
        let model = Model::new(shipped("erp"), Some(&basis), &data).unwrap();
        let settings = Settings { seed, ..Settings::default() };
        let starts = jittered_starts(&model, &model.initial(), settings.chains, seed).unwrap();
        let chains = fit(&model, &starts, &settings);
        let each = chains.len() * chains[0].n_draws() / KEPT;
        let draws: Vec<Vec<f64>> = (each - 1..chains[0].n_draws())
            .step_by(each)
            .flat_map(|i| chains.iter().map(move |c| c.draw(i).unwrap().into_owned()))
            .collect();
        let ids = model.row_ids();
        let begun = cpu_seconds();
        let told = model.predictive(&draws, &ids, seed);
        time += cpu_seconds() - begun;
        n_rows += ids.len();
        let told: Vec<(RowId, f64)> = ids
            .into_iter()
            .zip(told)
            .filter_map(|(id, row)| {
                let row = row?;
                let (point, weights) = LooPoint::weighted(&row.ln_density, &row.ln_weight)?;
                (point.pareto_k <= k_threshold(weights.len())).then_some((id, point.elpd))
            })
            .collect();
        let one = |(id, elpd): &(RowId, f64)| elpd - by_a_fit(&basis, &data, *id, &chains, seed);
        off.par_extend(told.par_iter().map(one));
    }
    let n = off.len() as f64;
    let rms = (off.iter().map(|x| x * x).sum::<f64>() / n).sqrt();
    let mean = off.iter().sum::<f64>() / n;
    eprintln!(
        "{n_sites} sites: {} of {n_rows} rows not told; the others {mean:+.3} nats off in the mean, {rms:.3} rms; \
         {time:.1} CPU seconds",
        n_rows - off.len()
    );
    // particles that knew only where draws of the posterior are had 0.26
    assert!(rms < 0.15, "{rms}");
    assert!(off.len() * 10 > n_rows * 7, "{} of {n_rows} told", off.len());
}
