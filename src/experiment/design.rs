//! The paper's example experiment.

use super::{ExperimentError, Laboratory};
use crate::manifold::{Basis, maximin};
use crate::mesh::TriMesh;
use crate::model::Declare;
use crate::table::Measurements;

/// How the paper's example experiment is made.
#[derive(Clone, Debug)]
pub struct Design {
    /// Lengthscale of the ground truth, mm.
    pub lengthscale: f64,
    /// Number of measurement sites.
    pub n_sites: usize,
    /// Distance that sites keep from openings, mm.
    pub exclude: f64,
    /// Width of a bracket, in the unit of the measurement.
    pub resolution: f64,
    /// Seed of the truth and of the sites.
    pub seed: u64,
    /// The true fields in the model's order, each (n_vertices), before they are repaired; drawn without them.
    pub fields: Option<Vec<Vec<f64>>>,
}

impl Default for Design {
    /// The paper's example: 64 mm, 10 sites, 6 mm, 10 ms.
    fn default() -> Self {
        Self {
            lengthscale: 64.0,
            n_sites: 10,
            exclude: 6.0,
            resolution: 10.0,
            seed: 1,
            fields: None,
        }
    }
}

/// Measurements made on a known truth.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// The table, as a file would hold it.
    pub measurements: Measurements,
    /// Names and values (n_vertices) of the true fields and derived quantities; NaN where the truth
    /// is unphysical even after repair.
    pub truth: Vec<(String, Vec<f64>)>,
    /// Share of vertices that were repaired.
    pub repaired: f64,
}

/// Makes the experiment. `basis` should have [`TRUTH_MODES`](super::TRUTH_MODES) modes; all it has are used.
///
/// # Errors
/// [`ExperimentError`].
pub fn experiment(
    model: &dyn Declare,
    mesh: &TriMesh,
    basis: &Basis,
    design: &Design,
) -> Result<Experiment, ExperimentError> {
    let laboratory = Laboratory::new(model, basis)?;
    if !laboratory.outline().has_fields() {
        return Err(ExperimentError::NotSynthetic { why: "the model has no field".into() });
    }
    let truth = match &design.fields {
        Some(fields) => laboratory.truth_of(fields.clone())?,
        None => laboratory.truth(design.lengthscale, design.seed)?,
    };
    let Design { resolution, seed, .. } = *design;
    let visits = laboratory.visits(&maximin(mesh, design.n_sites, design.exclude, seed)?);
    let measurements = laboratory.measure(&truth.fields, &visits, resolution, seed)?;
    let repaired = truth.repaired();
    let maps = truth.fields.into_iter().chain(truth.derived);
    let truth = laboratory.map_names().into_iter().zip(maps).collect();
    Ok(Experiment { measurements, truth, repaired })
}
