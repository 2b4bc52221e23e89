//! Whether a posterior is worth believing, in words: a sentence for each question of
//! [`diagnostics::verdict`](crate::diagnostics::verdict), and what to do.

mod doubts;
mod fits;
mod sampled;
mod surface;

pub use doubts::{doubted, remedy};
pub(super) use sampled::is_settled;
pub use sampled::{MAX_DIVERGENT, MAX_R_HAT, MIN_E_BFMI, MIN_ESS};

use std::fmt::Write as _;

use super::{Row, RunRecord};
use crate::diagnostics::verdict::{Answer, Colour, Questions, Verdict};

/// Every question that was asked of a run, answered.
pub fn verdict(record: &RunRecord, rows: &[Row]) -> Verdict {
    let Questions { fits, physical, informed, trusted } = &record.questions;
    let others = [
        fits.as_ref().map(fits::answer),
        physical.as_ref().map(surface::physical),
        informed.as_ref().map(surface::informed),
        trusted.as_ref().map(surface::trusted),
    ];
    let mut answers = vec![sampled::answer(record, rows)];
    answers.extend(others.into_iter().flatten());
    if record.settings.sampler == "prior" {
        // what is only looked at is not to be used anyway
        for answer in &mut answers {
            answer.colour = answer.colour.min(Colour::Amber);
        }
    }
    Verdict { answers }
}

/// Whether the draws come from the posterior, whatever they say.
pub fn is_sampled(record: &RunRecord, rows: &[Row]) -> bool {
    sampled::answer(record, rows).colour != Colour::Red
}

/// The verdict as the end of a run says it: a line for each question, and below it what to do.
pub fn verdict_lines(verdict: &Verdict) -> String {
    let mut text = format!("Verdict: {}", verdict.colour());
    for Answer { question, colour, sentence, details, remedy } in &verdict.answers {
        let _ = write!(text, "\n  {question:<9} {colour:<6} {sentence}");
        for detail in details {
            let _ = write!(text, "\n  {:<9} {:<6} · {detail}", "", "");
        }
        if let Some(remedy) = remedy {
            let _ = write!(text, "\n  {:<9} {:<6} → {remedy}", "", "");
        }
    }
    text
}

/// Percent without a digit that nobody needs.
fn percent(share: f64) -> String {
    let x = 100.0 * share;
    if x > 0.0 && x < 9.95 { format!("{x:.1} %") } else { format!("{x:.0} %") }
}

/// `a, b and c`.
fn list(items: &[String]) -> String {
    match items {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// To three digits.
fn rounded(x: f64) -> f64 {
    format!("{x:.2e}").parse().unwrap_or(x)
}
