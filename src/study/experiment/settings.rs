//! An experiment on one known truth, as plain data.

use std::path::PathBuf;

use super::SimulationPlan;
use crate::mesh::Surface;
use crate::run::MeshSource;
use crate::study::StudyError;

/// The fields that are known and recovered, in the order of `models/erp.rs`.
pub(super) const FIELDS: [&str; 2] = ["tau_out", "apd_max"];

/// An experiment on one known truth, as plain data.
#[derive(Clone, Debug)]
pub struct ExperimentSettings {
    /// The surface.
    pub mesh: MeshSource,
    /// Whether the surface brings the true fields as point data, `tau_out` and `apd_max` or
    /// `tau_out_true` and `apd_max_true`; drawn without them.
    pub truth_is_given: bool,
    /// Seed of the truth, the sites and the measurements.
    pub seed: u64,
    /// Lengthscale of the truth that is drawn, mm.
    pub lengthscale: f64,
    /// Number of measurement sites, each with a bracket for each protocol.
    pub sites: usize,
    /// Width of a bracket, ms.
    pub resolution: f64,
    /// The two simulations of the atrium.
    pub simulation: SimulationPlan,
    /// Whether these are left out.
    pub skip_simulation: bool,
}

impl ExperimentSettings {
    /// Checks what can be checked before anything is read.
    ///
    /// # Errors
    /// [`StudyError::NotPositive`].
    pub fn validate(&self) -> Result<(), StudyError> {
        let numbers = [
            ("lengthscale", self.lengthscale),
            ("resolution", self.resolution),
            ("sites", self.sites as f64),
        ];
        match numbers.into_iter().find(|(_, value)| !(*value > 0.0 && value.is_finite())) {
            Some((name, value)) => Err(StudyError::NotPositive { name, value }),
            None => Ok(()),
        }
    }

    /// The true fields that the surface brings, in the model's order.
    pub(super) fn given(&self, surface: &Surface) -> Result<Option<Vec<Vec<f64>>>, StudyError> {
        if !self.truth_is_given {
            return Ok(None);
        }
        let data = surface.scalars();
        let field = |field: &&'static str| {
            let found = data.get(&format!("{field}_true")).or_else(|| data.get(*field));
            let file = match &self.mesh {
                MeshSource::File { path, .. } => path.clone(),
                _ => PathBuf::from("surface"),
            };
            let found = found.cloned();
            found.ok_or_else(|| {
                let found = data.keys().cloned().collect();
                StudyError::NoTruth { file, field, found, fields: FIELDS.join(" and ") }
            })
        };
        FIELDS.iter().map(field).collect::<Result<Vec<_>, _>>().map(Some)
    }
}
