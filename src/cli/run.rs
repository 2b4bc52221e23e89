//! `eplat run MODEL.rs`: from a model, a surface and measurements to the output folder.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use serde_json::json;

use super::compile::{COMPILE_SECONDS, run_compiled};
use super::inputs::{InputArgs, usage};
use super::interrupt::{self, BeginArgs, INTERRUPTED};
use super::models::{Compiled, ModelFile};
use super::progress::Console;
use super::report::exit_code;
use super::voice::{Voice, print_of_files, tell};
use crate::error::Failure;
use crate::infer::{MetricKind, Settings};
use crate::model::{Declare, Model, Sampler};
use crate::run::{Ended, Inputs, Options, OutputFolder, Problem, Results, Watch};

/// What the exit code says, for scripts.
const EXIT_CODES: &str = "Exit code:
  0    done; the verdict is green or amber (docs/verdict.md)
  1    bad input, or a failure
  2    wrong use of the command line
  3    the draws do not come from the posterior: sampling did not converge
  4    converged, but the verdict is red: the model does not fit, or is mostly unphysical
  70   a panic: a function of the model's file ended the program, or a fault of eplat did
  130  interrupted
  131  ended at once, by a second Ctrl-C";

/// `eplat run MODEL.rs`
#[derive(Debug, Args)]
#[command(after_help = EXIT_CODES)]
pub(super) struct Command {
    /// Model file (.rs), or the name of a model that ships, for instance erp
    model: PathBuf,
    #[command(flatten)]
    input: InputArgs,
    /// Output folder [default: out/NAME, after the model file's name; with --optimize out/NAME-map,
    /// with --laplace out/NAME-laplace, with --prior out/NAME-prior]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace results in the output folder that are of another model, or files of yours with the same names
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    sampler: SamplerArgs,
    #[command(flatten)]
    begin: BeginArgs,
    #[command(flatten)]
    instead: InsteadArgs,
    /// Map the probability of an event too, for instance `erp_s2 > 250` (in quotes); may be given again
    #[arg(long, value_name = "EVENT", conflicts_with = "optimize")]
    exceed: Vec<String>,
    #[command(flatten)]
    pub(super) voice: Voice,
}

/// What to do instead of sampling.
#[derive(Debug, Args)]
struct InsteadArgs {
    /// Find the posterior's mode by L-BFGS instead of sampling
    #[arg(long, conflicts_with_all = ["chains", "warmup", "draws", "target_accept", "sampler", "metric"])]
    optimize: bool,
    /// Draw from the normal approximation at the mode instead, and say how good it is
    #[arg(long, conflicts_with_all = ["optimize", "warmup", "target_accept", "sampler", "metric"])]
    laplace: bool,
    /// Draw from the prior instead: the same outputs before the measurements have a say
    #[arg(long, conflicts_with_all = ["optimize", "laplace", "warmup", "target_accept", "sampler", "metric"])]
    prior: bool,
}

impl InsteadArgs {
    /// Whether nothing else is done instead of sampling.
    fn samples(&self) -> bool {
        !(self.optimize || self.laplace || self.prior)
    }
}

/// Options of the sampler.
#[derive(Debug, Args)]
pub(super) struct SamplerArgs {
    /// Number of chains
    #[arg(long, default_value_t = 4)]
    chains: usize,
    /// The most warm-up transitions per chain, not kept
    #[arg(long, default_value_t = 1000)]
    warmup: usize,
    /// Draws kept per chain [default: 1000; for models with an operator over the surface, as of arrival
    /// times, as many as R̂ and ESS need, 1000 at most]
    #[arg(long)]
    draws: Option<usize>,
    /// Mean acceptance that the step size is tuned to, between 0 and 1; nearer to 1 means smaller
    /// steps and fewer divergences [default: 0.95, or for nuts on a model without
    /// fields 0.8]
    #[arg(long)]
    target_accept: Option<f64>,
    /// Sampler [default: integrated where every measurement is normal about a sum of fields and parameters,
    /// else blocked where every field is measured, else nuts]
    #[arg(long, value_enum)]
    sampler: Option<SamplerArg>,
    /// Shape of NUTS's mass matrix [default: low-rank]; asks for nuts, for the other samplers have no
    /// choice
    #[arg(long, value_enum)]
    metric: Option<MetricArg>,
    /// Threads; 0 means one per core. Changes no number
    #[arg(long, default_value_t = 0)]
    threads: usize,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SamplerArg {
    /// Whitened fields and their hyperparameters in alternating moves
    Blocked,
    /// Fields integrated out: every measurement normal about a sum of fields and parameters
    Integrated,
    /// NUTS on all unknowns
    Nuts,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum MetricArg {
    /// One scale per unknown, and directions in which the draws spread more or less
    LowRank,
    /// One scale per unknown
    Diag,
}

impl SamplerArgs {
    /// What was asked for, else what suits the model.
    pub(super) fn choose(&self, model: &Model) -> Result<Sampler, Failure> {
        match (self.sampler, self.metric) {
            (Some(SamplerArg::Nuts), _) | (_, Some(_)) => Ok(Sampler::Nuts),
            (Some(SamplerArg::Blocked), _) if !Sampler::Blocked.takes(model) => {
                Err(Failure::usage(
                    "--sampler blocked: the model has no field, or one that no measurement sees\nhelp: leave it out: nuts samples every model",
                ))
            }
            (Some(SamplerArg::Blocked), _) => Ok(Sampler::Blocked),
            (Some(SamplerArg::Integrated), _) if !Sampler::Integrated.takes(model) => {
                Err(Failure::usage(
                    "--sampler integrated: it needs a model of which every measurement is Normal(…) about a sum of fields, parameters and effects, and no more than 12 unknowns besides these\nhelp: leave it out: what suits the model is chosen",
                ))
            }
            (Some(SamplerArg::Integrated), _) => Ok(Sampler::Integrated),
            (None, None) => Ok(Sampler::of(model)),
        }
    }

    /// Checked, before anything slow is done.
    pub(super) fn settings(&self, seed: u64) -> Result<Settings, Failure> {
        if let (Some(SamplerArg::Blocked), Some(_)) = (self.sampler, self.metric) {
            return Err(Failure::usage(
                "--sampler blocked has no choice of --metric\nhelp: leave one of them out, or give --sampler nuts",
            ));
        }
        let settings = Settings {
            chains: self.chains,
            warmup: self.warmup,
            draws: self.draws.unwrap_or(Settings::default().draws),
            target_accept: self.target_accept,
            seed,
            threads: self.threads,
            metric: match self.metric {
                Some(MetricArg::Diag) => MetricKind::Diagonal,
                Some(MetricArg::LowRank) | None => MetricKind::LowRank,
            },
            ..Default::default()
        };
        settings.validate().map_err(Failure::usage)?;
        Ok(settings)
    }
}

impl Command {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let settings = self.sampler.settings(self.input.seed)?;
        let keep = self.begin.keep()?;
        let file = ModelFile::read(&self.model, compiled)?;
        let Some(model) = file.find(compiled)? else { return run_compiled(&file) };
        let out = OutputFolder::open(self.folder())?;
        if !self.force {
            out.refuse_another(model.name())?;
        }
        if self.instead.samples() && !keep.resume {
            out.refuse_interrupted()?;
        }
        let inputs = self.input.inputs(&file, model)?;
        Console::new()?.watching(|watch| self.fit(model, &inputs, &settings, &out, watch))
    }

    fn fit(
        &self,
        model: &dyn Declare,
        inputs: &Inputs,
        settings: &Settings,
        out: &OutputFolder,
        watch: Watch<'_>,
    ) -> Result<ExitCode, Failure> {
        let problem = Problem::load_watched(model, inputs, &watch).map_err(usage)?;
        if self.instead.optimize {
            return self.optimise(&problem, out);
        }
        let exceed = self.exceed.iter().map(|text| problem.exceedance(text));
        let exceed = exceed.collect::<Result<Vec<_>, _>>().map_err(usage)?;
        let sampler = self.sampler.choose(problem.model())?;
        let options = Options {
            exceed: &exceed,
            weights_only: false,
            sampler: Some(sampler),
            warm_start: self.begin.init.as_deref(),
            watch,
            compile_seconds: compile_seconds(),
        };
        let on_disk = Settings { disk: Some(out.path().to_owned()), ..settings.clone() };
        if self.instead.prior {
            return Ok(self.show(&problem.prior(&on_disk, &options)?.write_into(out)?));
        }
        if self.instead.laplace {
            return Ok(self.show(&problem.laplace(&on_disk, &options)?.write_into(out)?));
        }
        let enough_after = match self.sampler.draws {
            Some(_) => None,
            None => sampler.enough_after(problem.model()),
        };
        let settings = Settings { enough_after, ..settings.clone() };
        match problem.run_into(out, &settings, &options, &self.begin.keep()?)? {
            Ended::Before => {
                tell_complete(out.path());
                Ok(ExitCode::from(Results::read(out.path())?.verdict().exit_code()))
            }
            Ended::Stopped => {
                interrupt::farewell(out);
                Ok(ExitCode::from(INTERRUPTED))
            }
            Ended::Now(_, results) => Ok(self.show(&results)),
        }
    }

    /// Shows what the results say; the exit code tells whether to rely on them.
    fn show(&self, results: &Results) -> ExitCode {
        if self.voice.json {
            print_of_files(results.json());
        } else {
            let (text, folder) = (results.text(), results.folder.display());
            let files = results.files.join(", ");
            print_of_files(format_args!("\n{text}\nFiles in {folder}: {files}"));
        }
        ExitCode::from(results.verdict().exit_code())
    }

    /// The mode instead; exit code 3 if the climb did not reach one.
    fn optimise(&self, problem: &Problem<'_>, out: &OutputFolder) -> Result<ExitCode, Failure> {
        let mode = problem.mode()?;
        let files = mode.write_into(out)?.join(", ");
        if self.voice.json {
            print_of_files(mode.json());
        } else {
            let folder = out.path().display();
            print_of_files(format_args!("\n{}\nFiles in {folder}: {files}", mode.text()));
        }
        Ok(exit_code(mode.converged()))
    }

    fn folder(&self) -> PathBuf {
        let name = self.model.file_stem().unwrap_or("model".as_ref()).display().to_string();
        let instead = &self.instead;
        let name = match (instead.optimize, instead.laplace, instead.prior) {
            (true, ..) => name + "-map",
            (_, true, _) => name + "-laplace",
            (.., true) => name + "-prior",
            _ => name,
        };
        self.out.clone().unwrap_or_else(|| Path::new("out").join(name))
    }
}

/// Tells that the folder holds the finished run.
pub(super) fn tell_complete(folder: &Path) {
    let text = format_args!("complete: there is nothing left to do in {}", folder.display());
    tell("complete", text, json!({ "folder": folder }));
}

/// How long the compilation of this program took, if it was compiled for this run.
fn compile_seconds() -> f64 {
    std::env::var(COMPILE_SECONDS).ok().and_then(|s| s.parse().ok()).unwrap_or(0.0)
}
