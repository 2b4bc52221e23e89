//! Whether the intervals of the model as written hold what they say.

use crate::report::ErrorChange;

/// The share that 90 % intervals should hold.
const LEVEL: f64 = 0.9;
/// How many standard errors below that share a right model falls once in a hundred times.
const ERRORS: f64 = 2.33;

/// Intervals of the model as written that are too narrow.
#[derive(Clone, Debug, PartialEq)]
pub struct Narrow {
    /// The share of measurements in their 90 % intervals.
    pub share: f64,
    /// How many measurements.
    pub n: usize,
    /// What was predicted.
    pub what: String,
}

impl Narrow {
    /// The intervals of what the model as written predicts, if they are too narrow. The rows of a
    /// site lie in or out together, so the binomial error is that of the number of sites.
    pub(super) fn of(errors: &ErrorChange) -> Option<Self> {
        let share = errors.declared.unwrap_or(errors.before).coverage90[0];
        let error = (LEVEL * (1.0 - LEVEL) / errors.n_units as f64).sqrt();
        (share < LEVEL - ERRORS * error).then(|| Self {
            share,
            n: errors.n,
            what: errors.what.clone(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::PredictionError;

    fn errors(share: f64, n_units: usize) -> ErrorChange {
        let error = |share| PredictionError {
            rmse: [1.0, 0.1],
            elpd: [0.0, 0.1],
            coverage90: [share, 0.1],
        };
        let (what, elpd_gain) = ("held-out measurements".into(), [0.0, 0.0]);
        let [declared, after] = [Some(error(share)), None];
        let before = error(0.9);
        ErrorChange {
            what,
            n: 2 * n_units,
            n_units,
            declared,
            before,
            after,
            elpd_gain,
            most: None,
        }
    }

    #[test]
    fn two_thirds_are_too_few_and_chance_is_allowed_for() {
        assert!(Narrow::of(&errors(0.67, 60)).is_some());
        assert!(Narrow::of(&errors(0.82, 60)).is_none());
        assert!(Narrow::of(&errors(0.67, 8)).is_none());
        assert!(Narrow::of(&errors(1.0, 60)).is_none());
    }
}
