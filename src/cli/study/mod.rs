//! `eplat study …`: calibrations on synthetic truth, many from a plan, or one with all its maps.

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

mod experiment;
mod figure;
mod slurm;

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;

use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;

use super::compile::run_compiled;
use super::models::{Compiled, ModelFile};
use crate::error::Failure;
use crate::manifold::eigenpairs_cached;
use crate::mesh::{self, Surface, Units};
use crate::model::Model;
use crate::run::hash_file as hash;
use crate::experiment::TRUTH_MODES;
use crate::study::{Block, Plan, Results, Study, Table, summarise};

/// Edge length of the embedded atrium, mm.
const ATRIUM_EDGE: f64 = 1.5;

/// `eplat study …`
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Do a plan's calibrations, those that are missing; then merge them
    ///
    /// A plan is a TOML file: model, lengthscales (mm), sites, resolutions, fields, designs, and if they
    /// differ from their defaults mesh and units, seed, exclude (mm), estimate ("mode" or "mean"), chains,
    /// warmup, draws, choice of sites ("maximin", or "next": one after the other) and, for "next", minutes
    /// (per move and protocol).  Each truth is a block, whose results appear when all of its cases are done:
    /// an interrupted study goes on with the same command.
    Run(RunArgs),
    /// Put the results of all blocks into one table, its summary and its figure
    Merge(MergeArgs),
    /// Draw the figure of one or several merged studies
    Plot(PlotArgs),
    /// Write the scripts that do a plan as a Slurm job array
    Slurm(slurm::SlurmArgs),
    /// One known truth: calibrate models/erp.rs on it, and simulate the atrium with what was recovered
    ///
    /// Figures 3 to 5 of the paper in one folder: tau_out, apd_max, ERP_S2 and ERP_S3 of the truth, their
    /// posterior means and standard deviations, how far the means are off in standard deviations (ISE), how
    /// often the intervals hold the truth, and APD20 and APD90 of the atrium simulated with the true fields
    /// and with their means.  Vertices where ERP_S2 would be above 280 ms are repaired, in the truth and in
    /// every draw: they get the average of the others, weighted by 1/d⁴, d the biharmonic distance.  An
    /// interrupted experiment goes on with the same command.
    Experiment(Box<experiment::ExperimentArgs>),
}

#[derive(Debug, Args)]
struct PlanArgs {
    /// The plan
    #[arg(value_name = "PLAN.toml")]
    plan: PathBuf,
    /// Folder of the results [default: out/NAME, after the plan's name]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(super) struct RunArgs {
    #[command(flatten)]
    plan: PlanArgs,
    /// Do only the share of task K of N, counted from 0, and do not merge
    #[arg(long, value_name = "K/N")]
    task: Option<Task>,
    /// Threads; 0 means one per core. Changes no number
    #[arg(long, default_value_t = 0)]
    threads: usize,
}

#[derive(Debug, Args)]
pub(super) struct MergeArgs {
    #[command(flatten)]
    plan: PlanArgs,
    /// Merge what is there, though blocks are missing
    #[arg(long)]
    partial: bool,
}

#[derive(Debug, Args)]
pub(super) struct PlotArgs {
    /// Folders of merged studies; they are drawn in one figure
    #[arg(value_name = "DIR", required = true)]
    studies: Vec<PathBuf>,
    /// File to write
    #[arg(long, value_name = "F.svg")]
    out: PathBuf,
}

/// The share of one task: blocks whose number leaves the rest `task` by `of`.
#[derive(Clone, Copy, Debug)]
struct Task {
    task: usize,
    of: usize,
}

impl FromStr for Task {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let parts =
            text.split_once('/').and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((task, of)) if task < of => Ok(Self { task, of }),
            _ => Err("expected K/N with K from 0 to N − 1, such as 0/8".to_owned()),
        }
    }
}

impl Command {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        match self {
            Self::Run(args) => args.run(compiled),
            Self::Merge(args) => args.run(),
            Self::Plot(args) => args.run(),
            Self::Slurm(args) => args.run(),
            Self::Experiment(args) => args.run(compiled),
        }
    }
}

impl PlanArgs {
    fn read(&self) -> Result<(Plan, Results), Failure> {
        let plan = Plan::read(&self.plan)?;
        let results = self.results(&plan)?;
        Ok((plan, results))
    }

    fn results(&self, plan: &Plan) -> Result<Results, Failure> {
        let mut hashes = BTreeMap::from([("model".to_owned(), hash(&self.beside(&plan.model))?)]);
        if let Some(mesh) = &plan.mesh {
            hashes.insert("mesh".to_owned(), hash(&self.beside(mesh))?);
        }
        Ok(Results::open(&self.folder(), plan, &hashes)?)
    }

    /// A path of the plan, relative to its folder.
    fn beside(&self, path: &Path) -> PathBuf {
        self.plan.parent().unwrap_or(Path::new("")).join(path)
    }

    fn folder(&self) -> PathBuf {
        let name = self.plan.file_stem().unwrap_or("study".as_ref());
        self.out.clone().unwrap_or_else(|| Path::new("out").join(name))
    }

    fn surface(&self, plan: &Plan) -> Result<Surface, Failure> {
        let (Some(path), Some(units)) = (&plan.mesh, &plan.units) else {
            return Ok(Surface::left_atrium(ATRIUM_EDGE));
        };
        let units = Units::from_str(units)
            .map_err(|why| Failure::new(format_args!("{}: units: {why}", self.plan.display())))?;
        Ok(mesh::read(&self.beside(path), units)?)
    }
}

impl RunArgs {
    fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let plan = Plan::read(&self.plan.plan)?;
        let file = ModelFile::read(&self.plan.beside(&plan.model))?;
        let Some(model) = file.find(compiled)? else { return run_compiled(&file) };
        let surface = self.plan.surface(&plan)?;
        let modes = Model::outline(model)?.n_modes().max(TRUTH_MODES);
        let basis = eigenpairs_cached(&surface.mesh, modes.min(surface.mesh.n_vertices() - 1))?;
        let study = Study::new(&plan, model, &surface.mesh, &basis)?;
        // a plan that cannot be done leaves no folder
        let results = self.plan.results(&plan)?;
        let mine = |block: &Block| self.task.is_none_or(|task| block.index % task.of == task.task);
        let blocks: Vec<Block> = plan.blocks().into_iter().filter(mine).collect();
        let left: Vec<&Block> = blocks.iter().filter(|b| !results.path(b).is_file()).collect();
        let n_cases = plan.cases().len();
        eprintln!(
            "study  {}: {} calibrations on each of {} truths, of which {} are left to do",
            file.path.display(),
            n_cases,
            blocks.len(),
            left.len()
        );
        let bar = ProgressBar::new((left.len() * n_cases) as u64).with_style(
            ProgressStyle::with_template("{bar:30} {pos}/{len} calibrations, {eta} left")?,
        );
        let names = study.names();
        let threads = rayon::ThreadPoolBuilder::new().num_threads(self.threads).build();
        threads.map_err(|error| Failure::new(format_args!("no threads: {error}")))?.install(
            || {
                left.par_iter().try_for_each(|block| -> Result<(), Failure> {
                    let (repaired, outcomes) = study.run(block, &|| bar.inc(1))?;
                    Ok(results.write(&plan, &names, block, repaired, &outcomes)?)
                })
            },
        )?;
        bar.finish_and_clear();
        if self.task.is_none() {
            conclude(&results, &results.merge(&plan, false)?)?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

impl MergeArgs {
    fn run(&self) -> Result<ExitCode, Failure> {
        let (plan, results) = self.plan.read()?;
        conclude(&results, &results.merge(&plan, self.partial)?)?;
        Ok(ExitCode::SUCCESS)
    }
}

impl PlotArgs {
    fn run(&self) -> Result<ExitCode, Failure> {
        let read = |folder: &PathBuf| {
            let table = Table::read(&folder.join("results.csv"))?;
            let name = folder.file_name().unwrap_or_default().display().to_string();
            Ok((name, summarise(&table)))
        };
        let studies: Vec<_> = self.studies.iter().map(read).collect::<Result<_, Failure>>()?;
        figure::write(&self.out, &studies)?;
        Ok(ExitCode::SUCCESS)
    }
}

/// Writes summary and figure of a merged study, and prints the summary.
fn conclude(results: &Results, table: &Table) -> Result<(), Failure> {
    let groups = summarise(table);
    figure::write_summary(&results.file("summary.csv"), &groups)?;
    figure::write(&results.file("figure.svg"), &[(String::new(), groups.clone())])?;
    let mut stdout = std::io::stdout().lock();
    writeln!(stdout, "{}", figure::text(&groups))?;
    let files = ["results.csv", "summary.csv", "figure.svg"].map(|name| results.file(name));
    writeln!(stdout, "{} cases in {}", table.rows.len(), files[0].display())?;
    writeln!(
        stdout,
        "means and deviations in {}, drawn in {}",
        files[1].display(),
        files[2].display()
    )?;
    Ok(())
}
