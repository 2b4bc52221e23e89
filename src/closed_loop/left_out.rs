//! Predictions of what was left out from the rest, by the Laplace fits of a search.

use super::score::{Scored, Scores};
use crate::criticism::{
    Criticism, LaplaceFit, Left, Outer, Predicted, Unit, leave_sites_out, leave_units_out,
};
use crate::diagnostics::quantile;
use crate::report::ErrorChange;
use crate::run::{Fit, RunError};

/// Further error of a measurement in the approximation of the model as written, in protocol steps.
/// Without it a bracket would be a box without curvature.
const LEAST_ERROR: f64 = 0.1;
/// Number of draws whose median gives the hyperparameters of the model as written.
const DRAWS: usize = 400;

/// Predictions of what was left out from the rest: by the model as written, by the model before
/// and, if anything was found, by the model after.
#[derive(Clone, Debug)]
pub struct LeftOut {
    /// What was left out as a whole: `site`, or a column.
    pub unit: String,
    /// Names of what was left out.
    pub names: Vec<String>,
    /// By the model as written; `None` if it has no such approximation.
    pub declared: Option<Left>,
    /// By the model before: with the differences of the search's base fit.
    pub before: Left,
    /// By the model with what was found.
    pub after: Option<Left>,
}

/// The Laplace approximation of the model as written, at the median of its draws of
/// hyperparameters.
pub(super) fn as_written(
    criticism: &Criticism,
    fit: &Fit<'_>,
) -> Result<Option<LaplaceFit>, RunError> {
    let engine = &criticism.engine;
    let draws = fit.thinned(DRAWS)?;
    let median = |unknown: &usize| {
        let mut values: Vec<f64> = draws.iter().map(|draw| draw[*unknown]).collect();
        values.sort_by(f64::total_cmp);
        quantile(&values, 0.5)
    };
    let outer = Outer {
        other: engine.split.other.iter().map(median).collect(),
        ln_site: f64::NEG_INFINITY,
        ln_noise: (LEAST_ERROR * criticism.step).ln(),
        ln_unit: None,
        outliers: None,
        scatter: vec![],
    };
    Ok(engine.fit(&outer, &[], None))
}

impl LeftOut {
    /// Leave-one-site-out predictions by the model `as_written`, and the first and the last fit of a search.
    pub(super) fn sites(
        criticism: &Criticism,
        as_written: Option<&LaplaceFit>,
        names: Vec<String>,
        seed: u64,
    ) -> Self {
        let is_found = !criticism.found().is_empty();
        let left = |fit: &LaplaceFit| leave_sites_out(&criticism.engine, fit, seed);
        Self {
            unit: "site".into(),
            names,
            declared: as_written.map(left),
            before: criticism.rounds[0].left.clone(),
            after: is_found.then(|| left(&criticism.last)),
        }
    }

    /// Predictions of each of the search's units from the others, by the same fits. `None` if the
    /// site is the unit, or if a fit without one of the units fails.
    pub(super) fn units(
        criticism: &Criticism,
        as_written: Option<&LaplaceFit>,
        seed: u64,
    ) -> Option<Self> {
        let unit = criticism.unit.as_ref()?;
        let left = |fit: &LaplaceFit| leave_units_out(&criticism.engine, fit, unit, seed);
        let before = left(criticism.first())?;
        let is_found = !criticism.found().is_empty();
        let after = if is_found { Some(left(&criticism.last)?) } else { None };
        let names = folds(unit, before.elpd.len());
        let declared = as_written.and_then(left);
        Some(Self { unit: unit.name.clone(), names, declared, before, after })
    }

    /// To be called where the model before is the model as written. If nothing was found, the
    /// predictions before are then those of the model as written. If something was found, both are
    /// those of the search.
    pub(super) fn as_written_only(&mut self) {
        if let (Some(declared), None) = (self.declared.take(), &self.after) {
            self.before = declared;
        }
    }

    /// Residual of each row of the search's engine before and after (NaN if nothing was found).
    pub fn residuals(&self, criticism: &Criticism) -> Vec<[f64; 2]> {
        let one = |row: usize| {
            let after = self.after.as_ref().map_or(f64::NAN, |left| left.predicted[row]);
            [self.before.predicted[row], after]
                .map(|predicted| criticism.engine.middle(row) - predicted)
        };
        (0..criticism.engine.rows.len()).map(one).collect()
    }

    /// Errors as written, before and after.
    pub fn comparison(&self, criticism: &Criticism) -> ErrorChange {
        let engine = &criticism.engine;
        let scored = |left: &Left| {
            let one = |row: usize| Predicted {
                table_row: engine.table_row(row),
                value: left.predicted[row],
                measured: engine.middle(row),
                ln_density: f64::NAN, // known for sites, not for rows
                quantile: 0.5 * libm::erfc(-left.residual[row] * std::f64::consts::FRAC_1_SQRT_2),
            };
            Scored { predicted: (0..engine.rows.len()).map(one).collect(), ln: left.elpd.clone() }
        };
        Scores {
            what: format!("measurements, each {} predicted from the others", self.unit),
            units: &self.names,
            declared: self.declared.as_ref().map(scored),
            before: scored(&self.before),
            after: self.after.as_ref().map(scored),
        }
        .compared()
    }
}

/// What each fold of a unit leaves out.
fn folds(unit: &Unit, n: usize) -> Vec<String> {
    let name = |fold: usize| format!("{} {}", unit.name, fold + 1);
    let several = |fold: usize| format!("{}s {} and every {n}th after it", unit.name, fold + 1);
    (0..n).map(|fold| if n == unit.n { name(fold) } else { several(fold) }).collect()
}
