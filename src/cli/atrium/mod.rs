//! `eplat simulate atrium`: paced tissue on a surface, from parameter fields to maps of LAT and APD.

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

mod compare;
mod drive;
mod ensemble;
mod files;
mod kept;
mod pacing;
mod tissue;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use clap::{Args, Parser};
use serde::Serialize;
use serde_json::{Value, json};

use super::interrupt::{INTERRUPTED, farewell, stop_flag};
use crate::ep::surface::{BeatMap, Fibres, Pacing, Simulation, Substrate};
use crate::ep::{Parameters, Precision, Tissue};
use crate::error::Failure;
use crate::mesh::{Refined, TriMesh};
use crate::run::OutputFolder;
use crate::store::{Checkpoint, take_chain};
use compare::Earlier;
use drive::{Drive, Progress};
use ensemble::Posterior;
use files::{RECORD, Series};
use pacing::PacingArgs;
use tissue::{Column, TissueArgs};

#[derive(Debug, Args, Serialize)]
pub(super) struct AtriumArgs {
    #[command(flatten)]
    #[serde(flatten)]
    tissue: TissueArgs,
    #[command(flatten)]
    #[serde(flatten)]
    pacing: PacingArgs,
    /// Time step, ms
    #[arg(long, value_name = "MS", default_value_t = 0.1)]
    dt: f64,
    /// Double precision: about half as fast; LAT and APD90 differ by less than 0.01 ms, APD20 by at most 0.03
    #[arg(long)]
    double: bool,
    /// Write V during the measured beat every so many ms, as a series for ParaView (voltage.pvd)
    #[arg(long, value_name = "MS", conflicts_with = "draws")]
    snapshots: Option<f64>,
    /// Simulate this many draws of the posterior of --run instead, one on each core at a time: every
    /// parameter that is NAME_mean becomes NAME of the draw; mean and sd of LAT and APD go to beat.vtp
    #[arg(long, value_name = "N", requires = "run", conflicts_with = "fields", value_parser = clap::value_parser!(u32).range(2..))]
    draws: Option<u32>,
    /// The beat.vtp of another simulation on the same mesh: the differences from it are added to the
    /// maps, and their root mean squares are told
    #[arg(long, value_name = "F.vtp")]
    #[serde(skip)]
    compare: Option<PathBuf>,
    /// Go on with the interrupted simulation in the output folder, to the same numbers as without the
    /// interruption
    #[arg(long)]
    #[serde(skip)]
    resume: bool,
    /// Least time between two savings of what --resume goes on from; they never take more than 1 %
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0)]
    #[serde(skip)]
    checkpoint_every: f64,
    /// Folder to write: beat.vtp (parameters, LAT, APD20 to APD90), simulation.json
    #[arg(long, value_name = "DIR")]
    #[serde(skip)]
    out: PathBuf,
}

/// What is simulated.
struct Setup {
    refined: Refined,
    /// The five parameters at the vertices of the mesh before it was refined.
    columns: [Column; 5],
    n_coarse: usize,
    fibres: Option<Fibres>,
    pacing: Pacing,
    dt: f64,
    earlier: Option<Earlier>,
}

impl Setup {
    fn mesh(&self) -> &TriMesh {
        &self.refined.mesh
    }

    /// The parameters at every vertex, from those before the mesh was refined.
    fn parameters(&self, coarse: Vec<[f64; 5]>) -> Vec<Parameters> {
        let mean = |a: [f64; 5], b: [f64; 5]| std::array::from_fn(|k| 0.5 * (a[k] + b[k]));
        self.refined.carry(coarse, mean).into_iter().map(Parameters::from_array).collect()
    }

    /// The parameters at every vertex as they are given, checked.
    fn given(&self) -> Result<Vec<Parameters>, Failure> {
        let at = |vertex| std::array::from_fn(|k| self.columns[k].at(vertex));
        let parameters = self.parameters((0..self.n_coarse).map(at).collect());
        for (vertex, parameters) in parameters.iter().enumerate() {
            let wrong = |error| Failure::new(format_args!("vertex {vertex}: {error}"));
            parameters.validate().map_err(wrong)?;
        }
        Ok(parameters)
    }

    fn begin<F: Precision>(&self, parameters: &[Parameters]) -> Result<Simulation<F>, Failure> {
        let tissue: Vec<Tissue> = parameters.iter().map(|p| p.tissue()).collect();
        let fibres = self.fibres.as_ref();
        let substrate = Substrate { mesh: self.mesh(), tissue: &tissue, fibres };
        Ok(Simulation::new(&substrate, &self.pacing, self.dt)?)
    }
}

/// Whose tissue is simulated.
enum Subject<'a> {
    /// One set of parameters for each vertex.
    Parameters(Vec<Parameters>),
    /// Draws of them.
    Posterior(Posterior<'a>),
}

/// What a simulation gave.
struct Outcome {
    /// Name and values (n_vertices).
    maps: Vec<(String, Vec<f64>)>,
    /// What simulation.json says of it.
    record: Vec<(&'static str, Value)>,
}

/// A command line of `eplat simulate atrium`, without these words.
#[derive(Debug, Parser)]
#[command(no_binary_name = true)]
struct Line {
    #[command(flatten)]
    args: AtriumArgs,
}

impl AtriumArgs {
    /// What such a command line asks for, its defaults included.
    pub(super) fn from_line(words: &[String]) -> Result<Self, Failure> {
        Ok(Line::try_parse_from(words)?.args)
    }

    /// The same in a folder where it may have been begun.
    pub(super) fn going_on(mut self) -> Result<Self, Failure> {
        let has_begun = Checkpoint::identity(&self.out.join("checkpoint"))?.is_some();
        self.resume = has_begun || self.out.join(RECORD).exists();
        Ok(self)
    }

    pub(super) fn run(&self) -> Result<ExitCode, Failure> {
        if self.simulate()? {
            return Ok(ExitCode::SUCCESS);
        }
        farewell(&OutputFolder::open(&self.out)?);
        Ok(ExitCode::from(INTERRUPTED))
    }

    /// Whether it came to its end, and was not interrupted.
    pub(super) fn simulate(&self) -> Result<bool, Failure> {
        let setup = self.setup()?;
        let (mesh, pacing) = (setup.mesh(), &setup.pacing);
        eprintln!(
            "{} vertices, edges {:.2} mm; {} stimuli at {} vertices, {:.0} ms in all",
            mesh.n_vertices(),
            mesh.mean_edge_length(),
            pacing.times.len(),
            pacing.vertices.len(),
            pacing.end
        );
        let subject = match self.draws {
            Some(n) => Subject::Posterior(self.posterior(&setup, n as usize)?),
            None => Subject::Parameters(setup.given()?),
        };
        let out = OutputFolder::open(&self.out)?;
        let identity = self.identity()?;
        let Some(checkpoint) = self.open(&out, &identity)? else {
            eprintln!("complete: there is nothing left to do in {}", out.path().display());
            return Ok(true);
        };
        let begun = Instant::now();
        let drive = Drive::new(&checkpoint, stop_flag()?);
        let outcome = match (&subject, self.double) {
            (Subject::Posterior(posterior), false) => posterior.ensemble::<f32>(&drive)?,
            (Subject::Posterior(posterior), true) => posterior.ensemble::<f64>(&drive)?,
            (Subject::Parameters(given), false) => self.once::<f32>(&setup, given, &drive, &out)?,
            (Subject::Parameters(given), true) => self.once::<f64>(&setup, given, &drive, &out)?,
        };
        drive.warn_of_failure();
        let Some(outcome) = outcome else { return Ok(false) };
        let seconds = checkpoint.seconds_before() + begun.elapsed().as_secs_f64();
        files::write(&out, &setup, outcome, &identity, seconds)?;
        checkpoint.remove()?;
        eprintln!("{seconds:.1} s; written to {}", out.path().display());
        Ok(true)
    }

    fn setup(&self) -> Result<Setup, Failure> {
        if let Some(every) = self.snapshots.filter(|every| !(*every >= self.dt)) {
            return Err(Failure::usage(format_args!(
                "--snapshots {every} is shorter than a time step\nhelp: give ms, for instance 5"
            )));
        }
        let surface = self.tissue.surface()?;
        let n_coarse = surface.mesh.n_vertices();
        let columns = self.tissue.columns(&surface)?;
        let refined = self.tissue.refined(surface.mesh.clone());
        let fibres = self.tissue.fibres(&surface, &refined)?;
        let pacing = self.pacing.pacing(&surface, &refined)?;
        pacing.validate(refined.mesh.n_vertices(), self.dt)?;
        let earlier = self.compare.as_deref().map(|file| Earlier::read(file, &refined.mesh));
        let earlier = earlier.transpose()?;
        Ok(Setup { refined, columns, n_coarse, fibres, pacing, dt: self.dt, earlier })
    }

    /// One simulation; `None` if it was interrupted.
    fn once<F: Precision>(
        &self,
        setup: &Setup,
        parameters: &[Parameters],
        drive: &Drive<'_>,
        out: &OutputFolder,
    ) -> Result<Option<Outcome>, Failure> {
        let mut simulation = setup.begin::<F>(parameters)?;
        let mut series = Series::new(self.snapshots, setup, out, drive.checkpoint.has_states())?;
        let progress = Progress::new(setup.pacing.end)?;
        let mut each = |simulation: &Simulation<F>| {
            progress.at(simulation.time());
            series.take(setup, simulation)
        };
        let kept = take_chain(drive.checkpoint, 0)?;
        let is_done = drive.run((0, 0), &mut simulation, kept, &mut each)?;
        progress.finish();
        if !is_done {
            return Ok(None);
        }
        let beat = simulation.beat();
        series.finish(out)?;
        Ok(Some(outcome_of(setup, parameters, beat)))
    }
}

/// Parameters and beat, and how far the beat came.
fn outcome_of(setup: &Setup, parameters: &[Parameters], beat: BeatMap) -> Outcome {
    let activated = beat.lat.iter().filter(|t| t.is_finite());
    let latest = activated.clone().copied().fold(0.0, f64::max);
    let n = activated.count();
    eprintln!(
        "beat {} of {}: {n} of {} vertices activated, the last after {latest:.1} ms",
        setup.pacing.measured + 1,
        setup.pacing.times.len(),
        setup.mesh().n_vertices()
    );
    let column = |k: usize| parameters.iter().map(|p| p.to_array()[k]).collect();
    let names = crate::ep::cell::RANGES.iter().enumerate();
    let mut maps: Vec<(String, Vec<f64>)> =
        names.map(|(k, (name, ..))| ((*name).into(), column(k))).collect();
    maps.extend(beat.named().map(|(name, values)| (name.into(), values)));
    let record = vec![("activated_vertices", json!(n)), ("latest_activation_ms", json!(latest))];
    Outcome { maps, record }
}
