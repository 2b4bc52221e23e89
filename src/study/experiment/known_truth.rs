//! A truth that is made and measured, before it is calibrated.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::ExperimentSettings;
use crate::experiment::{Design, Experiment, TRUTH_MODES, conduction, experiment};
use crate::manifold::eigenpairs_cached;
use crate::model::{Declare, Model};
use crate::run::{
    self, Domain, Loaded, MeshSource, ModelText, Origin, Problem, Watch, hash, hash_mesh,
};
use crate::study::StudyError;

/// Range of `CV_max` over the surface, m/s.
///
/// Differs from the paper, whose range is 0.1 to 1.5: at 0.4 mm between vertices, slower fronts block.
const CV_MAX: (f64, f64) = (0.5, 1.0);

/// A truth that has been measured.
#[derive(Debug)]
pub struct KnownTruth<'m> {
    pub(super) settings: ExperimentSettings,
    pub(super) problem: Problem<'m>,
    pub(super) domain: Arc<Domain>,
    /// Share of the truth's vertices that were repaired.
    pub(super) repaired: f64,
    /// m/s (n_vertices).
    pub(super) cv_max: Vec<f64>,
}

impl<'m> KnownTruth<'m> {
    /// Makes and measures the truth. `model` has the fields `tau_out` and `apd_max`; the results depend on
    /// its `text` as well.
    ///
    /// # Errors
    /// [`StudyError`] for settings that make no sense, or a surface, truth or model that does not fit.
    pub fn new(
        model: &'m dyn Declare,
        text: &str,
        settings: &ExperimentSettings,
        watch: &Watch<'_>,
    ) -> Result<Self, StudyError> {
        settings.validate()?;
        let mut surface = run::surface(&settings.mesh, watch)?;
        let fields = settings.given(&surface)?;
        // what a file holds besides would stand beside maps of the same names
        surface.point_data.clear();
        surface.cell_data.clear();
        let most = surface.mesh.n_vertices() - 1;
        let modes = Model::outline(model)?.n_modes().max(TRUTH_MODES);
        let basis = eigenpairs_cached(&surface.mesh, modes.min(most))?;
        let &ExperimentSettings { lengthscale, sites: n_sites, resolution, seed, .. } = settings;
        let design = Design { lengthscale, n_sites, resolution, seed, fields, ..Design::default() };
        let made = experiment(model, &surface.mesh, &basis, &design)?;
        settings.simulation.vertex(&surface)?;
        let cv_max = conduction(&basis, lengthscale, CV_MAX, seed);
        let hashes = hashes(&settings.mesh, text, &made)?;
        let domain = Arc::new(Domain { surface, basis, scale: 1.0 });
        let Experiment { measurements, truth, repaired } = made;
        let origin = Origin {
            mesh: settings.mesh.name(),
            data: "a synthetic experiment".into(),
            model: Some(ModelText { text: text.to_owned(), path: None }),
            ..Origin::default()
        };
        let domain_of = Some(Arc::clone(&domain));
        let loaded = Loaded { domain: domain_of, measurements, truth, hashes, origin };
        let problem = Problem::new(model, loaded)?;
        Ok(Self { settings: settings.clone(), problem, domain, repaired, cv_max })
    }

    /// What is calibrated.
    pub fn problem(&self) -> &Problem<'m> {
        &self.problem
    }

    /// Share of the truth's vertices that were unphysical and repaired.
    pub fn repaired(&self) -> f64 {
        self.repaired
    }
}

/// Hashes of all that is calibrated, by role.
fn hashes(
    mesh: &MeshSource,
    model: &str,
    made: &Experiment,
) -> Result<BTreeMap<String, String>, StudyError> {
    let mut hashes = BTreeMap::from([
        ("model".to_owned(), hash(model.as_bytes())),
        ("data".to_owned(), hash(made.measurements.to_csv().as_bytes())),
    ]);
    if let MeshSource::File { path, .. } = mesh {
        hashes.insert("mesh".to_owned(), hash_mesh(path)?);
    }
    Ok(hashes)
}
