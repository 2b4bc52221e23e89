//! `eplat run MODEL.rs --laplace`: draws from the normal approximation at the mode, and how good it is.

use std::time::Instant;

use super::optimise::climb;
use super::output::Sampled;
use crate::diagnostics::importance;
use crate::error::Failure;
use crate::infer::{InferError, Laplace, LaplaceDraws, Settings};
use crate::model::Model;
use crate::report::Approximation;

/// Draws as many chains as the settings say, corrected by their importance weights where these can be
/// relied on; else as they are, to be looked at.
pub(super) fn approximate(model: &Model, settings: &Settings) -> Result<Sampled, Failure> {
    let begun = Instant::now();
    let optimum = climb(model)?;
    let laplace = Laplace::at(model, &optimum).map_err(|error| named(model, error))?;
    eprintln!("model  {}: normal approximation at its mode, not sampled", model.name);
    let drawn = laplace.draws(model, settings)?;
    let log_ratios: Vec<f64> = drawn.iter().flat_map(|d| d.log_ratios.clone()).collect();
    let importance = importance(&log_ratios);
    let quality = Approximation::new(&importance);
    let chains = if quality.is_reliable() {
        LaplaceDraws::resample(&drawn, &importance.weights)
    } else {
        drawn.into_iter().map(|d| d.chain).collect()
    };
    let (seconds, laplace) = (begun.elapsed().as_secs_f64(), Some(quality));
    Ok(Sampled { chains, seconds, laplace, ..Sampled::default() })
}

/// The error with the unknown's name in place of its number.
fn named(model: &Model, error: InferError) -> Failure {
    match error {
        InferError::NotConcave { unknown, .. } => {
            let (number, name) = (format!("unknown {unknown}"), &model.unknown_names()[unknown]);
            Failure::new(error.to_string().replace(&number, name))
        }
        error => error.into(),
    }
}
