//! Arrival times corrected before they are fitted.

use super::check::placed;
use super::{Problem, RunError};
use crate::model::Sampler;

/// How often arrival times are corrected, each time where the last climb has led.
const ROUNDS: usize = 2;

impl Problem<'_> {
    /// The same with arrival times corrected by those of finer triangles, at a typical point of the posterior; itself if it has
    /// none, or they are corrected already.
    ///
    /// # Errors
    /// [`RunError::Infer`] where no climb can begin, [`RunError::Model`] for a surface that cannot be cut.
    pub(super) fn corrected(&self, sampler: Option<Sampler>) -> Result<Self, RunError> {
        if self.model().n_activations() == 0 || self.model().corrected_at().is_some() {
            return Ok(self.clone());
        }
        let sampler = sampler.unwrap_or_else(|| Sampler::of(self.model()));
        self.changed(|model| {
            for _ in 0..ROUNDS {
                let at = sampler.typical(model).map_err(|error| placed(model, error))?;
                model.correct_at(&at)?;
            }
            Ok(())
        })
    }

    /// The same with arrival times corrected at these unknowns, where a run has corrected them.
    pub(super) fn corrected_at(&self, at: Option<&[f64]>) -> Result<Self, RunError> {
        let Some(at) = at else { return Ok(self.clone()) };
        self.changed(|model| Ok(model.correct_at(at)?))
    }
}
