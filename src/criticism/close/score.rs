//! Errors of predictions by the model before and after.

use serde_json::{Value, json};

use crate::criticism::{Predicted, score_of};
use crate::diagnostics::standard_error;
use crate::report::{ErrorChange, PredictionError};

/// Predictions of the same measurements, and log predictive densities of independent units: rows or sites.
pub(super) struct Scored {
    pub(super) predicted: Vec<Predicted>,
    pub(super) ln: Vec<f64>,
}

impl Scored {
    /// What the model with the effects gains.
    pub(super) fn compared(what: &str, before: &Self, after: Option<&Self>) -> ErrorChange {
        let gains: Vec<f64> = match after {
            Some(after) => after.ln.iter().zip(&before.ln).map(|(a, b)| a - b).collect(),
            None => vec![0.0; before.ln.len()],
        };
        ErrorChange {
            what: what.into(),
            n: before.predicted.len(),
            before: before.errors(),
            after: after.map(Self::errors),
            elpd_gain: [gains.iter().sum(), standard_error(&gains)],
        }
    }

    fn errors(&self) -> PredictionError {
        let score = score_of(&self.predicted);
        let squares: Vec<f64> = self
            .predicted
            .iter()
            .map(|p| (p.value - p.measured).powi(2))
            .filter(|square| square.is_finite())
            .collect();
        // the error of a root by that of its square
        let of_mean = standard_error(&squares) / squares.len() as f64;
        let share = score.coverage90;
        PredictionError {
            rmse: [score.rmse, of_mean / (2.0 * score.rmse)],
            elpd: [self.ln.iter().sum(), standard_error(&self.ln)],
            coverage90: [share, (share * (1.0 - share) / score.n as f64).sqrt()],
        }
    }
}

/// As `finding.json` holds it.
pub(super) fn as_json(c: &ErrorChange) -> Value {
    let after = c.after.unwrap_or(c.before);
    json!({
        "n": c.n,
        "rmse_before": c.before.rmse[0], "rmse_before_se": c.before.rmse[1],
        "rmse_after": after.rmse[0], "rmse_after_se": after.rmse[1],
        "elpd_before": c.before.elpd[0], "elpd_after": after.elpd[0],
        "elpd_gain": c.elpd_gain[0], "elpd_gain_se": c.elpd_gain[1],
        "coverage90_before": c.before.coverage90[0], "coverage90_after": after.coverage90[0],
    })
}
