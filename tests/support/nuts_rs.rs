//! A chain of nuts-rs on our log density.
#![allow(clippy::unwrap_used, reason = "for tests and benches")]
#![allow(clippy::disallowed_types, reason = "nuts-rs asks for a HashMap")]

use std::collections::HashMap;
use std::convert::Infallible;

use eplat::infer::{Chain, Evaluator, LogDensity as _, Settings};
use eplat::model::Model;
use nuts_rs::Settings as _;
use nuts_rs::{
    Chain as _, CpuLogpFunc, CpuMath, CpuMathError, DiagNutsSettings, HasDims, LogpError,
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

/// One chain of nuts-rs, diagonal metric.
pub(crate) fn chain(model: &Model, index: usize, start: &[f64], settings: &Settings) -> Chain {
    let mut theirs = DiagNutsSettings {
        num_tune: settings.warmup as u64,
        num_draws: settings.draws as u64,
        maxdepth: u64::from(settings.max_depth),
        ..Default::default()
    };
    theirs.adapt_options.step_size_settings.target_accept = settings.target_accept.unwrap_or(0.8);
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
