//! Where chains start, and arrival times corrected before they are fitted.

use super::check::placed;
use super::{Problem, RunError};
use crate::infer::Settings;
use crate::model::Sampler;

/// How often arrival times are corrected, each time where the best climb has led.
const ROUNDS: usize = 2;

impl Problem<'_> {
    /// The same with arrival times corrected by those of finer triangles, where climbs lead, and where chains start. Without such
    /// times the problem stays as it is.
    ///
    /// # Errors
    /// [`RunError::Infer`] where no climb can begin, [`RunError::Model`] for a surface that cannot be cut.
    pub(super) fn corrected_with_starts(
        &self,
        sampler: Sampler,
        settings: &Settings,
    ) -> Result<(Self, Vec<Vec<f64>>), RunError> {
        let mut ends =
            sampler.climbs(self.model(), settings).map_err(|error| placed(self.model(), error))?;
        let mut problem = self.clone();
        if self.model().n_activations() > 0 {
            // of its own, since times are corrected anew while chains run
            problem = self.changed(|model| {
                for round in 0..ROUNDS {
                    if round > 0 {
                        ends = sampler
                            .climbs_on(model, &ends, settings)
                            .map_err(|error| placed(model, error))?;
                    }
                    model.correct_at(&ends[..1])?;
                }
                Ok(())
            })?;
        }
        let starts = sampler.starts_at(problem.model(), &ends, settings);
        let starts = starts.map_err(|error| placed(problem.model(), error))?;
        Ok((problem, starts))
    }

    /// The same with arrival times corrected where the way uphill leads.
    ///
    /// # Errors
    /// Those of [`Problem::corrected_with_starts`].
    pub(super) fn corrected(&self) -> Result<Self, RunError> {
        if self.model().n_activations() == 0 {
            return Ok(self.clone());
        }
        let of = Sampler::of(self.model());
        Ok(self.corrected_with_starts(of, &Settings { chains: 1, ..Settings::default() })?.0)
    }

    /// The same with arrival times corrected at these unknowns, where a run has corrected them.
    pub(super) fn corrected_at(&self, at: &[Vec<f64>]) -> Result<Self, RunError> {
        if at.is_empty() {
            return Ok(self.clone());
        }
        self.changed(|model| Ok(model.correct_at(at)?))
    }
}
