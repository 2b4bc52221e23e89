//! How good a normal approximation at the mode is, for `run.json` and the verdict.

use serde::{Deserialize, Serialize};

use super::run_record::nan_if_null;
use crate::diagnostics::Importance;
use crate::diagnostics::verdict::{Answer, Colour, Question};

/// What the importance weights of a normal approximation's draws say of it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Approximation {
    /// Shape of the weights' tail; null where it cannot be had.
    #[serde(deserialize_with = "nan_if_null")]
    pub pareto_k: f64,
    /// Largest shape at which the approximation can be trusted.
    pub k_threshold: f64,
    /// Number of posterior draws that the weighted draws are worth.
    #[serde(deserialize_with = "nan_if_null")]
    pub ess: f64,
    /// Log of the posterior's normaliser, by importance sampling; a `Flat` prior counts as density 1.
    #[serde(deserialize_with = "nan_if_null")]
    pub ln_evidence: f64,
    /// Its Monte Carlo standard error.
    #[serde(deserialize_with = "nan_if_null")]
    pub ln_evidence_se: f64,
}

impl Approximation {
    /// From the draws' weights.
    pub fn new(importance: &Importance) -> Self {
        let Importance { pareto_k, k_threshold, ess, ln_mean, ln_mean_se, .. } = *importance;
        Self { pareto_k, k_threshold, ess, ln_evidence: ln_mean, ln_evidence_se: ln_mean_se }
    }

    /// Whether the weights correct what the approximation lacks.
    pub fn is_reliable(&self) -> bool {
        self.pareto_k <= self.k_threshold
    }

    /// Whether the approximation can be used, and why; `n_draws` in all.
    pub(super) fn answer(&self, n_draws: usize) -> Answer {
        let Self { pareto_k: k, k_threshold, ess, ln_evidence, ln_evidence_se } = self;
        if self.is_reliable() {
            let sentence = format!(
                "Normal approximation at the mode, corrected by importance resampling: Pareto k {k:.2}, at most {k_threshold:.2}; \
                 its {n_draws} draws are worth {ess:.0}. Log evidence {ln_evidence:.2} ± {ln_evidence_se:.2}"
            );
            return Answer::new(Question::Sampled, Colour::Green, sentence, "");
        }
        let k = if k.is_finite() { format!("{k:.2}") } else { "cannot be had".to_owned() };
        let sentence = format!(
            "Not to be trusted: the posterior is not near the normal approximation at its mode, Pareto k {k} ✗ (at most {k_threshold:.2})"
        );
        let remedy = "do not use these results: sample it (leave out --laplace)";
        Answer::new(Question::Sampled, Colour::Red, sentence, remedy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shape_of_the_weights_decides() {
        let answer = |pareto_k: f64| {
            let approximation = Approximation {
                pareto_k,
                k_threshold: 0.7,
                ess: 3456.7,
                ln_evidence: -12.3456,
                ln_evidence_se: 0.0123,
            };
            approximation.answer(4000)
        };
        let answers = [0.123, 0.712, f64::NAN].map(answer);
        let colours = [Colour::Green, Colour::Red, Colour::Red];
        assert_eq!(answers.each_ref().map(|a| a.colour), colours);
        insta::assert_snapshot!(answers.map(|a| a.sentence).join("\n"), @r"
        Normal approximation at the mode, corrected by importance resampling: Pareto k 0.12, at most 0.70; its 4000 draws are worth 3457. Log evidence -12.35 ± 0.01
        Not to be trusted: the posterior is not near the normal approximation at its mode, Pareto k 0.71 ✗ (at most 0.70)
        Not to be trusted: the posterior is not near the normal approximation at its mode, Pareto k cannot be had ✗ (at most 0.70)
        ");
    }
}
