//! Whether a posterior is worth believing: five questions, each answered green, amber or red.
//!
//! | question | asks |
//! |---|---|
//! | *sampled* | do the draws come from the posterior? |
//! | *fits* | do the measurements look like what the model predicts of them? |
//! | *physical* | do the fields stay inside the ranges that the model declares? |
//! | *informed* | did the measurements change what was believed before? |
//! | *trusted* | how much of the surface is far from every site? |
//!
//! This room has the figures, their thresholds and the colours. It knows nothing of how the figures
//! are computed, nor of how they are put into words. `docs/verdict.md` tells how often a right
//! model gets amber.

mod fits;
mod surface;

pub use fits::{Doubt, Fits, Misfit, Within};
pub use surface::{Informed, Physical, Reach, Share, Trusted};

use std::fmt;

use serde::{Deserialize, Serialize};

/// How a question is answered; the later the worse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Colour {
    /// It holds.
    #[default]
    Green,
    /// To be looked at before the results are used.
    Amber,
    /// The results are not to be used.
    Red,
}

impl fmt::Display for Colour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Green => "green",
            Self::Amber => "amber",
            Self::Red => "red",
        })
    }
}

/// What is asked of a posterior.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Question {
    /// Do the draws come from the posterior?
    Sampled,
    /// Do the measurements look like what the model predicts of them?
    Fits,
    /// Do the fields stay inside their declared ranges?
    Physical,
    /// Did the measurements change what was believed before?
    Informed,
    /// How much of the surface is far from every site?
    Trusted,
}

impl fmt::Display for Question {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Sampled => "sampled",
            Self::Fits => "fits",
            Self::Physical => "physical",
            Self::Informed => "informed",
            Self::Trusted => "trusted",
        })
    }
}

/// The answer to one question.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Answer {
    /// The question.
    pub question: Question,
    /// How it is answered.
    pub colour: Colour,
    /// The figures that decide, in words.
    pub sentence: String,
    /// What stands out, one by one: rows that do not fit, for instance.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub details: Vec<String>,
    /// What to do, unless the answer is green.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

impl Answer {
    /// An answer without details, and with a remedy unless it is green.
    pub fn new(question: Question, colour: Colour, sentence: String, remedy: &str) -> Self {
        let remedy = (colour > Colour::Green).then(|| remedy.to_owned());
        Self { question, colour, sentence, details: vec![], remedy }
    }
}

/// Whether a posterior is worth believing.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Verdict {
    /// *Sampled* first, then the other questions that can be asked of the model.
    pub answers: Vec<Answer>,
}

impl Verdict {
    /// The worst of the answers.
    pub fn colour(&self) -> Colour {
        self.answers.iter().map(|answer| answer.colour).max().unwrap_or_default()
    }

    /// Whether the draws come from the posterior, whether or not that posterior is worth believing.
    pub fn converged(&self) -> bool {
        let sampled = self.answer(Question::Sampled);
        sampled.is_none_or(|answer| answer.colour != Colour::Red)
    }

    /// The answer to a question, if it was asked.
    pub fn answer(&self, question: Question) -> Option<&Answer> {
        self.answers.iter().find(|answer| answer.question == question)
    }

    /// Exit code of the program: 3 where the draws do not come from the posterior, 4 where another
    /// question is answered red, else 0.
    pub fn exit_code(&self) -> u8 {
        match (self.converged(), self.colour()) {
            (false, _) => 3,
            (true, Colour::Red) => 4,
            _ => 0,
        }
    }
}

/// The figures behind every question but *sampled*. A question that was not asked has none: it
/// makes no sense for the model, or for how the draws were made.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Questions {
    /// The measurements against their predictive intervals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fits: Option<Fits>,
    /// Fields and derived quantities against their ranges.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub physical: Option<Physical>,
    /// The posterior against the prior.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub informed: Option<Informed>,
    /// The surface against the sites.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trusted: Option<Trusted>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(colours: &[(Question, Colour)]) -> Verdict {
        let answer = |&(question, colour): &(Question, Colour)| {
            Answer::new(question, colour, String::new(), "")
        };
        Verdict { answers: colours.iter().map(answer).collect() }
    }

    #[test]
    fn the_worst_answer_decides_and_only_red_has_an_exit_code() {
        use {Colour::*, Question::*};
        let codes = [
            verdict(&[(Sampled, Green), (Fits, Green)]),
            verdict(&[(Sampled, Green), (Fits, Amber)]),
            verdict(&[(Sampled, Green), (Fits, Red), (Physical, Amber)]),
            verdict(&[(Sampled, Red), (Fits, Red)]),
        ];
        assert_eq!(codes.each_ref().map(Verdict::exit_code), [0, 0, 4, 3]);
        assert_eq!(codes.each_ref().map(Verdict::colour), [Green, Amber, Red, Red]);
        assert_eq!(codes.each_ref().map(Verdict::converged), [true, true, true, false]);
    }
}
