//! Predictions of what was left out from the rest, by the Laplace fits of a search.

use super::score::Scored;
use crate::criticism::{Criticism, Left, Predicted, leave_sites_out, leave_units_out};
use crate::report::ErrorChange;

/// Predictions of what was left out from the rest, before and, if anything was found, after.
#[derive(Clone, Debug)]
pub struct LeftOut {
    /// What was left out as a whole: `site`, or a column.
    pub unit: String,
    /// By the model as declared.
    pub before: Left,
    /// By the model with what was found.
    pub after: Option<Left>,
}

impl LeftOut {
    /// Leave-one-site-out predictions by the first and the last fit of a search.
    pub(super) fn sites(criticism: &Criticism, seed: u64) -> Self {
        let is_found = !criticism.found().is_empty();
        let after = || leave_sites_out(&criticism.engine, &criticism.last, seed);
        Self {
            unit: "site".into(),
            before: criticism.rounds[0].left.clone(),
            after: is_found.then(after),
        }
    }

    /// Predictions of each of the search's units from the others, by its first and its last fit; `None` where
    /// the site is the unit, and where a fit without one of them fails.
    pub(super) fn units(criticism: &Criticism, seed: u64) -> Option<Self> {
        let unit = criticism.unit.as_ref()?;
        let left = |fit| leave_units_out(&criticism.engine, fit, unit, seed);
        let before = left(criticism.first())?;
        let is_found = !criticism.found().is_empty();
        let after = if is_found { Some(left(&criticism.last)?) } else { None };
        Some(Self { unit: unit.name.clone(), before, after })
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

    /// Errors before and after.
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
        let what = format!("measurements, each {} predicted from the others", self.unit);
        Scored::compared(&what, &scored(&self.before), self.after.as_ref().map(scored).as_ref())
    }
}
