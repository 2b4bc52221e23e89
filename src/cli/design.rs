//! `eplat design next MODEL.rs`: where to measure next, and what.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Subcommand};

use super::compile::run_compiled;
use super::inputs::{InputArgs, usage};
use super::models::{Compiled, ModelFile};
use super::voice::{note, stdout};
use crate::error::Failure;
use crate::experiment::Minutes;
use crate::run::{Candidates, Problem, Ranking, RunError, Settings};

/// `eplat design …`
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Rank further measurements by how much they would teach per minute
    ///
    /// Fits the model to the measurements made so far, and says for candidate sites and each protocol
    /// which share of the posterior variance (of the derived quantities, over the surface) a further
    /// measurement is expected to take away.
    Next(NextArgs),
}

#[derive(Debug, Args)]
pub(super) struct NextArgs {
    /// Model file (.rs), or the name of a model that ships, for instance erp
    model: PathBuf,
    #[command(flatten)]
    input: InputArgs,
    /// Sites that are considered, spread over the surface
    #[arg(long, value_name = "N", default_value_t = 150)]
    candidates: usize,
    /// Distance that sites keep from openings, mm
    #[arg(long, value_name = "MM", default_value_t = 6.0)]
    exclude: f64,
    /// Width of the bracket of a further measurement, in its unit
    #[arg(long, value_name = "W", default_value_t = 10.0)]
    resolution: f64,
    /// Minutes that a measurement takes, by protocol; 1 without it
    #[arg(long, value_name = "PROTOCOL=MIN", value_delimiter = ',', value_parser = minutes)]
    minutes: Vec<(String, f64)>,
    /// Minutes to move to a site
    #[arg(long, value_name = "MIN", default_value_t = 1.0)]
    moving: f64,
    /// CSV to write: every candidate, best first
    #[arg(long, value_name = "F.csv")]
    out: Option<PathBuf>,
}

fn minutes(text: &str) -> Result<(String, f64), String> {
    let parts = text.split_once('=').and_then(|(name, m)| Some((name, m.parse::<f64>().ok()?)));
    match parts {
        Some((name, minutes)) if minutes > 0.0 => Ok((name.to_owned(), minutes)),
        _ => Err("expected PROTOCOL=MINUTES, such as s1s2=2.5".to_owned()),
    }
}

impl Command {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let Self::Next(args) = self;
        args.run(compiled)
    }
}

impl NextArgs {
    fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let file = ModelFile::read(&self.model, compiled)?;
        let Some(declared) = file.find(compiled)? else { return run_compiled(&file) };
        let problem = self.input.problem(&file, declared)?;
        let ranking = self.rank(&problem).map_err(usage)?;
        writeln!(stdout(), "{}", ranking.text())?;
        if let Some(path) = &self.out {
            ranking.write(path)?;
        }
        Ok(ExitCode::SUCCESS)
    }

    fn rank(&self, problem: &Problem<'_>) -> Result<Ranking, RunError> {
        let candidates = Candidates {
            n_sites: self.candidates,
            exclude: self.exclude,
            resolution: self.resolution,
            minutes: Minutes {
                moving: self.moving,
                protocols: self.minutes.iter().cloned().collect(),
            },
            seed: self.input.seed,
        };
        candidates.check(problem)?; // before the fit
        let fit = problem.fit(&Settings { seed: self.input.seed, ..Settings::default() })?;
        let (n_failed, n) = (fit.failures().len(), fit.failures().len() + fit.chains().len());
        if n_failed > 0 {
            note(format_args!("warning: {n_failed} of {n} chains failed"));
        }
        let ranking = fit.next(&candidates)?;
        if !ranking.is_reliable {
            note(format_args!(
                "warning: the chains disagree: this ranking is not to be relied on; `eplat run` says where"
            ));
        }
        Ok(ranking)
    }
}
