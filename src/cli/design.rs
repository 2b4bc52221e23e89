//! `eplat design next MODEL.rs`: where to measure next, and what.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Subcommand};

use super::compile::run_compiled;
use super::inputs::{InputArgs, usage};
use super::models::{Compiled, ModelFile};
use crate::error::Failure;
use crate::infer::{Chain, Settings, Silent, jittered_starts};
use crate::manifold::maximin;
use crate::mesh::TriMesh;
use crate::model::{Model, Sampler};
use crate::run::RunError;
use crate::store::write_file;
use crate::experiment::{Lesson, Minutes, agree, lessons, thinned};

/// Choices that are printed.
const SHOWN: usize = 10;
/// Draws that covariances are made of.
const DRAWS: usize = 1000;

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
    /// Model file (.rs), for instance models/erp.rs
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
        let file = ModelFile::read(&self.model)?;
        let Some(declared) = file.find(compiled)? else { return run_compiled(&file) };
        let loaded = self.input.load(&self.model, declared)?;
        let Some(domain) = &loaded.domain else {
            return Err(usage(RunError::NoField));
        };
        let (surface, basis) = (&domain.surface, &domain.basis);
        let model = Model::new(declared, Some(basis), &loaded.measurements)?;
        let minutes = self.minutes(&model)?;
        let chains = sample(&model, self.input.seed)?;
        if !agree(&model, &chains) {
            eprintln!(
                "warning: the chains disagree: this ranking is not to be relied on; `eplat run` says where"
            );
        }
        let thinned = thinned(&chains, DRAWS);
        let mesh = &surface.mesh;
        let sites = maximin(mesh, self.candidates, self.exclude, self.input.seed)?;
        let found = lessons(declared, &model, basis, &thinned, &sites, self.resolution)?;
        let mut ranked: Vec<(f64, Lesson)> = found
            .into_iter()
            .map(|lesson| (minutes.moving + minutes.measuring(&lesson.observes), lesson))
            .collect();
        ranked.sort_by(|a, b| (b.1.gain / b.0).total_cmp(&(a.1.gain / a.0)));
        let mut out = std::io::stdout().lock();
        writeln!(out, "{}", text(&ranked, |v| surface.source_vertex[v as usize]))?;
        if let Some(path) = &self.out {
            self.write(path, &ranked, mesh, |v| surface.source_vertex[v as usize])?;
        }
        Ok(ExitCode::SUCCESS)
    }

    /// How long everything takes that the model observes.
    fn minutes(&self, model: &Model) -> Result<Minutes, Failure> {
        let known: Vec<&str> = model.observes.iter().map(|observe| observe.name).collect();
        if let Some((name, _)) =
            self.minutes.iter().find(|(name, _)| !known.contains(&name.as_str()))
        {
            return Err(Failure::usage(format_args!(
                "--minutes {name}: the model observes {}",
                known.join(", ")
            )));
        }
        let one = known.into_iter().map(|name| (name.to_owned(), 1.0));
        Ok(Minutes { moving: self.moving, protocols: one.chain(self.minutes.clone()).collect() })
    }

    fn write(
        &self,
        path: &Path,
        ranked: &[(f64, Lesson)],
        mesh: &TriMesh,
        source: impl Fn(u32) -> u32,
    ) -> Result<(), Failure> {
        let scale = self.input.scale();
        write_file(path, |file| {
            let mut table = csv::Writer::from_writer(file);
            table.write_record([
                "vertex",
                "x",
                "y",
                "z",
                "protocols",
                "variance_share",
                "minutes",
            ])?;
            for (minutes, lesson) in ranked {
                let point =
                    mesh.vertices()[lesson.vertex as usize].map(|x| (x / scale).to_string());
                let [x, y, z] = point;
                table.write_record([
                    source(lesson.vertex).to_string(),
                    x,
                    y,
                    z,
                    lesson.observes.join("+"),
                    lesson.gain.to_string(),
                    minutes.to_string(),
                ])?;
            }
            table.flush()
        })
        .map_err(|error| Failure::io("write", path, &error))
    }
}

/// Chains of the posterior so far; a warning if some failed.
fn sample(model: &Model, seed: u64) -> Result<Vec<Chain>, Failure> {
    let settings = Settings { seed, ..Settings::default() };
    let starts = jittered_starts(model, &model.initial(), settings.chains, seed)?;
    let chains = Sampler::of(model).sample(model, &starts, &settings, &Silent)?;
    let chains: Vec<Chain> = chains.into_iter().flatten().collect();
    if chains.is_empty() {
        return Err(Failure::new(
            "no chain came through\nhelp: `eplat run` with the same model and data says why",
        ));
    }
    if chains.len() < starts.len() {
        eprintln!("warning: {} of {} chains failed", starts.len() - chains.len(), starts.len());
    }
    Ok(chains)
}

/// The best choices as a table.
fn text(ranked: &[(f64, Lesson)], source: impl Fn(u32) -> u32) -> String {
    let mut text = String::from("vertex  variance  minutes  per minute  measure there (predicted)");
    for (minutes, Lesson { vertex, observes, gain, predicted }) in ranked.iter().take(SHOWN) {
        let what: Vec<String> = observes
            .iter()
            .zip(predicted)
            .map(|(name, (mean, sd))| format!("{name} ({mean:.0} ± {sd:.0})"))
            .collect();
        let _ = write!(
            text,
            "\n{:>6}  {:>7.2}%  {minutes:>7}  {:>9.2}%  {}",
            source(*vertex),
            -100.0 * gain,
            -100.0 * gain / minutes,
            what.join(", ")
        );
    }
    text
}
