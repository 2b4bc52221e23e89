//! One known truth: calibrated, and the atrium simulated with it and with what was recovered.
//!
//! Figures 3 to 5 of the paper. Every stage keeps what it has done in the output folder, so that an
//! experiment that was interrupted goes on from there.

mod findings;
mod simulation;

pub use findings::Findings;
pub use simulation::{Simulated, SimulationEvent, SimulationPlan};

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

use serde_json::Value;

use super::{Recovery, StudyError, recover};
use crate::experiment::{Design, Experiment, TRUTH_MODES, conduction, experiment};
use crate::infer::Settings;
use crate::manifold::eigenpairs_cached;
use crate::mesh::Surface;
use crate::model::{Declare, Model, Sampler};
use crate::report::FieldDraws;
use crate::run::{
    self, Domain, Ended, Keep, Loaded, MeshSource, Method, Options, OutputFolder, Problem, Watch,
    hash, hash_file,
};
use crate::store::{Identity, differences, write_file};

/// The fields that are known and recovered, in the order of `models/erp.rs`.
const FIELDS: [&str; 2] = ["tau_out", "apd_max"];
/// Range of `CV_max` over the surface, m/s.
///
/// Differs from the paper, whose range is 0.1 to 1.5: at 0.4 mm between vertices, slower fronts block.
const CV_MAX: (f64, f64) = (0.5, 1.0);
/// Where the run is, in the output folder.
const RUN: &str = "run";
/// What the experiment is, in the output folder.
const SETTINGS: &str = "settings.json";

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

/// A truth that has been measured.
#[derive(Debug)]
pub struct KnownTruth<'m> {
    settings: ExperimentSettings,
    problem: Problem<'m>,
    domain: Arc<Domain>,
    /// Share of the truth's vertices that were repaired.
    repaired: f64,
    /// m/s (n_vertices).
    cv_max: Vec<f64>,
}

/// Who is told how an experiment goes, and may stop it.
#[derive(Clone, Copy)]
pub struct ExperimentWatch<'a> {
    /// Told of the calibration; its flag stops the simulations too.
    pub run: Watch<'a>,
    /// Told of the simulations.
    pub on_simulation: &'a (dyn Fn(SimulationEvent<'_>) + Sync),
}

impl Default for ExperimentWatch<'_> {
    /// Hears nothing and never stops it.
    fn default() -> Self {
        Self { run: Watch::default(), on_simulation: &|_| () }
    }
}

impl std::fmt::Debug for ExperimentWatch<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ExperimentWatch").field("run", &self.run).finish_non_exhaustive()
    }
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
    fn given(&self, surface: &Surface) -> Result<Option<Vec<Vec<f64>>>, StudyError> {
        if !self.truth_is_given {
            return Ok(None);
        }
        let data = &surface.point_data;
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

    /// Hashes of all that is calibrated, by role.
    fn hashes(
        &self,
        model: &str,
        made: &Experiment,
    ) -> Result<BTreeMap<String, String>, StudyError> {
        let mut hashes = BTreeMap::from([
            ("model".to_owned(), hash(model.as_bytes())),
            ("data".to_owned(), hash(made.measurements.to_csv().as_bytes())),
        ]);
        if let MeshSource::File { path, .. } = &self.mesh {
            hashes.insert("mesh".to_owned(), hash_file(path)?);
        }
        Ok(hashes)
    }
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
        let most = surface.mesh.n_vertices() - 1;
        let modes = Model::outline(model)?.n_modes().max(TRUTH_MODES);
        let basis = eigenpairs_cached(&surface.mesh, modes.min(most))?;
        let &ExperimentSettings { lengthscale, sites: n_sites, resolution, seed, .. } = settings;
        let design = Design { lengthscale, n_sites, resolution, seed, fields, ..Design::default() };
        let made = experiment(model, &surface.mesh, &basis, &design)?;
        settings.simulation.vertex(&surface)?;
        let cv_max = conduction(&basis, lengthscale, CV_MAX, seed);
        let hashes = settings.hashes(text, &made)?;
        let domain = Arc::new(Domain { surface, basis, scale: 1.0 });
        let Experiment { measurements, truth, repaired } = made;
        let loaded = Loaded { domain: Some(Arc::clone(&domain)), measurements, truth, hashes };
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

    /// Calibrates and simulates what is not done yet in the folder `out`, and writes what was found there;
    /// `None` if it was stopped.
    ///
    /// ```text
    /// report.html experiment.json fields.vtp measurements.csv settings.json
    /// run/ (all that a run leaves)   simulation/true/ simulation/mean/ (all that an atrium simulation leaves)
    /// ```
    ///
    /// # Errors
    /// [`StudyError::AnotherExperiment`] for a folder in which something else was done; whatever makes a
    /// run or a simulation impossible.
    pub fn run_into(
        &self,
        out: &OutputFolder,
        settings: &Settings,
        sampler: Sampler,
        watch: ExperimentWatch<'_>,
    ) -> Result<Option<Findings<'_>>, StudyError> {
        let identity = self.claim(out, settings, sampler)?;
        let folder = OutputFolder::open(out.file(RUN))?;
        let options =
            Options { sampler: Some(sampler), watch: watch.run, ..Options::default() };
        let keep = Keep::going_on(&folder)?;
        if let Ended::Stopped = self.problem.run_into(&folder, settings, &options, &keep)? {
            return Ok(None);
        }
        let run = run::Results::read(folder.path())?;
        let recovery = self.recovery(&folder)?;
        let mut simulated = None;
        if !self.settings.skip_simulation {
            let (plan, to) = (&self.settings.simulation, out.file("simulation"));
            simulated = plan.simulate(&self.domain.surface, (&self.cv_max, &recovery), &to, watch)?;
            if simulated.is_none() {
                return Ok(None);
            }
        }
        let verdict = run.verdict();
        let findings = Findings { truth: self, identity, run, verdict, recovery, simulated };
        findings.write(out)?;
        Ok(Some(findings))
    }

    /// Says in the folder what is done there; refuses a folder in which something else is.
    fn claim(
        &self,
        out: &OutputFolder,
        settings: &Settings,
        sampler: Sampler,
    ) -> Result<Identity, StudyError> {
        let ExperimentSettings { seed, lengthscale, sites, resolution, .. } = self.settings;
        let mut identity = Identity::from([
            ("eplat's version".into(), env!("CARGO_PKG_VERSION").to_owned()),
            ("seed".into(), seed.to_string()),
            ("lengthscale".into(), lengthscale.to_string()),
            ("sites".into(), sites.to_string()),
            ("resolution".into(), resolution.to_string()),
        ]);
        let record = serde_json::to_value(Method::Sampled(sampler).record(settings))?;
        let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let options = record.as_object().into_iter().flatten();
        identity.extend(options.map(|(name, value)| (name.clone(), text(value))));
        identity.extend(self.settings.simulation.identity());
        let hashes = self.problem.loaded().hashes.iter();
        identity.extend(hashes.map(|(role, hash)| (format!("hash of the {role}"), hash.clone())));
        let path = out.file(SETTINGS);
        if let Ok(text) = std::fs::read(&path) {
            let differences = differences(&serde_json::from_slice(&text)?, &identity);
            if !differences.is_empty() {
                let folder = out.path().to_owned();
                return Err(StudyError::AnotherExperiment { folder, differences });
            }
        }
        out.make()?;
        let text = serde_json::to_vec_pretty(&identity)?;
        write_file(&path, |file| file.write_all(&text)).map_err(StudyError::io(&path))?;
        Ok(identity)
    }

    /// What the draws of the run in `folder` say of the truth.
    fn recovery(&self, folder: &OutputFolder) -> Result<Recovery, StudyError> {
        let draws = FieldDraws::read(&folder.file(FieldDraws::FILE))?;
        let fields = |draw: usize| -> Vec<Vec<f64>> {
            FIELDS.iter().filter_map(|name| draws.at_vertices(name, draw)).collect()
        };
        let truth = &self.problem.loaded().truth;
        let basis = &self.domain.basis;
        Ok(recover(self.problem.declared(), basis, truth, draws.n_draws(), &fields)?)
    }
}
