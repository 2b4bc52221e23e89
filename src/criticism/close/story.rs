//! What a loop came to, as data.

use super::{FoundEffect, HeldOut, LeftOut};
use crate::criticism::{CLAIM, Criticism, Warning};
use crate::model::equations;
use crate::report::ErrorChange;
use crate::run::{Fit, Loaded};

/// What a loop came to.
#[derive(Debug)]
pub struct Story {
    /// The search.
    pub criticism: Criticism,
    /// What was found, as effects of the model after.
    pub effects: Vec<FoundEffect>,
    /// The model as declared, sampled.
    pub before: Told,
    /// The model with what was found, sampled; `None` if nothing was.
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

/// What is told of a fit.
#[derive(Clone, Debug)]
pub struct Told {
    /// Name of the model.
    pub model: &'static str,
    /// The model as equations.
    pub equations: String,
    /// Unit of what its first `observe` measures, empty if none is declared.
    pub unit: String,
    /// Whether every diagnostic is fine.
    pub converged: bool,
}

impl Told {
    pub(super) fn of(fit: &Fit<'_>) -> Self {
        let model = fit.model();
        let tree = model.syntax().ok();
        let observe = tree.as_ref().and_then(|tree| tree.observes().next());
        let unit = observe.and_then(|observe| observe.unit.as_ref());
        Self {
            model: model.name,
            equations: equations(model),
            unit: unit.map_or_else(String::new, |unit| unit.text.clone()),
            converged: fit.converged(),
        }
    }
}

impl Story {
    /// Whether every diagnostic of both fits is fine.
    pub fn converged(&self) -> bool {
        self.before.converged && self.after.as_ref().is_none_or(|after| after.converged)
    }

    /// Share and sd of outliers, if these were found.
    pub fn outliers(&self) -> Option<(f64, f64)> {
        self.criticism.last.outer.outliers
    }

    /// The errors that count, first: those of held-out measurements, else of what was left out as a whole.
    pub fn comparisons(&self) -> Vec<ErrorChange> {
        let held_out = self.held_out.as_ref().and_then(HeldOut::comparison);
        let left = self.left_units.iter().chain([&self.left]);
        held_out.into_iter().chain(left.map(|left| left.comparison(&self.criticism))).collect()
    }

    /// What may differ by more than the model with its findings says, and the log Bayes factor of that.
    pub fn differences(&self) -> Vec<(String, f64)> {
        let units = self.criticism.unit_log_bf.iter();
        let units = units.map(|(name, bf)| (format!("Units of `{name}`"), *bf));
        [("Sites".to_owned(), self.criticism.site_log_bf)].into_iter().chain(units).collect()
    }

    /// Those that do differ.
    pub(super) fn unexplained(&self) -> impl Iterator<Item = (String, f64)> {
        self.differences().into_iter().filter(|(_, log_bf)| *log_bf > CLAIM)
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
