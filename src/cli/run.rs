//! `eplat run MODEL.rs`: from a model, a surface and measurements to the output folder.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};

use super::compile::{COMPILE_SECONDS, run_compiled};
use super::init;
use super::inputs::{InputArgs, Inputs, hash};
use super::interrupt::{self, BeginArgs, INTERRUPTED};
use super::laplace::approximate;
use super::models::{Compiled, ModelFile};
use super::optimise::optimise;
use super::output::{Finished, Outcome, OutputFolder, Sampled};
use super::sampling::{Job, every_chain_failed};
use crate::error::Failure;
use crate::infer::{self, MetricKind, jittered_starts};
use crate::model::{Declare, Model, Sampler};
use crate::report;

/// `eplat run MODEL.rs`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Model file (.rs), for instance models/erp.rs
    model: PathBuf,
    #[command(flatten)]
    input: InputArgs,
    /// Output folder [default: out/NAME, after the model file's name; with --optimize out/NAME-map,
    /// with --laplace out/NAME-laplace, with --prior out/NAME-prior]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    sampler: SamplerArgs,
    #[command(flatten)]
    begin: BeginArgs,
    #[command(flatten)]
    instead: InsteadArgs,
    /// Print the summary and the run record as JSON on stdout
    #[arg(long)]
    json: bool,
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

/// Options of the sampler.
#[derive(Debug, Args)]
pub(super) struct SamplerArgs {
    /// Number of chains
    #[arg(long, default_value_t = 4)]
    chains: usize,
    /// Warm-up transitions per chain, not kept
    #[arg(long, default_value_t = 1000)]
    warmup: usize,
    /// Draws kept per chain
    #[arg(long, default_value_t = 1000)]
    draws: usize,
    /// Mean acceptance that the step size is tuned to, between 0 and 1; nearer to 1 means smaller
    /// steps and fewer divergences
    #[arg(long, default_value_t = 0.95)]
    target_accept: f64,
    /// Sampler [default: blocked for models with fields that measurements see, else nuts]
    #[arg(long, value_enum)]
    sampler: Option<SamplerArg>,
    /// Shape of the mass matrix [default: diag]; asks for nuts, for the blocked sampler has no choice
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
    /// NUTS on all unknowns
    Nuts,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum MetricArg {
    /// One scale per unknown
    Diag,
    /// The covariance of the warm-up draws
    Dense,
}

impl SamplerArgs {
    /// What was asked for, else what suits the model.
    pub(super) fn choose(&self, model: &Model) -> Result<Sampler, Failure> {
        match (self.sampler, self.metric, Sampler::of(model)) {
            (Some(SamplerArg::Nuts), ..) | (_, Some(_), _) => Ok(Sampler::Nuts),
            (Some(SamplerArg::Blocked), _, Sampler::Nuts) => Err(Failure::usage(
                "--sampler blocked: the model has no field that measurements see\nhelp: leave it out: nuts samples every model",
            )),
            (_, _, sampler) => Ok(sampler),
        }
    }

    /// Checked, before anything slow is done.
    pub(super) fn settings(&self, seed: u64) -> Result<infer::Settings, Failure> {
        if let (Some(SamplerArg::Blocked), Some(_)) = (self.sampler, self.metric) {
            return Err(Failure::usage(
                "--sampler blocked has no choice of --metric\nhelp: leave one of them out, or give --sampler nuts",
            ));
        }
        let settings = infer::Settings {
            chains: self.chains,
            warmup: self.warmup,
            draws: self.draws,
            target_accept: self.target_accept,
            seed,
            threads: self.threads,
            metric: match self.metric {
                Some(MetricArg::Dense) => MetricKind::Dense,
                Some(MetricArg::Diag) | None => MetricKind::Diagonal,
            },
            ..Default::default()
        };
        settings.validate().map_err(Failure::usage)?;
        Ok(settings)
    }
}

impl Command {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let begun = Instant::now();
        let mut settings = self.sampler.settings(self.input.seed)?;
        let every = self.begin.every()?;
        let file = ModelFile::read(&self.model)?;
        let Some(model) = file.find(compiled)? else { return run_compiled(&file) };
        let out = OutputFolder::open(&self.folder())?;
        let mut inputs = self.input.load(model)?;
        inputs.hashes.insert("model".into(), hash(&self.model)?);
        if let Some(folder) = &self.begin.init {
            inputs.hashes.insert("init".into(), hash(&folder.join(init::FILE))?);
        }
        let model = lay_out(model, &inputs)?;
        if self.instead.optimize {
            return optimise(&model, &inputs, &out, self.json);
        }
        let sampler = self.sampler.choose(&model)?;
        let how = match (self.instead.prior, self.instead.laplace) {
            (true, _) => "prior",
            (_, true) => "laplace",
            _ => sampler.name(),
        };
        let mut finished = Finished {
            model: &model,
            inputs: &inputs,
            sampled: Sampled::default(),
            seed: settings.seed,
            settings: record_of(&settings, how),
            compile_seconds: compile_seconds(),
            begun,
        };
        if self.instead.prior || self.instead.laplace {
            let draw = if self.instead.prior { draw_prior } else { approximate };
            finished.sampled = draw(&model, &settings)?;
            return self.finish(&finished, &out);
        }
        let starts = match &self.begin.init {
            Some(folder) => init::starts(folder, &model, &mut settings)?,
            None => jittered_starts(&model, &model.initial(), settings.chains, settings.seed)?,
        };
        let begin = Begin { starts: &starts, resume: self.begin.resume, every };
        match sample_into(&out, &mut finished, sampler, &settings, &begin)? {
            Ended::Before => {
                eprintln!("complete: there is nothing left to do in {}", out.path().display());
                Ok(ExitCode::SUCCESS)
            }
            Ended::Interrupted => {
                interrupt::farewell(&out);
                Ok(ExitCode::from(INTERRUPTED))
            }
            Ended::Now(result) => self.show(&result, &out),
        }
    }

    /// Writes the results and shows what they say; the exit code tells whether to rely on them.
    fn finish(&self, finished: &Finished<'_>, out: &OutputFolder) -> Result<ExitCode, Failure> {
        self.show(&finished.write(out)?, out)
    }

    fn show(&self, result: &Outcome, out: &OutputFolder) -> Result<ExitCode, Failure> {
        let mut stdout = std::io::stdout().lock();
        if self.json {
            writeln!(stdout, "{}", result.json())?;
        } else {
            writeln!(stdout, "\n{}", result.text(out))?;
        }
        Ok(if result.converged() { ExitCode::SUCCESS } else { ExitCode::from(3) })
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

/// From where a run samples.
pub(super) struct Begin<'a> {
    /// One per chain.
    pub(super) starts: &'a [Vec<f64>],
    /// Goes on with what is in its folder.
    pub(super) resume: bool,
    /// Least time between two savings.
    pub(super) every: Duration,
}

/// How the sampling of a run ended.
pub(super) enum Ended {
    /// The results are written.
    Now(Box<Outcome>),
    /// They were there already.
    Before,
    /// The run is kept, to go on.
    Interrupted,
}

/// Samples, or goes on sampling, and writes the results of what is `finished` then.
pub(super) fn sample_into(
    out: &OutputFolder,
    finished: &mut Finished<'_>,
    sampler: Sampler,
    settings: &infer::Settings,
    begin: &Begin<'_>,
) -> Result<Ended, Failure> {
    let Begin { starts, resume, every } = *begin;
    let Some(checkpoint) = interrupt::open(out, finished.identity(), starts, resume, every)? else {
        return Ok(Ended::Before);
    };
    let (model, begun) = (finished.model, finished.begun);
    let job = Job { model, sampler, settings, starts, begun };
    let (sampled, checkpoint) = job.sample(checkpoint)?;
    let Some(sampled) = sampled else { return Ok(Ended::Interrupted) };
    if sampled.chains.is_empty() {
        checkpoint.remove()?;
        return Err(every_chain_failed(&sampled.failures));
    }
    finished.sampled = sampled;
    let result = finished.write(out)?;
    checkpoint.remove()?;
    Ok(Ended::Now(Box::new(result)))
}

/// Lays the model out on its data.
pub(super) fn lay_out(model: &dyn Declare, inputs: &Inputs) -> Result<Model, Failure> {
    let basis = inputs.surface.as_ref().map(|(_, basis)| basis);
    Ok(Model::new(model, basis, &inputs.measurements)?)
}

/// Draws from the prior.
fn draw_prior(model: &Model, settings: &infer::Settings) -> Result<Sampled, Failure> {
    let sampling = Instant::now();
    let chains = model.prior_draws(settings)?;
    eprintln!("model  {}: draws from its prior, not from its posterior", model.name);
    Ok(Sampled { chains, seconds: sampling.elapsed().as_secs_f64(), ..Sampled::default() })
}

/// The settings as the run's record has them.
pub(super) fn record_of(settings: &infer::Settings, sampler: &str) -> report::Settings {
    report::Settings {
        sampler: sampler.into(),
        chains: settings.chains,
        warmup: settings.warmup,
        draws: settings.draws,
        target_accept: settings.target_accept,
        metric: match settings.metric {
            MetricKind::Diagonal => "diag".into(),
            MetricKind::Dense => "dense".into(),
        },
    }
}

/// How long the compilation of this program took, if it was compiled for this run.
fn compile_seconds() -> f64 {
    std::env::var(COMPILE_SECONDS).ok().and_then(|s| s.parse().ok()).unwrap_or(0.0)
}
