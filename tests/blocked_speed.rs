//! Effective draws per CPU second on the reference problems, over seeds.
//!
//! ```text
//! cargo test --profile bench --test blocked_speed -- --ignored --nocapture
//! SITES=40 SEEDS=20 cargo test --profile bench --test blocked_speed -- --ignored --nocapture
//! ```
//! The profile of benches compiles the model as `eplat run` does; with that of tests it is several times slower.
//! Environment variables change what is measured: `MODEL` (erp, exact, multiscale), `MESH` (a file in
//! mm), `TABLE` (measurements on it), `SITES`, `SEEDS`, `CHAINS`, `WARMUP`, `DRAWS`, `TARGET` in per
//! cent, `NUTS=1`. Without `MODEL` and `MESH` it is a reference problem; `EPLAT_SHARED` finds its shell.
#![allow(clippy::unwrap_used, reason = "a test")]

#[path = "support/posterior.rs"]
mod posterior;
#[path = "support/reference.rs"]
mod reference;
#[path = "support/speed.rs"]
mod speed;

use std::env::var;
use std::path::Path;

use eplat::infer::{Settings, Silent, jittered_starts};
use eplat::manifold::{Basis, eigenpairs_cached};
use eplat::mesh::{self, Units};
use eplat::model::{Declare, Model, Sampler};
use eplat::table::Measurements;
use posterior::shipped::shipped;
use posterior::{all, experiment_on};
use speed::{Figures, conclude, cpu_seconds};

fn number(name: &str, default: usize) -> usize {
    var(name).ok().and_then(|s| s.parse().ok()).unwrap_or(default)
}

fn declared(n_sites: usize) -> &'static dyn Declare {
    match var("MODEL").as_deref() {
        Ok("exact") => shipped("erp_exact"),
        Ok("multiscale") => shipped("erp_multiscale"),
        Ok("erp") => shipped("erp"),
        Ok(other) => panic!("MODEL={other}: expected erp, exact or multiscale"),
        Err(_) => reference::model(n_sites),
    }
}

/// The table named, or the model's experiment on the mesh named, or on that of the reference problems.
fn problem(n_sites: usize) -> (Basis, Measurements) {
    let Ok(path) = var("MESH") else {
        return experiment_on(&reference::surface().1, declared(n_sites), n_sites);
    };
    let surface = mesh::read(Path::new(&path), Units::Mm).unwrap();
    let Ok(table) = var("TABLE") else {
        return experiment_on(&surface.mesh, declared(n_sites), n_sites);
    };
    let mut table = Measurements::read(Path::new(&table)).unwrap();
    table.place_on(&surface, 1.0).unwrap();
    (eigenpairs_cached(&surface.mesh, 60).unwrap(), table)
}

#[test]
#[ignore = "a measurement, 1 minute"]
fn speed() {
    let sampler = if number("NUTS", 0) == 1 { Sampler::Nuts } else { Sampler::Blocked };
    let settings = Settings {
        chains: number("CHAINS", 8),
        warmup: number("WARMUP", 1000),
        draws: number("DRAWS", 1000),
        target_accept: Some(number("TARGET", 95) as f64 / 100.0),
        threads: 1,
        ..Settings::default()
    };
    let n_sites = number("SITES", 10);
    let (basis, data) = problem(n_sites);
    let model = Model::new(declared(n_sites), Some(&basis), &data).unwrap();
    let mut runs = vec![];
    for seed in 1..=number("SEEDS", 10) as u64 {
        let settings = Settings { seed, ..settings.clone() };
        let begun = cpu_seconds();
        let starts = jittered_starts(&model, &model.initial(), settings.chains, seed).unwrap();
        let chains = all(sampler.sample(&model, &starts, &settings, &Silent).unwrap());
        let cpu = cpu_seconds() - begun;
        let run = Figures::new(&model, &chains, cpu);
        eprintln!("seed {seed}: {run}");
        runs.push(run);
    }
    eprintln!("{}", conclude(&format!("{}, {n_sites} sites", sampler.name()), &runs));
}
