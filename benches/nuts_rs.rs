//! nuts-rs, our NUTS and our blocked sampler on our own gradient of the 10-site problem, in one run.
//!
//! ```text
//! cargo bench --bench nuts_rs                    (EPLAT_SHARED=… for the clinical shell, SEEDS=5)
//! ```
//! The same starts, 8 chains of 1000 + 1000 draws at a target acceptance of 0.95, one thread, the
//! same diagnostics; CPU seconds include the search for starts and the warm-up.
#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs, reason = "a bench")]

use eplat::infer::{Chain, LogDensity as _, Settings, Silent, jittered_starts};
use eplat::model::{Model, Sampler};

#[path = "../tests/support/nuts_rs.rs"]
mod nuts_rs_chain;
#[path = "../tests/support/posterior.rs"]
mod posterior;
#[path = "../tests/support/reference.rs"]
mod reference;
#[path = "../tests/support/speed.rs"]
mod speed;

use speed::{Figures, conclude, cpu_seconds};

fn chains(who: &str, model: &Model, settings: &Settings) -> Vec<Chain> {
    let starts = jittered_starts(model, &model.initial(), settings.chains, settings.seed).unwrap();
    let ours = |sampler: Sampler| {
        posterior::all(sampler.sample(model, &starts, settings, &Silent).unwrap())
    };
    match who {
        "blocked" => ours(Sampler::Blocked),
        "nuts" => ours(Sampler::Nuts),
        _ => {
            let each = starts.iter().enumerate();
            each.map(|(i, start)| nuts_rs_chain::chain(model, i, start, settings)).collect()
        }
    }
}

fn main() {
    let (name, mesh) = reference::surface();
    let model = reference::model(10);
    let (basis, data) = posterior::experiment_on(&mesh, model, 10);
    let model = Model::new(model, Some(&basis), &data).unwrap();
    println!("10 sites on the {name}, {} unknowns", model.dim());
    let seeds = std::env::var("SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(5);
    for who in ["nuts-rs", "nuts", "blocked"] {
        let mut runs = vec![];
        for seed in 1..=seeds {
            let settings = Settings {
                chains: 8,
                threads: 1,
                seed,
                target_accept: Some(0.95),
                ..Settings::default()
            };
            let begun = cpu_seconds();
            let chains = chains(who, &model, &settings);
            let cpu = cpu_seconds() - begun;
            let run = Figures::new(&model, &chains, cpu);
            println!("{who} seed {seed}: {run}");
            runs.push(run);
        }
        println!("{}", conclude(who, &runs));
    }
}
