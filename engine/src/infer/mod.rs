//! Inference on any differentiable log density: NUTS and its warm-up, a sampler for blocks of
//! latent Gaussians, an optimiser for their start, and the normal approximation at a mode.
//!
//! Knows nothing of fields, electrophysiology or models: only [`LogDensity`].
//!
//! A chain is moved on one draw at a time; [`sample`] does so for several chains in parallel, with
//! progress and checkpoints.
//!
//! ```
//! # extern crate eplat_engine as eplat;
//! use eplat::infer::{Evaluator, LogDensity, MarkovChain, Nuts, Settings};
//!
//! /// Two independent normals, with standard deviations 1 and 10.
//! struct Normals;
//!
//! impl LogDensity for Normals {
//!     fn dim(&self) -> usize {
//!         2
//!     }
//!     fn evaluator(&self) -> Box<dyn Evaluator + '_> {
//!         Box::new(Normals)
//!     }
//! }
//!
//! impl Evaluator for Normals {
//!     fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
//!         let precision = [1.0, 0.01];
//!         for i in 0..2 {
//!             gradient[i] = -precision[i] * position[i];
//!         }
//!         0.5 * (position[0] * gradient[0] + position[1] * gradient[1])
//!     }
//! }
//!
//! let mut chain = Nuts::new(&Normals, &[0.1, 2.0], &Settings::default())?;
//! let mut squares = [0.0; 2];
//! for _ in 0..1000 {
//!     let draw = chain.draw()?; // the first one comes after the warm-up
//!     for (sum, x) in squares.iter_mut().zip(draw.position) {
//!         *sum += x * x / 1000.0;
//!     }
//! }
//! assert!((squares[0] - 1.0).abs() < 0.3 && (squares[1] - 100.0).abs() < 30.0);
//! # Ok::<(), eplat::infer::InferError>(())
//! ```

mod blocked;
mod cholesky;
mod curvature;
mod density;
mod directions;
mod draws;
mod error;
mod far_apart;
mod flow;
mod hamiltonian;
mod integrated;
mod kernel;
mod kernel_state;
mod laplace;
mod lesson;
mod markov;
mod moments;
mod nuts;
mod optimise;
mod progress;
mod run;
mod sample;
mod scales;
mod settings;
mod stages;
mod start;
#[cfg(test)]
mod test_densities;
mod tree;
mod warmup;

pub use blocked::{
    BlockLayout, Blocked, Design, Group, Latent, LatentGaussian, Layout, RowWithout, Shape,
    WithoutRows, sample_blocked, without_rows,
};
pub(crate) use cholesky::Factor;
pub use density::{Evaluator, LogDensity};
pub use draws::{Chain, ChainResult, Divergence, Draw, Transition};
pub use error::{ChainError, ChainFailure, InferError};
pub use integrated::{Integrated, sample_integrated};
pub use laplace::{Laplace, LaplaceDraws};
pub use markov::MarkovChain;
pub use nuts::Nuts;
pub use optimise::{Optimum, OptimumSettings, maximise};
pub use progress::{ChainProgress, Phase, Progress, Silent};
pub use sample::sample;
pub use settings::{MetricKind, Settings};
pub use start::jittered_starts;
pub(crate) use start::{climbs, climbs_on, starts_at};
