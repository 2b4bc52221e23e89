//! nuts-rs, our NUTS and our blocked sampler on our own gradient of the 10-site problem, in one run.
//!
//! ```text
//! cargo bench --bench nuts_rs                    (EPLAT_SHARED=… for the clinical shell, SEEDS=5)
//! ```
//! The same starts, 8 chains of 1000 + 1000 draws at a target acceptance of 0.95, one thread, the
//! same diagnostics; CPU seconds include the search for starts and the warm-up.
#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs, reason = "a bench")]
#![allow(clippy::disallowed_types, reason = "nuts-rs asks for a HashMap")]

use std::collections::HashMap;
use std::convert::Infallible;

use eplat::infer::{Chain, Evaluator, LogDensity as _, Settings, Silent, jittered_starts};
use eplat::model::{Model, Sampler};
use nuts_rs::Settings as _;
use nuts_rs::{
    Chain as _, CpuLogpFunc, CpuMath, CpuMathError, DiagNutsSettings, HasDims, LogpError,
};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

#[path = "../tests/support/posterior.rs"]
mod posterior;
#[path = "../tests/support/reference.rs"]
mod reference;
#[path = "../tests/support/speed.rs"]
mod speed;

use speed::{Figures, conclude, cpu_seconds};

/// Our log density as nuts-rs wants it.
struct Ours<'m> {
    evaluator: Box<dyn Evaluator + 'm>,
    dim: usize,
}

/// A density that never fails: out of support it is −∞.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
struct Never(Infallible);

impl LogpError for Never {
    fn is_recoverable(&self) -> bool {
        false
    }
}

impl HasDims for Ours<'_> {
    fn dim_sizes(&self) -> HashMap<String, u64> {
        HashMap::from([("unconstrained_parameter".into(), self.dim as u64)])
    }
}

impl CpuLogpFunc for Ours<'_> {
    type LogpError = Never;
    type FlowParameters = ();
    type ExpandedVector = Vec<f64>;

    fn dim(&self) -> usize {
        self.dim
    }
    fn logp(&mut self, position: &[f64], gradient: &mut [f64]) -> Result<f64, Never> {
        Ok(self.evaluator.ln_density(position, gradient))
    }
    fn expand_vector<R: rand::Rng + ?Sized>(
        &mut self,
        _: &mut R,
        position: &[f64],
    ) -> Result<Vec<f64>, CpuMathError> {
        Ok(position.to_vec())
    }
}

/// One chain of nuts-rs, diagonal metric.
fn nuts_rs_chain(model: &Model, index: usize, start: &[f64], settings: &Settings) -> Chain {
    let mut theirs = DiagNutsSettings {
        num_tune: settings.warmup as u64,
        num_draws: settings.draws as u64,
        maxdepth: u64::from(settings.max_depth),
        ..Default::default()
    };
    theirs.adapt_options.step_size_settings.target_accept = settings.target_accept;
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    rng.set_stream(index as u64);
    let ours = Ours { evaluator: model.evaluator(), dim: model.dim() };
    let mut sampler = theirs.new_chain(index as u64, CpuMath::new(ours), &mut rng).unwrap();
    sampler.set_position(start).unwrap();
    let mut chain = Chain::default();
    for i in 0..settings.warmup + settings.draws {
        let (position, progress) = sampler.draw().unwrap();
        if i < settings.warmup {
            chain.n_grad_warmup += progress.num_gradients;
            continue;
        }
        chain.n_grad_sampling += progress.num_gradients;
        chain.draws.extend_from_slice(&position);
        chain.ln_density.push(f64::NAN); // not asked for
        chain.diverging.push(progress.diverging);
    }
    chain
}

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
            each.map(|(i, start)| nuts_rs_chain(model, i, start, settings)).collect()
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
            let settings = Settings { chains: 8, threads: 1, seed, ..Settings::default() };
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
