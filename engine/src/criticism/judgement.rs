//! What becomes of a candidate in a round, and why.

use std::fmt;

use super::cause::Cause;
use super::fit::LaplaceFit;
use super::leave::Left;
use crate::model::Form;

/// Least log Bayes factor of a claim.
pub const CLAIM: f64 = 3.0;

/// Least log Bayes factor of sites that are called unexplained. It is larger than that of a claim: no
/// null searches and no sites left out stand behind it. It was chosen where nothing came to at most
/// 4.3 in 77 studies, and sites that differ by 8 ms to at least 7.3 in 36. On fresh studies 4 of 100
/// of nothing are above it, and 40 of 40 in which sites differ (`docs/loop_rates.md`).
pub const UNEXPLAINED: f64 = 2.0 * CLAIM;

/// Least log Bayes factor of a claim in round `number`, counted from 0. It is larger in later
/// rounds for two reasons: each is another chance of a wrong name, and its base is a model that was
/// chosen by the same data.
pub fn least_log_bf(number: usize) -> f64 {
    if number == 0 { CLAIM } else { 2.0 * CLAIM }
}

/// What became of a candidate.
#[derive(Clone, Debug, PartialEq)]
pub enum Judgement {
    /// It is claimed.
    Found,
    /// The screen stopped it, so it was not fitted.
    ScreenedOut,
    /// It explains too little.
    TooLittle {
        /// Its log Bayes factor.
        log_bf: f64,
        /// The log Bayes factor that is asked for.
        least: f64,
    },
    /// The round ended with another candidate, which has more evidence.
    LessEvidence,
    /// Searches on simulated data did as well too often, although nothing is missing there.
    ByChance {
        /// Share of these searches.
        share: f64,
    },
    /// Its column has too few units to confirm an effect.
    TooFewUnits {
        /// Column that names the units.
        unit: String,
        /// How many there are.
        n: usize,
    },
    /// It does not predict what was left out.
    Refuted(Refutation),
    /// Other causes explain as much, so none of them is claimed.
    NotToldApart(Vec<Cause>),
}

/// Why predictions of what was left out speak against a cause.
#[derive(Clone, Debug, PartialEq)]
pub enum Refutation {
    /// Each site is predicted from the others. The log score gains no more than chance would.
    Sites {
        /// Sum over the sites.
        gain: f64,
        /// Its standard error.
        se: f64,
    },
    /// Each unit is predicted from the others. The predictions gain no more than chance would.
    Units {
        /// Column that names the units.
        unit: String,
        /// What the gain is in.
        score: UnitScore,
        /// Sum over the folds.
        gain: f64,
        /// Its standard error.
        se: f64,
    },
    /// The model cannot be fitted with some of these units left out.
    NoFitWithoutUnits {
        /// Column that names the units.
        unit: String,
    },
    /// The model cannot be fitted with an effect on every field.
    NoFitOnEveryField,
    /// A patch does not predict in the form in which it is claimed: on every field with a soft
    /// edge. It was found on one field with a sharp edge.
    OnEveryField(Box<Refutation>),
}

/// What predictions of units are scored by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnitScore {
    /// Log predictive density.
    Log,
    /// Squared error, for folds that the table names itself.
    SquaredError,
}

impl fmt::Display for Judgement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Found => write!(f, "found"),
            Self::ScreenedOut => write!(f, "screened out"),
            Self::TooLittle { log_bf, least } => {
                write!(f, "log Bayes factor {log_bf:.1}, more than {least} is asked")
            }
            Self::LessEvidence => write!(f, "less evidence"),
            Self::ByChance { share } => {
                write!(f, "{:.0} % of searches on simulated data did as well", 100.0 * share)
            }
            Self::TooFewUnits { unit, n } => {
                write!(f, "not confirmable: it varies only over {n} {unit}s")
            }
            Self::Refuted(why) => write!(f, "{why}"),
            Self::NotToldApart(rivals) => {
                let names: Vec<String> = rivals.iter().map(Cause::to_string).collect();
                write!(f, "not told apart from {}", names.join(", "))
            }
        }
    }
}

impl fmt::Display for Refutation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sites { gain, se } => {
                write!(f, "leave-one-site-out gain {gain:.1} is not beyond its error {se:.1}")
            }
            Self::Units { unit, score, gain, se } => write!(
                f,
                "leaving {unit}s out as a whole, the gain in {score} {gain:.1} is not beyond its error {se:.1}"
            ),
            Self::NoFitWithoutUnits { unit } => {
                write!(f, "there is no fit with some {unit}s left out as a whole")
            }
            Self::NoFitOnEveryField => write!(f, "there is no fit with every field"),
            Self::OnEveryField(why) => write!(f, "with a soft edge on every field: {why}"),
        }
    }
}

impl fmt::Display for UnitScore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Log => "log score",
            Self::SquaredError => "squared error",
        })
    }
}

/// What became of a candidate in a round.
#[derive(Clone, Debug)]
pub struct Record {
    /// Number of the candidate.
    pub candidate: usize,
    /// Its form when it was tried.
    pub form: Option<Form>,
    /// p-value of the screen.
    pub p_screen: f64,
    /// Log Bayes factor. −∞ if the screen stopped it.
    pub log_bf: f64,
    /// Share of null searches whose best candidate did as well; `None` in a round without them.
    pub p_null: Option<f64>,
    /// The other cause of the pair, where two causes are found together and neither alone. The
    /// evidence is then that with the other cause in the model, and the share of null searches is
    /// that of the pair.
    pub beside: Option<Cause>,
    /// Why it was or was not taken.
    pub judgement: Judgement,
}

impl Record {
    /// Why it was or was not taken, in words.
    pub fn verdict(&self) -> String {
        let beside = self.beside.as_ref().map(|cause| format!(", with {cause} in the model"));
        format!("{}{}", self.judgement, beside.unwrap_or_default())
    }
}

/// One round of the search.
#[derive(Clone, Debug)]
pub struct Round {
    /// Every candidate, best first.
    pub tried: Vec<Record>,
    /// The two candidates that explain most together, and their log Bayes factor, less the price of
    /// a pair.
    pub pair: Option<([usize; 2], f64)>,
    /// Best log Bayes factor of each null search, ascending.
    pub nulls: Vec<f64>,
    /// The fit that the candidates are compared with.
    pub base: LaplaceFit,
    /// What that fit leaves over.
    pub left: Left,
    /// The effects of the cause that is claimed: candidates, as they are claimed. Empty if none is.
    pub claimed: Vec<usize>,
}

impl Round {
    /// The largest log Bayes factor of a candidate or a pair.
    pub fn best(&self) -> f64 {
        let all = self.tried.iter().map(|record| record.log_bf);
        all.chain(self.pair.map(|(_, log_bf)| log_bf)).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The record of what is claimed.
    pub fn taken(&self) -> Option<&Record> {
        self.tried.iter().find(|record| record.judgement == Judgement::Found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_judgement_says_why() {
        let sites = Refutation::Sites { gain: 1.04, se: 1.66 };
        let said = [
            Judgement::TooLittle { log_bf: 2.34, least: 3.0 }.to_string(),
            Judgement::ByChance { share: 0.15 }.to_string(),
            Judgement::TooFewUnits { unit: "session".into(), n: 3 }.to_string(),
            Judgement::Refuted(Refutation::OnEveryField(Box::new(sites))).to_string(),
            Judgement::NotToldApart(vec![Cause::Column("operator".into()), Cause::Short])
                .to_string(),
        ];
        let expected = [
            "log Bayes factor 2.3, more than 3 is asked",
            "15 % of searches on simulated data did as well",
            "not confirmable: it varies only over 3 sessions",
            "with a soft edge on every field: leave-one-site-out gain 1.0 is not beyond its error 1.7",
            "not told apart from operator, short",
        ];
        assert_eq!(said, expected);
    }
}
