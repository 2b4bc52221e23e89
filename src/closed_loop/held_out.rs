//! Predictions of rows that played no part in the search, from the draws of the fits.

use std::collections::BTreeMap;

use super::LoopError;
use super::score::{Scored, Scores};
use crate::criticism::site_name;
use crate::criticism::{
    Candidate, Criticism, Predicted, Predictions, Warning, check_heldout, predict_rows,
    with_heldout,
};
use crate::model::{Declare, Model};
use crate::report::ErrorChange;
use crate::run::{Fit, Loaded};
use crate::table::{Measurements, PROTOCOL, SITE, csv_line};

/// Most draws that predictions are averaged over.
pub(super) const PREDICTION_DRAWS: usize = 1000;

/// The rows of the table, then those held out.
pub(super) struct Joint {
    table: Measurements,
    held_out: Measurements,
    /// Row of `table` of the first held-out row.
    first: usize,
}

impl Joint {
    /// # Errors
    /// What does not fit between `declared` and the held-out rows.
    pub(super) fn new(
        declared: &dyn Declare,
        loaded: &Loaded,
        mut held_out: Measurements,
    ) -> Result<Self, LoopError> {
        let outline = Model::outline(declared)?;
        held_out.drop_unread(&outline.readers());
        held_out.check_protocols(&outline.readers())?;
        let place = |table: &mut Measurements| -> Result<(), LoopError> {
            let Some(domain) = &loaded.domain else { return Ok(()) };
            table.place_on(&domain.surface, domain.scale)?;
            Ok(table.probe(&domain.surface, &domain.basis)?)
        };
        place(&mut held_out)?; // its errors name its own lines
        let fitted = Model::new(declared, loaded.basis(), &loaded.measurements)?;
        let own: Vec<&str> =
            fitted.observes.iter().flat_map(|o| o.cells.iter().map(String::as_str)).collect();
        let mut table = with_heldout(&loaded.measurements, &held_out, &own);
        place(&mut table)?;
        Model::new(declared, loaded.basis(), &table)?;
        Ok(Self { table, held_out, first: loaded.measurements.len() })
    }

    /// The table that is held out.
    pub(super) fn held_out(&self) -> &Measurements {
        &self.held_out
    }

    /// Predictions of the held-out rows by a fit.
    pub(super) fn predict(
        &self,
        loaded: &Loaded,
        fit: &Fit<'_>,
        seed: u64,
    ) -> Result<Predictions, LoopError> {
        let mut all = Model::new(fit.problem().declared(), loaded.basis(), &self.table)?;
        all.correct_as(fit.model())?;
        Ok(predict_rows(&all, fit.model(), &fit.thinned(PREDICTION_DRAWS)?, self.first, seed))
    }

    /// A record with predictions by the model as written, before there are further ones.
    pub(super) fn told(
        &self,
        loaded: &Loaded,
        criticism: &Criticism,
        declared: Predictions,
        fit: &Fit<'_>,
    ) -> HeldOut {
        let Self { held_out, first, .. } = self;
        let cell = |row: usize, name: &str| held_out.cell(row, name).unwrap_or_default().to_owned();
        let is_measured =
            |row: usize| fit.model().observes.iter().any(|o| o.is_measured(held_out, row));
        let rows = || 0..held_out.len();
        let trained = loaded.measurements.columns().iter();
        let mut columns: Vec<&str> =
            criticism.candidates.iter().filter_map(Candidate::column).collect();
        columns.dedup();
        HeldOut {
            declared,
            before: None,
            after: None,
            first: *first,
            is_measured: rows().map(is_measured).collect(),
            names: rows().map(|row| [cell(row, SITE), cell(row, PROTOCOL)]).collect(),
            sites: rows().map(|row| site_name(held_out, row)).collect(),
            missing: trained.filter(|c| !held_out.has(c)).cloned().collect(),
            doubts: check_heldout(&loaded.measurements, held_out, &columns),
        }
    }
}

/// Predictions of held-out rows.
#[derive(Clone, Debug)]
pub struct HeldOut {
    declared: Predictions,
    /// Predictions by the model before, if that is not the model as written.
    pub(super) before: Option<Predictions>,
    pub(super) after: Option<Predictions>,
    /// Row of the joint table of the first held-out row.
    first: usize,
    is_measured: Vec<bool>,
    /// Site and protocol.
    names: Vec<[String; 2]>,
    /// The site of each row, in words.
    sites: Vec<String>,
    /// Columns that are not in the held-out table.
    pub missing: Vec<String>,
    /// Doubts about its other columns.
    pub doubts: Vec<Warning>,
}

impl HeldOut {
    fn before(&self) -> &Predictions {
        self.before.as_ref().unwrap_or(&self.declared)
    }

    /// `heldout_predictions.csv`: site, protocol, and the predicted values before and after.
    pub fn csv(&self) -> String {
        let mut lines: BTreeMap<usize, [String; 4]> = BTreeMap::new();
        let (before, after) = (self.before(), self.after.as_ref().unwrap_or(self.before()));
        for (b, a) in before.rows.iter().zip(&after.rows) {
            let row = b.table_row - self.first;
            let [site, protocol] = self.names[row].clone();
            let [before, after] = [b.value, a.value].map(|value| format!("{value:.4}"));
            lines.insert(row, [site, protocol, before, after]);
        }
        let header = csv_line(["site", "protocol", "before", "after"]);
        let line = |cells: [String; 4]| csv_line(cells.iter().map(String::as_str));
        lines.into_values().map(line).fold(header, |csv, line| csv + &line)
    }

    /// Errors as written, before and after; `None` unless there is something measured.
    pub fn comparison(&self) -> Option<ErrorChange> {
        let is_measured = |p: &Predicted| self.is_measured[p.table_row - self.first];
        let mut sites: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (i, p) in self.declared.rows.iter().enumerate().filter(|(_, p)| is_measured(p)) {
            sites.entry(&self.sites[p.table_row - self.first]).or_default().push(i);
        }
        let names: Vec<String> = sites.keys().map(ToString::to_string).collect();
        let sets: Vec<Vec<usize>> = sites.into_values().collect();
        let scored = |all: &Predictions| Scored {
            predicted: all.rows.iter().filter(|p| is_measured(p)).cloned().collect(),
            ln: all.joint(&sets),
        };
        let scores = Scores {
            what: "held-out measurements".into(),
            units: &names,
            declared: self.before.as_ref().map(|_| scored(&self.declared)),
            before: scored(self.before()),
            after: self.after.as_ref().map(scored),
        };
        (!names.is_empty()).then(|| scores.compared())
    }
}
