//! `eplat study experiment`: one known truth, calibrated, and the atrium simulated with both.
//!
//! Figures 3 to 5 of the paper. Every stage keeps what it has done in the output folder, so that the same
//! command goes on after an interruption.

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

mod output;
mod simulation;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr as _;
use std::sync::Arc;

use clap::Args;
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use super::super::inputs::{source, telling};
use super::super::interrupt::{INTERRUPTED, stop_flag};
use super::super::models::Compiled;
use super::super::progress::Console;
use super::super::run::SamplerArgs;
use crate::error::Failure;
use crate::infer::Settings;
use crate::manifold::eigenpairs_cached;
use crate::mesh::{Surface, Units};
use crate::model::{Model, Sampler};
use crate::report::{FieldDraws, SettingsRecord};
use crate::run::{
    self, Domain, Ended, Keep, Loaded, Method, Options, OutputFolder, Problem, hash_file,
};
use crate::store::write_file;
use crate::store::{Identity, differences};
use crate::study::{
    Design, Experiment, Listener, Recovery, TRUTH_MODES, conduction, experiment, recover,
};
use simulation::{SimulationArgs, Teller};

/// The model's fields, in its order.
const FIELDS: [&str; 2] = ["tau_out", "apd_max"];
/// Range of `CV_max` over the surface, m/s.
///
/// Differs from the paper, whose range is 0.1 to 1.5: at 0.4 mm between vertices, slower fronts block.
const CV_MAX: (f64, f64) = (0.5, 1.0);
/// Where the run is, in the output folder.
const RUN: &str = "run";
/// What the experiment is, in the output folder.
const SETTINGS: &str = "settings.json";

/// Options of `eplat study experiment`.
#[derive(Debug, Args)]
pub(in crate::cli) struct ExperimentArgs {
    /// Surface mesh, VTK; needs --units [default: the embedded procedural left atrium]
    #[arg(long, value_name = "FILE.vtk", requires = "units", conflicts_with = "truth")]
    mesh: Option<PathBuf>,
    /// Surface with the true fields tau_out and apd_max, or tau_out_true and apd_max_true, as point data;
    /// needs --units [default: a truth is drawn]
    #[arg(long, value_name = "FILE.vtp", requires = "units")]
    truth: Option<PathBuf>,
    /// Unit of the file's coordinates: mm, cm, um or m
    #[arg(long, value_name = "UNIT", value_parser = Units::from_str)]
    units: Option<Units>,
    /// Seed of every random stream
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Lengthscale of the truth that is drawn, mm
    #[arg(long, value_name = "MM", default_value_t = 64.0)]
    lengthscale: f64,
    /// Measurement sites, each with a bracket of ERP_S2 and one of ERP_S3
    #[arg(long, value_name = "N", default_value_t = 10)]
    sites: usize,
    /// Width of a bracket, ms
    #[arg(long, value_name = "MS", default_value_t = 10.0)]
    resolution: f64,
    #[command(flatten)]
    sampler: SamplerArgs,
    #[command(flatten)]
    simulation: SimulationArgs,
    /// Folder to write: report.html, experiment.json, fields.vtp; in run all that `eplat run` leaves, in
    /// simulation the two simulations
    #[arg(long, value_name = "DIR", default_value = "out/experiment")]
    out: PathBuf,
}

/// The experiment before it is calibrated.
struct Setup {
    problem: Problem<'static>,
    settings: Settings,
    sampler: Sampler,
    /// Share of the truth's vertices that were repaired.
    truth_repaired: f64,
    /// m/s (n_vertices).
    cv_max: Vec<f64>,
}

impl ExperimentArgs {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        self.check()?;
        let out = OutputFolder::open(&self.out)?;
        let setup = self.setup(compiled)?;
        self.simulation.plan().vertex(&setup.domain()?.surface)?;
        let identity = self.claim(&out, &setup)?;
        if !setup.calibrate(&out)? {
            return Ok(self.interrupted());
        }
        let run = run::Results::read(out.file(RUN))?;
        let recovery = setup.recovery(&out)?;
        let simulated = if self.simulation.skip_simulation {
            None
        } else {
            let (plan, teller, stop) = (self.simulation.plan(), Teller::default(), stop_flag()?);
            let listener = Listener { stop: &stop, on: &|event| teller.tell(event) };
            let fields = (setup.cv_max.as_slice(), &recovery);
            let surface = &setup.domain()?.surface;
            match plan.simulate(surface, fields, &out.file("simulation"), listener)? {
                None => return Ok(self.interrupted()),
                simulated => simulated,
            }
        };
        let results = output::Results {
            setup: &setup,
            identity: &identity,
            record: &run.record,
            verdict: &run.verdict(),
            recovery: &recovery,
            simulated: simulated.as_ref(),
        };
        results.write(&out)?;
        Ok(if results.verdict.converged { ExitCode::SUCCESS } else { ExitCode::from(3) })
    }

    fn check(&self) -> Result<(), Failure> {
        let positive = |name: &str, value: f64| {
            if value > 0.0 && value.is_finite() {
                return Ok(());
            }
            Err(Failure::usage(format_args!("--{name}: expected a positive number, got {value}")))
        };
        positive("lengthscale", self.lengthscale)?;
        positive("resolution", self.resolution)?;
        positive("sites", self.sites as f64)
    }

    /// Surface, truth, measurements.
    fn setup(&self, compiled: &[Compiled]) -> Result<Setup, Failure> {
        let settings = self.sampler.settings(self.seed)?;
        let Some(shipped) = compiled.iter().find(|c| c.model.name() == "Erp") else {
            return Err(Failure::new("this program was compiled without the model models/erp.rs"));
        };
        let declared = shipped.model;
        let mut surface = run::surface(&source(self.file().zip(self.units)), &telling())?;
        let fields = self.given(&surface)?;
        // what a file holds besides would stand beside maps of the same names
        surface.point_data.clear();
        let most = surface.mesh.n_vertices() - 1;
        let modes = Model::outline(declared)?.n_modes().max(TRUTH_MODES);
        let basis = eigenpairs_cached(&surface.mesh, modes.min(most))?;
        let design = Design {
            lengthscale: self.lengthscale,
            n_sites: self.sites,
            resolution: self.resolution,
            seed: self.seed,
            fields,
            ..Design::default()
        };
        let made = experiment(declared, &surface.mesh, &basis, &design)?;
        let (n, sites, truth_repaired) = (made.measurements.len(), self.sites, made.repaired);
        let percent = 100.0 * truth_repaired;
        eprintln!(
            "data   {n} brackets at {sites} sites; {percent:.1} % of the truth's vertices repaired"
        );
        let cv_max = conduction(&basis, self.lengthscale, CV_MAX, self.seed);
        let hashes = self.hashes(shipped, &made)?;
        let domain = Some(Arc::new(Domain { surface, basis, scale: 1.0 }));
        let (measurements, truth) = (made.measurements, made.truth);
        let loaded = Loaded { domain, measurements, truth, hashes };
        let problem = Problem::new(declared, loaded)?;
        let sampler = self.sampler.choose(problem.model())?;
        Ok(Setup { problem, settings, sampler, truth_repaired, cv_max })
    }

    /// The surface's file, if it is from one.
    fn file(&self) -> Option<&Path> {
        self.truth.as_deref().or(self.mesh.as_deref())
    }

    /// Of all that is calibrated, by role.
    fn hashes(
        &self,
        shipped: &Compiled,
        made: &Experiment,
    ) -> Result<BTreeMap<String, String>, Failure> {
        let sha = |text: &str| format!("{:x}", Sha256::digest(text));
        let mut hashes = BTreeMap::from([
            ("model".to_owned(), sha(shipped.source)),
            ("data".to_owned(), sha(&made.measurements.to_csv())),
        ]);
        if let Some(file) = self.file() {
            hashes.insert("mesh".to_owned(), hash_file(file)?);
        }
        Ok(hashes)
    }

    /// The true fields of --truth, in the model's order.
    fn given(&self, surface: &Surface) -> Result<Option<Vec<Vec<f64>>>, Failure> {
        let Some(file) = &self.truth else { return Ok(None) };
        let data = &surface.point_data;
        let field = |name: &&str| {
            let found = data.get(&format!("{name}_true")).or_else(|| data.get(*name));
            found.cloned().ok_or_else(|| {
                let has: Vec<&str> = data.keys().map(String::as_str).collect();
                Failure::new(format_args!(
                    "--truth {}: expected point data {name}_true or {name}, found {}\n\
                     help: give a surface with a value of {} at every vertex",
                    file.display(),
                    if has.is_empty() { "none".to_owned() } else { has.join(", ") },
                    FIELDS.join(" and ")
                ))
            })
        };
        FIELDS.iter().map(field).collect::<Result<Vec<_>, _>>().map(Some)
    }

    /// Says in the folder what is done there; refuses a folder in which something else is.
    fn claim(&self, out: &OutputFolder, setup: &Setup) -> Result<Identity, Failure> {
        let mut identity = Identity::from([
            ("eplat's version".into(), env!("CARGO_PKG_VERSION").to_owned()),
            ("seed".into(), self.seed.to_string()),
            ("lengthscale".into(), self.lengthscale.to_string()),
            ("sites".into(), self.sites.to_string()),
            ("resolution".into(), self.resolution.to_string()),
        ]);
        if let Value::Object(options) = serde_json::to_value(setup.record())? {
            let text =
                |value: Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            identity.extend(options.into_iter().map(|(name, value)| (name, text(value))));
        }
        identity.extend(self.simulation.plan().identity());
        let hashes = setup.problem.loaded().hashes.iter();
        identity.extend(hashes.map(|(role, hash)| (format!("hash of the {role}"), hash.clone())));
        let path = out.file(SETTINGS);
        if let Ok(text) = std::fs::read(&path) {
            let differences = differences(&serde_json::from_slice(&text)?, &identity);
            if !differences.is_empty() {
                return Err(Failure::new(format_args!(
                    "the experiment in {} is another one: {}\nhelp: name another folder with --out, or remove this one",
                    out.path().display(),
                    differences.join("; ")
                )));
            }
        }
        out.make()?;
        let text = serde_json::to_vec_pretty(&identity)?;
        write_file(&path, |file| std::io::Write::write_all(file, &text))
            .map_err(|error| Failure::io("write", &path, &error))?;
        Ok(identity)
    }

    fn interrupted(&self) -> ExitCode {
        eprintln!(
            "interrupted: what is done is kept in {}\nhelp: go on with the same command line",
            self.out.display()
        );
        ExitCode::from(INTERRUPTED)
    }
}

impl Setup {
    fn domain(&self) -> Result<&Domain, Failure> {
        let domain = self.problem.loaded().domain.as_deref();
        domain.ok_or_else(|| Failure::new("the model has no field"))
    }

    fn record(&self) -> SettingsRecord {
        Method::Sampled(self.sampler).record(&self.settings)
    }

    /// Samples the posterior into the folder's run, unless that is done; whether it is now.
    fn calibrate(&self, out: &OutputFolder) -> Result<bool, Failure> {
        let run = OutputFolder::open(out.file(RUN))?;
        let keep = Keep::going_on(&run)?;
        let ended = Console::new()?.watching(|watch| {
            let options = Options { sampler: Some(self.sampler), watch, ..Options::default() };
            self.problem.run_into(&run, &self.settings, &options, &keep)
        })?;
        Ok(!matches!(ended, Ended::Stopped))
    }

    /// What the draws of the folder's run say of the truth.
    fn recovery(&self, out: &OutputFolder) -> Result<Recovery, Failure> {
        let draws = FieldDraws::read(&out.file(RUN).join(FieldDraws::FILE))?;
        let fields = |draw: usize| -> Vec<Vec<f64>> {
            FIELDS.iter().filter_map(|name| draws.at_vertices(name, draw)).collect()
        };
        let (problem, basis) = (&self.problem, &self.domain()?.basis);
        let truth = &problem.loaded().truth;
        Ok(recover(problem.declared(), basis, truth, draws.n_draws(), &fields)?)
    }
}
