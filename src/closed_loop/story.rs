//! The result of a loop, as data.

use super::{Contribution, FoundEffect, HeldOut, LeftOut, Narrow};
use crate::criticism::{CLAIM, Criticism, FINER, UNEXPLAINED, Warning};
use crate::diagnostics::verdict::{Answer, Colour, Question, Verdict};
use crate::model::{Discrepancy, equations};
use crate::report::ErrorChange;
use crate::run::{Fit, Loaded};

/// What a loop came to.
#[derive(Debug)]
pub struct Story {
    /// The search.
    pub criticism: Criticism,
    /// What was found, as effects of the model after.
    pub effects: Vec<FoundEffect>,
    /// What the first of them adds to predictions.
    pub contribution: Option<Contribution>,
    /// Intervals of the model as written, if they are too narrow.
    pub narrow: Option<Narrow>,
    /// What sites and measurements differ by for reasons that no column tells; empty if that is not needed.
    pub discrepancy: Discrepancy,
    /// How much they do, one line each.
    pub spread: Vec<String>,
    /// The model as written, sampled.
    pub declared: Told,
    /// The model with that discrepancy, sampled; `None` if there is none.
    pub before: Option<Told>,
    /// The model with what was found too, sampled; `None` if nothing was.
    pub after: Option<Told>,
    /// Predictions of held-out rows, if there are any.
    pub held_out: Option<HeldOut>,
    /// Predictions of each site from the others.
    pub left: LeftOut,
    /// Where something other than the site is left out as a whole, the predictions of that.
    pub left_units: Option<LeftOut>,
    /// Surface and measurements.
    pub loaded: Loaded,
}

/// What is reported of a fit.
#[derive(Clone, Debug)]
pub struct Told {
    /// Its folder: `declared`, `before` or `after`.
    pub which: &'static str,
    /// Name of the model.
    pub model: &'static str,
    /// The model as equations.
    pub equations: String,
    /// Unit of what its first `observe` measures, empty if none is declared.
    pub unit: String,
    /// Whether it is worth believing.
    pub verdict: Verdict,
}

/// What speaks against a fit.
#[derive(Clone, Debug)]
pub struct Trouble {
    /// The fit's folder.
    pub which: &'static str,
    /// The question that is not answered green.
    pub answer: Answer,
}

impl Trouble {
    /// In words, for a line.
    pub fn text(&self) -> String {
        let Answer { question, colour, sentence, remedy, .. } = &self.answer;
        let which = match self.which {
            "declared" => "as written",
            which => which,
        };
        let remedy = remedy.as_ref().map_or(String::new(), |remedy| format!(" → {remedy}"));
        format!("{colour}: the model {which}, question {question}: {sentence}{remedy}")
    }
}

impl Told {
    pub(super) fn of(which: &'static str, fit: &Fit<'_>) -> Self {
        let model = fit.model();
        let tree = model.syntax().ok();
        let observe = tree.as_ref().and_then(|tree| tree.observes().next());
        let unit = observe.and_then(|observe| observe.unit.as_ref());
        Self {
            which,
            model: model.name,
            equations: equations(model),
            unit: unit.map_or_else(String::new, |unit| unit.text.clone()),
            verdict: fit.verdict(),
        }
    }
}

impl Story {
    /// The fits. The first is the one that counts.
    pub fn fits(&self) -> impl Iterator<Item = &Told> {
        self.after.iter().chain(&self.before).chain([&self.declared])
    }

    /// Exit code of the program, by the rule of a run. It is 3 if the draws of any fit do not come
    /// from the posterior. It is 4 if another question is answered red for the fit that counts.
    /// Else it is 0.
    pub fn exit_code(&self) -> u8 {
        let first = self.fits().next().map_or(0, |told| told.verdict.exit_code());
        if self.fits().all(|told| told.verdict.converged()) { first } else { 3 }
    }

    /// What speaks against the fits, red first: which model, which question, the figures, what to
    /// do. For the model as written only the sampling counts, because it is the loop's own subject
    /// that this model does not fit.
    pub fn troubles(&self) -> Vec<Trouble> {
        let mut troubles = vec![];
        for told in self.fits() {
            let is_compared = told.which != "declared" || self.before.is_none();
            for answer in told.verdict.answers.iter().filter(|a| a.colour > Colour::Green) {
                if is_compared || answer.question == Question::Sampled {
                    troubles.push(Trouble { which: told.which, answer: answer.clone() });
                }
            }
        }
        troubles.sort_by_key(|trouble| std::cmp::Reverse(trouble.answer.colour));
        troubles
    }

    /// Share and sd of outliers, if these were found.
    pub fn outliers(&self) -> Option<(f64, f64)> {
        self.criticism.last.outer.outliers
    }

    /// The errors that count, which are reported first: those of held-out measurements, else those
    /// of what was left out as a whole.
    pub fn comparisons(&self) -> Vec<ErrorChange> {
        let held_out = self.held_out.as_ref().and_then(HeldOut::comparison);
        let left = self.left_units.iter().chain([&self.left]);
        held_out.into_iter().chain(left.map(|left| left.comparison(&self.criticism))).collect()
    }

    /// What may differ by more than the model with its findings says: the log Bayes factor of that, and whether it is
    /// enough.
    pub fn differences(&self) -> Vec<(String, f64, bool)> {
        let units = self.criticism.unit_log_bf.iter();
        let units = units.map(|(name, bf)| (format!("Units of `{name}`"), *bf, *bf > CLAIM));
        let sites = self.criticism.site_log_bf;
        [("Sites".to_owned(), sites, sites > UNEXPLAINED)].into_iter().chain(units).collect()
    }

    /// Those that do differ.
    pub(super) fn unexplained(&self) -> impl Iterator<Item = (String, f64)> {
        let differ = self.differences().into_iter().filter(|(.., is_enough)| *is_enough);
        differ.map(|(what, log_bf, _)| (what, log_bf))
    }

    /// Detail that the model's fields would follow if they had more modes, in words.
    pub fn short(&self) -> Option<String> {
        let log_bf = self.criticism.finer_log_bf.filter(|log_bf| *log_bf > CLAIM)?;
        Some(format!(
            "fields with {FINER} times as many modes say more (log Bayes factor {log_bf:.1}): raise K in the model"
        ))
    }

    /// What the checks of both tables say.
    pub fn warnings(&self) -> impl Iterator<Item = &Warning> {
        self.criticism.warnings.iter().chain(self.held_out.iter().flat_map(|h| &h.doubts))
    }

    /// Doubts about the tables, in words.
    pub fn doubts(&self) -> Vec<String> {
        let table = &self.loaded.measurements;
        let mut doubts: Vec<String> = self.warnings().map(|warning| warning.text.clone()).collect();
        let mut columns: Vec<&str> =
            self.effects.iter().filter_map(|found| found.effect.form.column()).collect();
        columns.dedup();
        for column in columns {
            if self.held_out.as_ref().is_some_and(|h| h.missing.iter().any(|c| c == column)) {
                doubts.push(format!(
                    "the held-out table has no column {column}: its rows are predicted without the effect"
                ));
            }
            let is_empty = |row: &usize| table.cell(*row, column).unwrap_or_default().is_empty();
            let n = (0..table.len()).filter(is_empty).count();
            if n > 0 {
                doubts.push(format!(
                    "{column} is empty in {n} of {} rows: the effect is 0 there",
                    table.len()
                ));
            }
        }
        doubts
    }
}
