//! `eplat study experiment`: one known truth, calibrated, and the atrium simulated with both.

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use clap::Args;
use serde_json::json;

use super::super::atrium::{AtriumBar, introduce, tell_beat};
use super::super::inputs::{source, telling};
use super::super::interrupt::INTERRUPTED;
use super::super::models::Compiled;
use super::super::progress::Console;
use super::super::reading::ReadingArgs;
use super::super::run::{SamplerArgs, tell_complete};
use super::super::voice::{note, stdout, tell};
use crate::error::Failure;
use crate::run::OutputFolder;
use crate::study::{
    ExperimentSettings, ExperimentWatch, Findings, KnownTruth, SimulationEvent, SimulationPlan,
    StudyError,
};

/// Options of `eplat study experiment`.
#[derive(Debug, Args)]
pub(in crate::cli) struct ExperimentArgs {
    /// Surface mesh [default: the embedded procedural left atrium]
    #[arg(long, value_name = "FILE", conflicts_with = "truth")]
    mesh: Option<PathBuf>,
    /// Surface with the true fields tau_out and apd_max, or tau_out_true and apd_max_true, as point data
    /// [default: a truth is drawn]
    #[arg(long, value_name = "FILE.vtp")]
    truth: Option<PathBuf>,
    #[command(flatten)]
    reading: ReadingArgs,
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

impl ExperimentArgs {
    fn settings(&self) -> ExperimentSettings {
        let Self { seed, lengthscale, sites, resolution, ref simulation, .. } = *self;
        let file = self.truth.as_deref().or(self.mesh.as_deref());
        ExperimentSettings {
            mesh: source(file.map(|path| (path, self.reading.of(path))), false),
            truth_is_given: self.truth.is_some(),
            seed,
            lengthscale,
            sites,
            resolution,
            simulation: simulation.plan(),
            skip_simulation: simulation.skip_simulation,
        }
    }

    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let settings = self.settings();
        settings.validate().map_err(usage)?;
        let sampling = self.sampler.settings(self.seed)?;
        let out = OutputFolder::open(&self.out)?;
        let Some(shipped) = compiled.iter().find(|c| c.model.name() == "Erp") else {
            return Err(Failure::new("this program was compiled without the model models/erp.rs"));
        };
        let truth = KnownTruth::new(shipped.model, shipped.source, &settings, &telling())?;
        note(format_args!(
            "data   {} brackets at {} sites; {:.1} % of the truth's vertices repaired",
            truth.problem().measurements().len(),
            self.sites,
            100.0 * truth.repaired()
        ));
        let sampler = self.sampler.choose(truth.problem().model())?;
        let teller = Teller::default();
        let findings = Console::new()?.watching(|run| {
            let watch = ExperimentWatch { run, on_simulation: &|event| teller.tell(event) };
            truth.run_into(&out, &sampling, sampler, watch)
        })?;
        if let Some(findings) = findings {
            return self.show(&findings);
        }
        let text = format_args!(
            "interrupted: what is done is kept in {}\nhelp: go on with the same command line",
            self.out.display()
        );
        tell("interrupted", text, json!({ "folder": self.out }));
        Ok(ExitCode::from(INTERRUPTED))
    }

    fn show(&self, findings: &Findings<'_>) -> Result<ExitCode, Failure> {
        let mut stdout = stdout();
        writeln!(
            stdout,
            "{}\n{}",
            findings.text(),
            crate::report::verdict_lines(&findings.verdict)
        )?;
        writeln!(
            stdout,
            "Files in {}: report.html, experiment.json, fields.vtp, measurements.csv; the run in {}",
            self.out.display(),
            findings.run.folder.display()
        )?;
        Ok(ExitCode::from(findings.verdict.exit_code()))
    }
}

/// A number that makes no sense is a matter of the command line.
fn usage(error: StudyError) -> Failure {
    match error {
        StudyError::NotPositive { .. } => Failure::usage(error),
        other => other.into(),
    }
}

#[derive(Debug, Args)]
struct SimulationArgs {
    /// Do not simulate the atrium: no APD. The same command without this goes on with it
    #[arg(long)]
    skip_simulation: bool,
    /// Beats of the atrium, 600 ms apart; the last is measured
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..))]
    beats: u32,
    /// Vertex that is paced, counted from 0 as in the file [default: one at the rim of the widest opening]
    #[arg(long, value_name = "VERTEX")]
    pace: Option<usize>,
    /// Cut every triangle into four, this many times, for the simulation [default: until vertices are 0.4 mm
    /// apart]
    #[arg(long, value_name = "N")]
    refine: Option<u32>,
}

impl SimulationArgs {
    fn plan(&self) -> SimulationPlan {
        SimulationPlan { beats: self.beats, pace: self.pace, refine: self.refine }
    }
}

/// Tells on stderr how the two simulations go.
#[derive(Default)]
struct Teller {
    bar: Mutex<Option<AtriumBar>>,
}

impl Teller {
    fn tell(&self, event: SimulationEvent<'_>) {
        let mut bar = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            SimulationEvent::Begins(which, atrium) => {
                note(format_args!("atrium with the {which} fields"));
                introduce(atrium);
                *bar = AtriumBar::new(atrium.total_time()).ok();
            }
            SimulationEvent::Goes(event) => {
                if let Some(bar) = &*bar {
                    bar.show(event);
                }
            }
            SimulationEvent::WasComplete(folder) => tell_complete(folder),
            SimulationEvent::Ends(atrium, beat, folder) => {
                if let Some(bar) = bar.take() {
                    bar.finish();
                }
                tell_beat(atrium, beat, folder);
            }
        }
    }
}
