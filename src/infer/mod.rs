//! Inference on any differentiable log density: NUTS and its warm-up, an optimiser
//! for its start, and the normal approximation at a mode.
//!
//! Knows nothing of fields, electrophysiology or models: only [`LogDensity`].

mod adapt;
mod blocked;
mod chain;
mod error;
mod hamiltonian;
mod laplace;
mod moments;
mod nuts;
mod optimise;
mod sample;
mod start;
#[cfg(test)]
mod test_densities;
mod tree;
mod vector;

pub use blocked::{BlockLayout, Design, Latent, LatentGaussian, Layout, Shape, sample_blocked};
pub use error::{ChainError, ChainFailure, InferError};
pub use laplace::{Laplace, LaplaceDraws};
pub use optimise::{Optimum, OptimumSettings, maximise};
pub use sample::{
    Chain, ChainProgress, ChainResult, Divergence, MetricKind, Phase, Progress, Settings, Silent,
    sample,
};
pub use start::jittered_starts;

/// A log density over `R^dim`, up to a constant.
pub trait LogDensity: Sync {
    /// Number of unconstrained unknowns.
    fn dim(&self) -> usize;
    /// A function object with its own scratch memory, one per thread.
    fn evaluator(&self) -> Box<dyn Evaluator + '_>;
}

/// Evaluates a [`LogDensity`]; holds scratch memory, so that an evaluation allocates nothing.
pub trait Evaluator {
    /// Log density at `position`; writes its gradient. Out of support: −∞ (never a panic).
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64;
}
