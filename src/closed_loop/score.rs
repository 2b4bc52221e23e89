//! Errors of predictions by the model as written, before and after.

use serde_json::{Value, json};

use crate::criticism::{Predicted, score_of};
use crate::diagnostics::standard_error;
use crate::report::{ErrorChange, MostOfTheGain, PredictionError};

/// Predictions of the same measurements, and log predictive densities of independent units, such as sites.
pub(super) struct Scored {
    pub(super) predicted: Vec<Predicted>,
    pub(super) ln: Vec<f64>,
}

/// The same predictions by several models.
pub(super) struct Scores<'a> {
    /// What was predicted.
    pub(super) what: String,
    /// Names of the units that have a log predictive density each.
    pub(super) units: &'a [String],
    /// By the model as written. `None` if that is the model before.
    pub(super) declared: Option<Scored>,
    pub(super) before: Scored,
    pub(super) after: Option<Scored>,
}

impl Scores<'_> {
    /// What the model with the effects gains.
    pub(super) fn compared(self) -> ErrorChange {
        let Self { what, units, declared, before, after } = self;
        let gains: Vec<f64> = match &after {
            Some(after) => after.ln.iter().zip(&before.ln).map(|(a, b)| a - b).collect(),
            None => vec![0.0; before.ln.len()],
        };
        ErrorChange {
            what,
            n: before.predicted.len(),
            n_units: gains.len(),
            declared: declared.as_ref().map(Scored::errors),
            before: before.errors(),
            after: after.as_ref().map(Scored::errors),
            elpd_gain: total(&gains),
            most: most_of(&gains, units),
        }
    }
}

/// A sum and its standard error.
fn total(x: &[f64]) -> [f64; 2] {
    [x.iter().sum(), standard_error(x)]
}

/// The unit that alone makes more than half of a gain, if there is one.
fn most_of(gains: &[f64], units: &[String]) -> Option<MostOfTheGain> {
    let all: f64 = gains.iter().sum();
    let (unit, most) = gains.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let others = || gains.iter().enumerate().filter(|(i, _)| *i != unit).map(|(_, gain)| *gain);
    (most > 0.5 * all.max(0.0) && most > 0.0 && gains.len() > 2).then(|| MostOfTheGain {
        unit: units.get(unit).cloned().unwrap_or_default(),
        without: total(&others().collect::<Vec<f64>>()),
    })
}

impl Scored {
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
            elpd: total(&self.ln),
            coverage90: [share, (share * (1.0 - share) / score.n as f64).sqrt()],
        }
    }
}

/// As `finding.json` holds it.
pub(super) fn as_json(c: &ErrorChange) -> Value {
    let after = c.after.unwrap_or(c.before);
    let declared = c.declared.unwrap_or(c.before);
    let most = c.most.as_ref().map(|most| {
        json!({ "unit": most.unit, "gain_without": most.without[0], "gain_without_se": most.without[1] })
    });
    json!({
        "n": c.n, "units": c.n_units,
        "rmse_declared": declared.rmse[0], "elpd_declared": declared.elpd[0],
        "coverage90_declared": declared.coverage90[0],
        "rmse_before": c.before.rmse[0], "rmse_before_se": c.before.rmse[1],
        "rmse_after": after.rmse[0], "rmse_after_se": after.rmse[1],
        "elpd_before": c.before.elpd[0], "elpd_after": after.elpd[0],
        "elpd_gain": c.elpd_gain[0], "elpd_gain_se": c.elpd_gain[1],
        "more_than_half_of_the_gain": most,
        "coverage90_before": c.before.coverage90[0], "coverage90_after": after.coverage90[0],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_site_that_makes_most_of_a_gain_is_named() {
        let units: Vec<String> = ["A", "B", "C", "D"].map(String::from).to_vec();
        let most = most_of(&[1.0, 7000.0, 2.0, 1.5], &units).unwrap();
        assert_eq!((most.unit.as_str(), most.without[0]), ("B", 4.5));
        assert!(most_of(&[1.0, 2.0, 2.0, 1.5], &units).is_none());
        assert!(most_of(&[-1.0, -2.0, -2.0, -1.5], &units).is_none());
        // what the others lose
        assert!(most_of(&[-1.0, 2.0, -0.5, -0.2], &units).is_some());
    }
}
