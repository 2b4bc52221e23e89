//! `eplat study …`: calibrations on synthetic truth, many from a plan, or one with all its maps.

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

mod experiment;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;

use clap::{Args, Subcommand};
use serde_json::json;

use super::compile::run_compiled;
use super::models::{Compiled, ModelFile};
use super::voice::{Count, stdout, tell};
use crate::error::Failure;
use crate::run::Task;
use crate::study::{
    Block, JobArray, Plan, Results, Study, StudyError, Table, summarise, table_text, write_figure,
    write_summary,
};

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
    Slurm(SlurmArgs),
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

/// Options of the job array.
#[derive(Debug, Args)]
pub(super) struct SlurmArgs {
    #[command(flatten)]
    plan: PlanArgs,
    /// Tasks of the array; each does its share of the truths on one core
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..))]
    tasks: u32,
    /// Time limit of a task, as sbatch takes it
    #[arg(long, value_name = "TIME", default_value = "01:00:00")]
    time: String,
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
    fn read(&self) -> Result<(Plan, Results), StudyError> {
        let plan = Plan::read(&self.plan)?;
        let results = Results::open(&self.folder(), &plan)?;
        Ok((plan, results))
    }

    fn folder(&self) -> PathBuf {
        let name = self.plan.file_stem().unwrap_or("study".as_ref());
        self.out.clone().unwrap_or_else(|| Path::new("out").join(name))
    }
}

impl RunArgs {
    fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let plan = Plan::read(&self.plan.plan)?;
        let file = ModelFile::of_file(&plan.beside(&plan.model))?;
        let Some(model) = file.find(compiled)? else { return run_compiled(&file) };
        let surface = plan.surface()?;
        let basis = Study::basis(model, &surface.mesh)?;
        let study = Study::new(&plan, model, &surface.mesh, &basis)?;
        // a plan that cannot be done leaves no folder
        let results = Results::open(&self.plan.folder(), &plan)?;
        let mine = |block: &Block| self.task.is_none_or(|task| task.has(block.index));
        let blocks: Vec<Block> = plan.blocks().into_iter().filter(mine).collect();
        let (n_cases, n_left) = (plan.cases().len(), results.missing(&blocks).len());
        let (model, truths) = (&file.path, blocks.len());
        let text = format_args!(
            "study  {}: {n_cases} calibrations on each of {truths} truths, of which {n_left} are left to do",
            model.display()
        );
        let more = json!({ "model": model, "cases": n_cases, "truths": truths, "left": n_left });
        tell("study", text, more);
        let bar = Count::new(
            "calibrations",
            (n_left * n_cases) as u64,
            "{bar:30} {pos}/{len} calibrations, {eta} left",
        )?;
        let never = AtomicBool::new(false);
        study.complete(&results, &blocks, self.threads, &never, &|| bar.add(1))?;
        bar.finish();
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
        let studies: Vec<_> = self.studies.iter().map(read).collect::<Result<_, StudyError>>()?;
        write_figure(&self.out, &studies)?;
        Ok(ExitCode::SUCCESS)
    }
}

impl SlurmArgs {
    fn run(&self) -> Result<ExitCode, Failure> {
        let (plan, results) = self.plan.read()?;
        let program = std::env::current_exe()
            .map_err(|e| Failure::new(format_args!("cannot tell where eplat is: {e}")))?;
        let (plan, time) = (plan.path().to_owned(), self.time.clone());
        let array = JobArray { program, plan, tasks: self.tasks, time };
        writeln!(stdout(), "sh {}", array.write(&results)?.display())?;
        Ok(ExitCode::SUCCESS)
    }
}

/// Writes summary and figure of a merged study, and prints the summary.
fn conclude(results: &Results, table: &Table) -> Result<(), Failure> {
    let groups = summarise(table);
    let names = Results::OF_ALL;
    let [summary, figure] = names.map(|name| results.file(name));
    write_summary(&summary, &groups)?;
    write_figure(&figure, &[(String::new(), groups.clone())])?;
    results.seal(&names)?;
    let mut stdout = stdout();
    writeln!(stdout, "{}", table_text(&groups))?;
    let (cases, [summary, figure]) = (table.rows.len(), [&summary, &figure].map(|p| p.display()));
    writeln!(stdout, "{cases} cases in {}", results.file("results.csv").display())?;
    writeln!(stdout, "means and deviations in {summary}, drawn in {figure}")?;
    Ok(())
}
