//! The sampling of a run: progress, interruption, chains that fail.

use std::time::Instant;

use super::interrupt::stop_flag;
use super::output::Sampled;
use super::progress::ChainBars;
use crate::error::Failure;
use crate::infer::{ChainError, ChainFailure, LogDensity as _, Settings};
use crate::model::{Model, Sampler};
use crate::store::Checkpoint;

/// What is sampled, and how.
pub(super) struct Job<'a> {
    pub(super) model: &'a Model,
    pub(super) sampler: Sampler,
    pub(super) settings: &'a Settings,
    /// One per chain.
    pub(super) starts: &'a [Vec<f64>],
    pub(super) begun: Instant,
}

impl Job<'_> {
    /// Samples, kept in `checkpoint`, which is given back; no result if interrupted.
    pub(super) fn sample(
        &self,
        checkpoint: Checkpoint,
    ) -> Result<(Option<Sampled>, Checkpoint), Failure> {
        eprintln!(
            "model  {}: {} unknowns, sampler {}, ready in {:.1} s",
            self.model.name,
            self.model.dim(),
            self.sampler.name(),
            self.begun.elapsed().as_secs_f64()
        );
        let sampling = Instant::now();
        let bars = ChainBars::new(self.settings, checkpoint, stop_flag()?);
        let results = self.sampler.sample(self.model, self.starts, self.settings, &bars)?;
        let checkpoint = bars.finish();
        let seconds_before = checkpoint.seconds_before();
        let mut sampled = Sampled {
            seconds: seconds_before + sampling.elapsed().as_secs_f64(),
            seconds_before,
            ..Sampled::default()
        };
        for result in results {
            match result {
                Ok(chain) => sampled.chains.push(chain),
                Err(ChainError { failure: ChainFailure::Stopped, .. }) => {
                    return Ok((None, checkpoint));
                }
                Err(error) => {
                    eprintln!("warning: {error}");
                    sampled.failures.push(error.to_string());
                }
            }
        }
        Ok((Some(sampled), checkpoint))
    }
}

/// There is nothing to report on.
pub(super) fn every_chain_failed(failures: &[String]) -> Failure {
    let first = failures.first().map_or("", String::as_str);
    Failure::new(format_args!("every chain failed; the first:\n{first}"))
}
