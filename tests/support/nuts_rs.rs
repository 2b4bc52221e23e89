//! A chain of nuts-rs on our log density.
#![allow(clippy::unwrap_used, reason = "for tests and benches")]
#![allow(clippy::disallowed_types, reason = "nuts-rs asks for a HashMap")]

use std::collections::HashMap;
use std::convert::Infallible;
use std::env::var;

use eplat::infer::{Chain, Evaluator, LogDensity as _, Settings};
use eplat::model::Model;
use eplat::store::Spool;
use nuts_rs::Settings as _;
use nuts_rs::{
    Chain as _, CpuLogpFunc, CpuMath, CpuMathError, DiagNutsSettings, HasDims, LogpError,
    LowRankNutsSettings, NutsSettings,
};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

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

/// One chain of nuts-rs: diagonal metric, or a low-rank one where `NUTS_RS_METRIC` is `low-rank`. Its
/// warm-up is as long as the settings say, or `NUTS_RS_WARMUP`.
pub(crate) fn chain(model: &Model, index: usize, start: &[f64], settings: &Settings) -> Chain {
    let target = settings.target_accept.unwrap_or(0.8);
    if var("NUTS_RS_METRIC").is_ok_and(|metric| metric == "low-rank") {
        let mut theirs = LowRankNutsSettings::default();
        theirs.adapt_options.step_size_settings.target_accept = target;
        chain_of(theirs, model, index, start, settings)
    } else {
        let mut theirs = DiagNutsSettings::default();
        theirs.adapt_options.step_size_settings.target_accept = target;
        chain_of(theirs, model, index, start, settings)
    }
}

fn chain_of<A>(
    theirs: NutsSettings<A>,
    model: &Model,
    index: usize,
    start: &[f64],
    settings: &Settings,
) -> Chain
where
    A: std::fmt::Debug + Copy + Default + serde::Serialize,
    NutsSettings<A>: nuts_rs::Settings,
{
    let warmup = var("NUTS_RS_WARMUP").map_or(settings.warmup, |n| n.parse().unwrap());
    let theirs = NutsSettings {
        num_tune: warmup as u64,
        num_draws: settings.draws as u64,
        maxdepth: u64::from(settings.max_depth),
        ..theirs
    };
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    rng.set_stream(index as u64);
    let ours = Ours { evaluator: model.evaluator(), dim: model.dim() };
    let mut sampler = theirs.new_chain(index as u64, CpuMath::new(ours), &mut rng).unwrap();
    sampler.set_position(start).unwrap();
    let draws = Spool::new(model.dim(), settings.draws, None);
    let mut chain = Chain { draws, ..Chain::default() };
    for i in 0..warmup + settings.draws {
        let (position, progress) = sampler.draw().unwrap();
        if i < warmup {
            chain.n_grad_warmup += progress.num_gradients;
            continue;
        }
        chain.n_grad_sampling += progress.num_gradients;
        chain.draws.push(&position).unwrap();
        chain.ln_density.push(f64::NAN); // not asked for
        chain.diverging.push(progress.diverging);
    }
    chain
}
