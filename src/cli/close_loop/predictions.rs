//! Predictions of what a fit has not seen: held-out rows, and each site from the others.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::Sampling;
use crate::criticism::{
    Left, Outcome, Predicted, Warning, check_heldout, leave_sites_out, leave_units_out,
    predict_rows, score_of, with_heldout,
};
use crate::diagnostics::standard_error;
use crate::error::Failure;
use crate::infer::Chain;
use crate::model::{Declare, Model};
use crate::report::{Comparison, PredictionError};
use crate::run::Loaded;
use crate::table::Measurements;

/// Most draws that predictions are averaged over.
const PREDICTION_DRAWS: usize = 1000;

/// At most [`PREDICTION_DRAWS`] draws, evenly from all chains.
pub(super) fn thinned(chains: &[Chain]) -> Vec<&[f64]> {
    let n: usize = chains.iter().map(Chain::n_draws).sum();
    let every = n.div_ceil(PREDICTION_DRAWS).max(1);
    let all = chains.iter().flat_map(|chain| (0..chain.n_draws()).map(|i| chain.draw(i)));
    all.step_by(every).collect()
}

/// The rows of the table, then those held out.
pub(super) struct Joint {
    table: Measurements,
    heldout: Measurements,
    /// Row of `table` of the first held-out row.
    first: usize,
}

impl Joint {
    /// # Errors
    /// What does not fit between `model` and the held-out rows.
    pub(super) fn new(
        model: &dyn Declare,
        inputs: &Loaded,
        heldout: Measurements,
        scale: f64,
    ) -> Result<Self, Failure> {
        let outline = Model::outline(model)?;
        heldout.check_protocols(&outline.readers())?;
        let mut heldout = heldout;
        let on = inputs.domain.as_ref().map(|domain| (&domain.surface, &domain.basis));
        if let Some((surface, basis)) = on {
            heldout.place_on(surface, scale)?; // its errors name its own lines
            heldout.probe(surface, basis)?;
        }
        let basis = inputs.basis();
        let fitted = Model::new(model, basis, &inputs.measurements)?;
        let own: Vec<&str> =
            fitted.observes.iter().flat_map(|o| o.cells.iter().map(String::as_str)).collect();
        let mut table = with_heldout(&inputs.measurements, &heldout, &own);
        if let Some((surface, basis)) = on {
            table.place_on(surface, scale)?;
            table.probe(surface, basis)?;
        }
        Model::new(model, basis, &table)?;
        Ok(Self { table, heldout, first: inputs.measurements.len() })
    }
}

/// Predictions of held-out rows.
pub(super) struct Heldout {
    before: Vec<Predicted>,
    after: Option<Vec<Predicted>>,
    /// Row of the joint table of the first held-out row.
    first: usize,
    is_measured: Vec<bool>,
    /// Site and protocol.
    names: Vec<[String; 2]>,
    /// Columns that are not in the held-out table.
    pub(super) missing: Vec<String>,
    /// Doubts about its other columns.
    pub(super) doubts: Vec<Warning>,
}

impl Heldout {
    /// By the model as `declared` and with what was found.
    pub(super) fn predict(
        joint: &Joint,
        declared: [&dyn Declare; 2],
        inputs: &Loaded,
        before: &Sampling<'_>,
        after: Option<&Sampling<'_>>,
        outcome: &Outcome,
        seed: u64,
    ) -> Result<Self, Failure> {
        let Joint { table, heldout, first } = joint;
        let basis = inputs.basis();
        let predict =
            |declared: &dyn Declare, fit: &Sampling<'_>| -> Result<Vec<Predicted>, Failure> {
                let all = Model::new(declared, basis, table)?;
                Ok(predict_rows(&all, fit.fit.model(), &thinned(fit.fit.chains()), *first, seed))
            };
        let cell = |row: usize, name: &str| heldout.cell(row, name).unwrap_or_default().to_owned();
        let is_measured =
            |row: usize| before.fit.model().observes.iter().any(|o| o.is_measured(heldout, row));
        let rows = || 0..heldout.len();
        let trained = inputs.measurements.columns().iter();
        let mut columns: Vec<&str> =
            outcome.candidates.iter().filter_map(|c| c.form.as_ref()?.column()).collect();
        columns.dedup();
        Ok(Self {
            before: predict(declared[0], before)?,
            after: after.map(|fit| predict(declared[1], fit)).transpose()?,
            first: *first,
            is_measured: rows().map(is_measured).collect(),
            names: rows().map(|row| [cell(row, "site"), cell(row, "protocol")]).collect(),
            missing: trained.filter(|c| !heldout.has(c)).cloned().collect(),
            doubts: check_heldout(&inputs.measurements, heldout, &columns),
        })
    }

    pub(super) fn csv(&self) -> String {
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
    pub(super) fn comparison(&self) -> Option<Comparison> {
        let measured = |all: &[Predicted]| -> Vec<Predicted> {
            all.iter().filter(|p| self.is_measured[p.table_row - self.first]).cloned().collect()
        };
        let before = measured(&self.before);
        if before.is_empty() {
            return None;
        }
        let after = self.after.as_deref().map(measured);
        let ln = |all: &[Predicted]| all.iter().map(|p| p.ln_density).collect();
        let lns = (ln(&before), after.as_deref().map(ln));
        Some(compare("held-out measurements", &before, after.as_deref(), lns))
    }
}

/// Predictions of what was left out from the rest, before and, if anything was found, after.
pub(super) struct LeftOut {
    /// What was left out as a whole: `site`, or a column.
    pub(super) unit: String,
    before: Left,
    after: Option<Left>,
}

/// Predictions of each of the outcome's units from the others, by the first and the last fit of a search;
/// `None` where the site is the unit, and where a fit without one of them fails.
pub(super) fn leave_units_out_twice(outcome: &Outcome, seed: u64) -> Option<LeftOut> {
    let unit = outcome.unit.as_ref()?;
    let left = |fit| leave_units_out(&outcome.engine, fit, unit, seed);
    let before = left(&outcome.rounds[0].base)?;
    let after = if outcome.found.is_empty() { None } else { Some(left(&outcome.last)?) };
    Some(LeftOut { unit: unit.name.clone(), before, after })
}

/// Leave-one-site-out predictions by the first and the last fit of a search.
pub(super) fn leave_sites_out_twice(outcome: &Outcome, seed: u64) -> LeftOut {
    let is_found = !outcome.found.is_empty();
    LeftOut {
        unit: "site".into(),
        before: outcome.rounds[0].left.clone(),
        after: is_found.then(|| leave_sites_out(&outcome.engine, &outcome.last, seed)),
    }
}

/// What was measured in a row of the engine: its cell, or the middle of its bracket; NaN if that is open.
fn measured(outcome: &Outcome, row: usize) -> f64 {
    let id = outcome.engine.rows[row].id;
    let cells = outcome.engine.model.observes[id.observe].observed_row(id.row);
    let middle = cells.iter().sum::<f64>() / cells.len() as f64;
    if middle.is_finite() { middle } else { f64::NAN }
}

impl LeftOut {
    /// Residual of each row of the engine before and after (NaN if nothing was found).
    pub(super) fn residuals(&self, outcome: &Outcome) -> Vec<[f64; 2]> {
        let one = |row: usize| {
            let after = self.after.as_ref().map_or(f64::NAN, |left| left.predicted[row]);
            [self.before.predicted[row], after].map(|predicted| measured(outcome, row) - predicted)
        };
        (0..outcome.engine.rows.len()).map(one).collect()
    }

    pub(super) fn comparison(&self, outcome: &Outcome) -> Comparison {
        let rows = |left: &Left| -> Vec<Predicted> {
            let one = |row: usize| Predicted {
                table_row: outcome.engine.model.table_row(outcome.engine.rows[row].id),
                value: left.predicted[row],
                measured: measured(outcome, row),
                ln_density: f64::NAN, // known for sites, not for rows
                quantile: 0.5 * libm::erfc(-left.residual[row] * std::f64::consts::FRAC_1_SQRT_2),
            };
            (0..outcome.engine.rows.len()).map(one).collect()
        };
        let after = self.after.as_ref().map(rows);
        let lns = (self.before.elpd.clone(), self.after.as_ref().map(|left| left.elpd.clone()));
        let what = format!("measurements, each {} predicted from the others", self.unit);
        compare(&what, &rows(&self.before), after.as_deref(), lns)
    }
}

/// `lns` are log predictive densities of independent units: rows or sites.
fn compare(
    what: &str,
    before: &[Predicted],
    after: Option<&[Predicted]>,
    lns: (Vec<f64>, Option<Vec<f64>>),
) -> Comparison {
    let (ln_before, ln_after) = lns;
    let gains: Vec<f64> = match &ln_after {
        Some(after) => after.iter().zip(&ln_before).map(|(a, b)| a - b).collect(),
        None => vec![0.0; ln_before.len()],
    };
    Comparison {
        what: what.into(),
        n: before.len(),
        before: errors(before, &ln_before),
        after: after.zip(ln_after).map(|(after, ln)| errors(after, &ln)),
        elpd_gain: [gains.iter().sum(), standard_error(&gains)],
    }
}

fn errors(predicted: &[Predicted], ln: &[f64]) -> PredictionError {
    let score = score_of(predicted);
    let squares: Vec<f64> = predicted
        .iter()
        .map(|p| (p.value - p.measured).powi(2))
        .filter(|square| square.is_finite())
        .collect();
    // the error of a root by that of its square
    let of_mean = standard_error(&squares) / squares.len() as f64;
    let share = score.coverage90;
    PredictionError {
        rmse: [score.rmse, of_mean / (2.0 * score.rmse)],
        elpd: [ln.iter().sum(), standard_error(ln)],
        coverage90: [share, (share * (1.0 - share) / score.n as f64).sqrt()],
    }
}

/// As `finding.json` holds it.
pub(super) fn as_json(c: &Comparison) -> Value {
    let after = c.after.unwrap_or(c.before);
    json!({
        "n": c.n,
        "rmse_before": c.before.rmse[0], "rmse_before_se": c.before.rmse[1],
        "rmse_after": after.rmse[0], "rmse_after_se": after.rmse[1],
        "elpd_before": c.before.elpd[0], "elpd_after": after.elpd[0],
        "elpd_gain": c.elpd_gain[0], "elpd_gain_se": c.elpd_gain[1],
        "coverage90_before": c.before.coverage90[0], "coverage90_after": after.coverage90[0],
    })
}
