//! Effective draws per CPU second of the blocked sampler and of NUTS on the ERP models, ten seeds.
//!
//! ```text
//! cargo test --release --test blocked_speed -- --ignored --nocapture
//! ```
//! Environment variables change what is measured: `MODEL` (erp, exact, multiscale), `MESH` (a file in
//! mm), `TABLE` (measurements on it), `SITES`, `SEEDS`, `CHAINS`, `WARMUP`, `DRAWS`, `TARGET` in per
//! cent, `NUTS=1`.
#![allow(clippy::unwrap_used, reason = "a test")]

#[path = "../models/erp_exact.rs"]
mod erp_exact;
#[path = "../models/erp_multiscale.rs"]
mod erp_multiscale;
#[path = "support/posterior.rs"]
mod posterior;

use eplat::dsl::{Declare, Measurements, Model, Sampler};
use eplat::infer::{Settings, Silent, jittered_starts};
use eplat::manifold::{Basis, eigenpairs_cached};
use eplat::mesh::{self, Units, left_atrium};
use posterior::{all, columns, erp, experiment_on};
use std::env::var;
use std::path::Path;

/// CPU seconds of this process, user and system; Linux counts them in hundredths.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|s| s.parse::<f64>().ok()).unwrap_or(f64::NAN);
    (ticks(11) + ticks(12)) / 100.0
}

fn number(name: &str, default: usize) -> usize {
    var(name).ok().and_then(|s| s.parse().ok()).unwrap_or(default)
}

fn declared() -> &'static dyn Declare {
    match var("MODEL").as_deref() {
        Ok("exact") => &erp_exact::ErpExact,
        Ok("multiscale") => &erp_multiscale::ErpMultiscale,
        _ => &erp::Erp,
    }
}

/// The table named, or an experiment on the mesh named, or on the embedded atrium.
fn problem(n_sites: usize) -> (Basis, Measurements) {
    let Ok(path) = var("MESH") else {
        return experiment_on(&left_atrium(1.5).mesh, declared(), n_sites);
    };
    let surface = mesh::read(Path::new(&path), Units::Mm).unwrap();
    let Ok(table) = var("TABLE") else { return experiment_on(&surface.mesh, declared(), n_sites) };
    let mut table = Measurements::read(Path::new(&table)).unwrap();
    table.place_on(&surface, 1.0).unwrap();
    (eigenpairs_cached(&surface.mesh, 60).unwrap(), table)
}

fn measure(sampler: Sampler, n_sites: usize, settings: &Settings, seeds: u64) {
    let (basis, measurements) = problem(n_sites);
    let model = Model::new(declared(), Some(&basis), &measurements).unwrap();
    let mut rates = vec![];
    for seed in 1..=seeds {
        let settings = Settings { seed, threads: 1, ..settings.clone() };
        let begun = cpu_seconds();
        let starts = jittered_starts(&model, &model.initial(), settings.chains, seed).unwrap();
        let chains = all(sampler.sample(&model, &starts, &settings, &Silent).unwrap());
        let cpu = cpu_seconds() - begun;
        let columns = columns(&model, &chains);
        let worst = |of: &dyn Fn(&posterior::Column) -> f64| {
            let values = columns.iter().map(|c| (of(c), c.name.as_str()));
            values.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
        };
        let (bulk, of_bulk) = worst(&|c| c.summary().ess_bulk);
        let (tail, of_tail) = worst(&|c| c.summary().ess_tail);
        let (r_hat, of_r_hat) = worst(&|c| -c.summary().r_hat);
        let divergences = chains.iter().flat_map(|c| &c.diverging).filter(|d| **d).count();
        let leapfrogs = chains.iter().flat_map(|c| &c.n_leapfrog).map(|n| f64::from(*n));
        let n_draws = (settings.chains * settings.draws) as f64;
        eprintln!(
            "{} seed {seed}: {cpu:.2} s, bulk {bulk:.0} ({of_bulk}), tail {tail:.0} ({of_tail}), \
             R-hat {:.4} ({of_r_hat}), {divergences} divergences, {:.1} leapfrogs, step {:.2}, \
             {:.0} ESS/s; energy {:.2}",
            sampler.name(),
            -r_hat,
            leapfrogs.sum::<f64>() / n_draws,
            chains[0].step_size,
            bulk / cpu,
            eplat::diagnostics::e_bfmi(&chains[0].energy),
        );
        rates.push(bulk / cpu);
    }
    rates.sort_by(f64::total_cmp);
    eprintln!("{} sites {n_sites}: median {:.0} ESS/CPU-s", sampler.name(), rates[rates.len() / 2]);
}

#[test]
#[ignore = "a measurement, 1 minute"]
fn speed() {
    let sampler = if number("NUTS", 0) == 1 { Sampler::Nuts } else { Sampler::Blocked };
    let settings = Settings {
        chains: number("CHAINS", 8),
        warmup: number("WARMUP", 1000),
        draws: number("DRAWS", 1000),
        target_accept: number("TARGET", 95) as f64 / 100.0,
        ..Settings::default()
    };
    let seeds = number("SEEDS", 10) as u64;
    measure(sampler, number("SITES", 10), &settings, seeds);
}
