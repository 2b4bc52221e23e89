//! Several chains in parallel.
//!
//! One random stream per chain makes results the same, bit for bit, on any number of threads.

use super::density::LogDensity;
use super::draws::ChainResult;
use super::error::InferError;
use super::moments::DrawMoments;
use super::nuts::Nuts;
use super::progress::Progress;
use super::run::run;
use super::settings::{Settings, check_starts};
use rayon::prelude::*;

/// Samples `density` with one NUTS chain from each of `starts`, each `(dim)`.
///
/// The result has one entry per chain, in order; the failure of one leaves the others alone.
///
/// # Errors
/// Those of [`Settings::validate`]; [`InferError::NoUnknowns`], [`InferError::StartCount`],
/// [`InferError::StartLength`], [`InferError::EarlierLength`] for positions that do not fit;
/// [`InferError::Checkpoint`]; [`InferError::Threads`].
pub fn sample(
    density: &dyn LogDensity,
    starts: &[Vec<f64>],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Vec<ChainResult>, InferError> {
    check_starts(density, starts, settings)?;
    let learnt = DrawMoments::of(density, &settings.earlier, settings.metric);
    settings.on_threads(|| {
        let begin =
            |(i, start): (usize, &Vec<f64>)| Nuts::begin(density, start, settings, i, &learnt);
        run(starts.par_iter().enumerate().map(begin).collect(), settings, progress)
    })?
}

#[cfg(test)]
#[path = "sample_tests.rs"]
mod tests;
