//! Effective draws per CPU second on the reference problems, over seeds.
//!
//! ```text
//! cargo test --release --test blocked_speed -- --ignored --nocapture
//! SITES=40 SEEDS=20 cargo test --release --test blocked_speed -- --ignored --nocapture
//! ```
//! `NUTS=1` measures NUTS instead of the blocked sampler; CHAINS, WARMUP, DRAWS and TARGET (per cent) change
//! the settings. `EPLAT_SHARED` finds the clinical shell.
#![allow(clippy::unwrap_used, reason = "a test")]

#[path = "support/posterior.rs"]
mod posterior;
#[path = "support/reference.rs"]
mod reference;
#[path = "support/speed.rs"]
mod speed;

use eplat::dsl::{Model, Sampler};
use eplat::infer::{Settings, Silent, jittered_starts};
use posterior::all;
use speed::{Figures, conclude, cpu_seconds};

fn number(name: &str, default: usize) -> usize {
    std::env::var(name).ok().and_then(|s| s.parse().ok()).unwrap_or(default)
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
        threads: 1,
        ..Settings::default()
    };
    let n_sites = number("SITES", 10);
    let ground = reference::ground();
    let (model, data) = reference::problem(&ground, n_sites);
    let model = Model::new(model, Some(&ground.basis), &data).unwrap();
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
    let what = format!("{}, {n_sites} sites on the {}", sampler.name(), ground.name);
    eprintln!("{}", conclude(&what, &runs));
}
