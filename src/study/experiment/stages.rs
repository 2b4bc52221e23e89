//! The stages of an experiment: calibration, recovery, simulations, files.

use std::io::Write as _;

use serde_json::Value;

use super::findings::{FILES, RECORD, SETTINGS, TISSUE};
use super::settings::FIELDS;
use super::{ExperimentSettings, ExperimentWatch, Findings, KnownTruth};
use crate::infer::Settings;
use crate::model::Sampler;
use crate::report::FieldDraws;
use crate::run::{self, Ended, Keep, Method, Options, OutputFolder};
use crate::store::{Identity, differences, write_file};
use crate::study::{Recovery, StudyError, recover};

/// Where the run is, in the output folder.
const RUN: &str = "run";
/// Where the simulations are, in the output folder.
const SIMULATION: &str = "simulation";

impl KnownTruth<'_> {
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
        let folder = OutputFolder::open(out.file(RUN))?;
        folder.refuse_another(self.problem.model().name)?;
        let identity = self.claim(out, settings, sampler)?;
        let options = Options { sampler: Some(sampler), watch: watch.run, ..Options::default() };
        let keep = Keep::going_on(&folder)?;
        if let Ended::Stopped = self.problem.run_into(&folder, settings, &options, &keep)? {
            return Ok(None);
        }
        let run = run::Results::read(folder.path())?;
        let recovery = self.recovery(&folder)?;
        let mut simulated = None;
        if !self.settings.skip_simulation {
            let (plan, to) = (&self.settings.simulation, out.file(SIMULATION));
            simulated =
                plan.simulate(&self.domain.surface, (&self.cv_max, &recovery), &to, watch)?;
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
        let record = Method::Sampled(sampler).record(self.problem.model(), settings);
        let record = serde_json::to_value(record)?;
        let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let options = record.as_object().into_iter().flatten();
        identity.extend(options.map(|(name, value)| (name.clone(), text(value))));
        identity.extend(self.settings.simulation.identity());
        let hashes = self.problem.loaded().hashes.iter();
        identity.extend(hashes.map(|(role, hash)| (format!("hash of the {role}"), hash.clone())));
        let path = out.file(SETTINGS);
        let text = std::fs::read(&path).ok();
        let there = text.and_then(|text| serde_json::from_slice::<Identity>(&text).ok());
        if let Some(there) = there {
            let differences = differences(&there, &identity);
            if !differences.is_empty() {
                let folder = out.path().to_owned();
                return Err(StudyError::AnotherExperiment { folder, differences });
            }
        } else {
            // nothing here is of an experiment
            out.refuse_foreign([SETTINGS, RECORD, TISSUE].into_iter().chain(FILES))?;
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
