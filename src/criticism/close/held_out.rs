//! Predictions of rows that played no part in the search, from the draws of both fits.

use std::collections::BTreeMap;

use super::LoopError;
use super::score::Scored;
use crate::criticism::{
    Candidate, Criticism, Predicted, Warning, check_heldout, predict_rows, with_heldout,
};
use crate::model::{Declare, Model};
use crate::report::ErrorChange;
use crate::run::{Fit, Loaded};
use crate::table::{Measurements, PROTOCOL, SITE};

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

    /// Predictions of the held-out rows by both fits.
    pub(super) fn predict(
        &self,
        loaded: &Loaded,
        criticism: &Criticism,
        before: &Fit<'_>,
        after: Option<&Fit<'_>>,
        seed: u64,
    ) -> Result<HeldOut, LoopError> {
        let Self { table, held_out, first } = self;
        let predict = |fit: &Fit<'_>| -> Result<Vec<Predicted>, LoopError> {
            let all = Model::new(fit.problem().declared(), loaded.basis(), table)?;
            Ok(predict_rows(&all, fit.model(), &fit.thinned(PREDICTION_DRAWS), *first, seed))
        };
        let cell = |row: usize, name: &str| held_out.cell(row, name).unwrap_or_default().to_owned();
        let is_measured =
            |row: usize| before.model().observes.iter().any(|o| o.is_measured(held_out, row));
        let rows = || 0..held_out.len();
        let trained = loaded.measurements.columns().iter();
        let mut columns: Vec<&str> =
            criticism.candidates.iter().filter_map(Candidate::column).collect();
        columns.dedup();
        Ok(HeldOut {
            before: predict(before)?,
            after: after.map(predict).transpose()?,
            first: *first,
            is_measured: rows().map(is_measured).collect(),
            names: rows().map(|row| [cell(row, SITE), cell(row, PROTOCOL)]).collect(),
            missing: trained.filter(|c| !held_out.has(c)).cloned().collect(),
            doubts: check_heldout(&loaded.measurements, held_out, &columns),
        })
    }
}

/// Predictions of held-out rows.
#[derive(Clone, Debug)]
pub struct HeldOut {
    before: Vec<Predicted>,
    after: Option<Vec<Predicted>>,
    /// Row of the joint table of the first held-out row.
    first: usize,
    is_measured: Vec<bool>,
    /// Site and protocol.
    names: Vec<[String; 2]>,
    /// Columns that are not in the held-out table.
    pub missing: Vec<String>,
    /// Doubts about its other columns.
    pub doubts: Vec<Warning>,
}

impl HeldOut {
    /// `heldout_predictions.csv`: site, protocol, and the predicted values before and after.
    pub fn csv(&self) -> String {
        let mut lines: BTreeMap<usize, String> = BTreeMap::new();
        let after = self.after.as_ref().unwrap_or(&self.before);
        for (b, a) in self.before.iter().zip(after) {
            let row = b.table_row - self.first;
            let [site, protocol] = &self.names[row];
            lines.insert(row, format!("{site},{protocol},{:.4},{:.4}\n", b.value, a.value));
        }
        let header = "site,protocol,before,after\n".to_owned();
        lines.into_values().fold(header, |csv, line| csv + &line)
    }

    /// Errors before and after; `None` unless there is something measured.
    pub fn comparison(&self) -> Option<ErrorChange> {
        let scored = |all: &Vec<Predicted>| {
            let is_measured = |p: &&Predicted| self.is_measured[p.table_row - self.first];
            let predicted: Vec<Predicted> = all.iter().filter(is_measured).cloned().collect();
            Scored { ln: predicted.iter().map(|p| p.ln_density).collect(), predicted }
        };
        let (before, after) = (scored(&self.before), self.after.as_ref().map(scored));
        (!before.predicted.is_empty())
            .then(|| Scored::compared("held-out measurements", &before, after.as_ref()))
    }
}
