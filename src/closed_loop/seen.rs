//! How well the models predict what they have not seen, put together fit by fit.

use super::left_out::as_written;
use super::{HeldOut, LeftOut, Loop, LoopError};
use crate::criticism::Criticism;
use crate::criticism::site_name;
use crate::report::ErrorChange;
use crate::run::Fit;

/// Predictions of what was held out and of what was left out.
pub(super) struct Seen {
    pub(super) held_out: Option<HeldOut>,
    pub(super) left: LeftOut,
    pub(super) left_units: Option<LeftOut>,
}

impl Seen {
    /// By the fits of the search, and by the model as written.
    pub(super) fn new(
        of: &Loop<'_>,
        criticism: &Criticism,
        declared: &Fit<'_>,
    ) -> Result<Self, LoopError> {
        let seed = of.settings.search.seed;
        let held_out = of.joint.as_ref().map(|joint| {
            let predicted = joint.predict(&of.loaded, declared, seed)?;
            Ok::<HeldOut, LoopError>(joint.told(&of.loaded, criticism, predicted, declared))
        });
        let written = as_written(criticism, declared)?;
        let table = &of.loaded.measurements;
        let name = |rows: &Vec<usize>| {
            let first = rows.first();
            first.map_or(String::new(), |row| site_name(table, criticism.engine.table_row(*row)))
        };
        let names = criticism.engine.sites.iter().map(name);
        Ok(Self {
            held_out: held_out.transpose()?,
            left: LeftOut::sites(criticism, written.as_ref(), names.collect(), seed),
            left_units: LeftOut::units(criticism, written.as_ref(), seed),
        })
    }

    /// With the predictions of the other fits.
    pub(super) fn predict(
        &mut self,
        of: &Loop<'_>,
        before: Option<&Fit<'_>>,
        after: Option<&Fit<'_>>,
    ) -> Result<(), LoopError> {
        if before.is_none() {
            for left in self.left_units.iter_mut().chain([&mut self.left]) {
                left.as_written_only();
            }
        }
        let (Some(joint), Some(held_out)) = (&of.joint, &mut self.held_out) else { return Ok(()) };
        let predict = |fit| joint.predict(&of.loaded, fit, of.settings.search.seed);
        held_out.before = before.map(predict).transpose()?;
        held_out.after = after.map(predict).transpose()?;
        Ok(())
    }

    /// The errors that count: those of held-out measurements, else of what was left out as a whole.
    pub(super) fn first(&self, criticism: &Criticism) -> ErrorChange {
        let held_out = self.held_out.as_ref().and_then(HeldOut::comparison);
        let left = self.left_units.as_ref().unwrap_or(&self.left);
        held_out.unwrap_or_else(|| left.comparison(criticism))
    }
}
