//! How often a right model gets amber or red: the figures of docs/verdict.md.
//!
//! The experiments are those of `eplat run models/erp.rs` with their truths in the ranges of the model,
//! with 5, 10, 20 and 40 sites in turn.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

#[path = "support/shipped.rs"]
mod shipped;

use std::ops::RangeInclusive;

use eplat::diagnostics::verdict::{Colour, Question, Questions, Verdict};
use eplat::run::{DataSource, Design, Inputs, Problem, Settings};
use shipped::shipped;

/// Largest share of right models that may get amber or red.
const MOST_FALSE: f64 = 0.05;
const SITES: [usize; 4] = [5, 10, 20, 40];

fn judged(seed: u64) -> (usize, Verdict, Questions) {
    let n_sites = SITES[(seed % 4) as usize];
    let design = Design { seed, n_sites, ..Design::default() };
    let inputs = Inputs { data: DataSource::Synthetic(design), ..Inputs::default() };
    let problem = Problem::load(shipped("erp"), &inputs).unwrap();
    let fit = problem.fit(&Settings { seed, ..Settings::default() }).unwrap();
    (n_sites, fit.verdict(), fit.questions().clone())
}

fn told(seed: u64, n_sites: usize, verdict: &Verdict, questions: &Questions) -> String {
    let colours = verdict.answers.iter().map(|a| format!("{} {}", a.question, a.colour));
    let colours = colours.collect::<Vec<_>>().join(", ");
    let fits = questions.fits.as_ref().unwrap();
    let least = questions.informed.as_ref().unwrap().fields.iter().map(|f| f.share);
    let beyond = questions.trusted.as_ref().unwrap().worst().unwrap().beyond;
    format!(
        "{seed} {n_sites} p {:.3} impossible {} doubts {} outside {:.3} informed {:.3} uninformed {} beyond {beyond:.3} | {colours}",
        fits.p_value(),
        fits.n_impossible,
        fits.doubts.len(),
        questions.physical.as_ref().unwrap().outside,
        least.fold(1.0, f64::min),
        questions.informed.as_ref().unwrap().uninformed.len(),
    )
}

/// Counts of amber and of red by question.
fn false_alarms(seeds: RangeInclusive<u64>) -> usize {
    let (mut n_false, mut n) = (0, 0);
    let asked = [
        Question::Sampled,
        Question::Fits,
        Question::Physical,
        Question::Informed,
        Question::Trusted,
    ];
    let mut by_question = [0; 5];
    for seed in seeds {
        let (n_sites, verdict, questions) = judged(seed);
        println!("{}", told(seed, n_sites, &verdict, &questions));
        n += 1;
        n_false += usize::from(verdict.colour() > Colour::Green);
        for (count, question) in by_question.iter_mut().zip(asked) {
            let colour = verdict.answer(question).map(|answer| answer.colour);
            *count += usize::from(colour > Some(Colour::Green));
        }
    }
    println!("{n_false} of {n} not green; by question {by_question:?}");
    n_false
}

/// `cargo test --release --test verdict_rates -- --ignored --nocapture`; `EPLAT_SEEDS=1-50` for a part.
#[test]
#[ignore = "200 runs, seven minutes"]
fn a_right_model_is_rarely_amber() {
    let seeds = std::env::var("EPLAT_SEEDS").unwrap_or_else(|_| "1-200".to_owned());
    let (first, last) = seeds.split_once('-').unwrap();
    let seeds: RangeInclusive<u64> = first.parse().unwrap()..=last.parse().unwrap();
    let n = seeds.clone().count() as f64;
    let n_false = false_alarms(seeds);
    assert!(
        n_false as f64 <= MOST_FALSE * n,
        "{n_false} of {n} runs of a right model are not green"
    );
}
