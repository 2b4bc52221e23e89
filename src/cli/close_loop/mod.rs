//! `eplat loop MODEL.rs`: what the model lacks, the model with it, and the error before and after.

mod predictions;
mod sizes;
mod story;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};

use self::predictions::{Heldout, Joint, leave_sites_out_twice, leave_units_out_twice};
use self::story::Story;
use super::compile::run_compiled;
use super::inputs::{InputArgs, Inputs, hash};
use super::interrupt;
use super::models::{Compiled, ModelFile};
use super::output::{Finished, OutputFolder, Sampled};
use super::run::record_of;
use super::sampling::{Job, every_chain_failed};
use crate::criticism::{self, Case, Outcome, criticise, rewrite, site_column};
use crate::error::Failure;
use crate::infer::{self, Chain, jittered_starts};
use crate::manifold::{Basis, eigenpairs_cached};
use crate::model::{AddedEffect, Augmented, Declare, Model, Sampler};
use crate::report::write_loop_page;
use crate::store::write_file;
use crate::table::Measurements;

/// Fewer sites than this cannot be criticised.
const LEAST_SITES: usize = 10;
/// Fewer searches on simulated data than this cannot show a share of at most 5 %.
const LEAST_NULLS: usize = 19;

/// `eplat loop MODEL.rs`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Model file (.rs), for instance models/erp.rs
    model: PathBuf,
    #[command(flatten)]
    input: InputArgs,
    /// Measurements that play no part in the search: the error before and after is theirs; without
    /// lower and upper (or value) they are only predicted
    #[arg(long, value_name = "FILE.csv")]
    heldout: Option<PathBuf>,
    /// Output folder [default: out/NAME-loop, after the model file's name]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Searches on data simulated from the base fit, at least 19: what a claim must beat
    #[arg(long, default_value_t = 99)]
    nulls: usize,
    /// Threads; 0 means one per core. Changes no number
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Print finding.json on stdout
    #[arg(long)]
    json: bool,
}

/// A model that was sampled.
struct Sampling {
    model: Model,
    chains: Vec<Chain>,
    converged: bool,
}

impl Command {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let begun = Instant::now();
        let file = ModelFile::read(&self.model)?;
        let Some(model) = file.find(compiled)? else { return run_compiled(&file) };
        self.check_options(model)?;
        let out = OutputFolder::open(&self.folder())?;
        let mut inputs = self.input.load(model)?;
        inputs.hashes.insert("model".into(), hash(&self.model)?);
        check_sites(&inputs.measurements)?;
        let joint = self.joint(model, &inputs)?;
        let outcome = self.search(model, &inputs)?;
        let effects = added(model, &outcome, &inputs.measurements)?;
        let outliers = outcome.last.outer.outliers;
        let plain: Vec<AddedEffect> = effects.iter().map(|(effect, _)| effect.clone()).collect();
        let before = self.sample(model, &inputs, &out, "before")?;
        let augmented = Augmented::new(model, &plain).with_outliers(outliers);
        let after = if outcome.found.is_empty() {
            None
        } else {
            Some(self.sample(&augmented, &inputs, &out, "after")?)
        };
        let predict = |joint: &Joint| {
            let declared = [model, &augmented];
            let seed = self.input.seed;
            Heldout::predict(joint, declared, &inputs, &before, after.as_ref(), &outcome, seed)
        };
        let heldout = joint.as_ref().map(predict).transpose()?;
        let story = Story {
            outcome: &outcome,
            effects: &effects,
            inputs: &inputs,
            before: &before,
            after: after.as_ref(),
            heldout: heldout.as_ref(),
            left: leave_sites_out_twice(&outcome, self.input.seed),
            left_units: leave_units_out_twice(&outcome, self.input.seed),
        };
        let files = self.write(&story, &out, &file.source)?;
        let mut stdout = std::io::stdout().lock();
        if self.json {
            writeln!(stdout, "{:#}", story.finding())?;
        } else {
            writeln!(
                stdout,
                "\n{}\nwrote {} to {} in {:.1} s",
                story.text(),
                files.join(", "),
                out.path().display(),
                begun.elapsed().as_secs_f64()
            )?;
        }
        let converged = before.converged && after.as_ref().is_none_or(|after| after.converged);
        Ok(if converged { ExitCode::SUCCESS } else { ExitCode::from(3) })
    }

    /// Complains about options that make no sense.
    fn check_options(&self, model: &dyn Declare) -> Result<(), Failure> {
        if !self.input.has_data() {
            return Err(Failure::usage(
                "eplat loop criticises a model on measurements\nhelp: give them with --data FILE.csv",
            ));
        }
        if self.nulls < LEAST_NULLS {
            return Err(Failure::usage(format_args!(
                "--nulls {}: a claim must beat 95 % of the searches on simulated data, which fewer than {LEAST_NULLS} cannot show\nhelp: leave it out (99), or give at least {LEAST_NULLS}",
                self.nulls
            )));
        }
        let outline = Model::outline(model)?;
        if outline.observes.is_empty() {
            return Err(Failure::new(format_args!(
                "{}: the model {} observes nothing, so that there are no residuals to explain\nhelp: add an `observe` statement",
                self.model.display(),
                outline.name
            )));
        }
        Ok(())
    }

    /// The held-out rows behind those of the table, checked before anything slow is done.
    fn joint(&self, model: &dyn Declare, inputs: &Inputs) -> Result<Option<Joint>, Failure> {
        let Some(path) = &self.heldout else { return Ok(None) };
        let heldout = Measurements::read(path)?;
        check_apart(&inputs.measurements, &heldout)?;
        Joint::new(model, inputs, heldout, self.input.scale()).map(Some)
    }

    /// Writes everything but the two fits; the page last.
    fn write(
        &self,
        story: &Story<'_>,
        out: &OutputFolder,
        source: &str,
    ) -> Result<Vec<String>, Failure> {
        let mut files = vec![];
        if !story.outcome.found.is_empty() {
            let outliers = story.outcome.last.outer.outliers;
            let name = file_name(&self.model, story);
            let text = rewrite(source, story.effects, outliers).map_err(|mistake| {
                let (path, help) = (self.model.display(), mistake.help);
                Failure::new(format_args!("{path}: {}\nhelp: {help}", mistake.message))
            })?;
            save(out, &name, &text)?;
            files.push(name);
        }
        if let Some(heldout) = story.heldout {
            save(out, "heldout_predictions.csv", &heldout.csv())?;
            files.push("heldout_predictions.csv".into());
        }
        save(out, "finding.json", &format!("{:#}\n", story.finding()))?;
        files.push("finding.json".into());
        files.push("before/report.html".into());
        if story.after.is_some() {
            files.push("after/report.html".into());
        }
        story.page(&files, |page| write_loop_page(&out.file("report.html"), page))?;
        files.push("report.html".into());
        Ok(files)
    }

    fn folder(&self) -> PathBuf {
        let stem = self.model.file_stem().unwrap_or("model".as_ref()).display();
        self.out.clone().unwrap_or_else(|| Path::new("out").join(format!("{stem}-loop")))
    }

    fn search(&self, model: &dyn Declare, inputs: &Inputs) -> Result<Outcome, Failure> {
        let basis = self.finer_basis(inputs)?;
        let case = Case { model, basis: basis.as_deref(), table: &inputs.measurements };
        let settings = criticism::Settings {
            nulls: self.nulls,
            seed: self.input.seed,
            ..criticism::Settings::default()
        };
        let (bar, is_terminal) = (self.bar(), std::io::stderr().is_terminal());
        let watch = |round: usize, done: usize| {
            bar.set_message((round + 1).to_string());
            bar.set_position(done as u64);
            if !is_terminal && done == self.nulls {
                eprintln!("search round {}: {done} searches on simulated data", round + 1);
            }
        };
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(self.threads)
            .build()
            .map_err(|error| Failure::new(format_args!("cannot start threads: {error}")))?;
        let outcome = pool.install(|| criticise(&case, &settings, &watch))?;
        bar.finish_and_clear();
        Ok(outcome)
    }

    /// More modes than the model has, to tell what these cannot follow from what no field explains; of a
    /// `--basis` all that are there.
    fn finer_basis<'i>(&self, inputs: &'i Inputs) -> Result<Option<Cow<'i, Basis>>, Failure> {
        let Some((surface, basis)) = &inputs.surface else { return Ok(None) };
        if self.input.basis.is_some() {
            return Ok(Some(Cow::Borrowed(basis)));
        }
        let n_modes = (criticism::FINER * basis.n_modes()).min(surface.mesh.n_vertices() - 1);
        Ok(Some(Cow::Owned(eigenpairs_cached(&surface.mesh, n_modes)?)))
    }

    fn bar(&self) -> ProgressBar {
        let template = "search round {msg} {bar:24} {pos:>3}/{len} simulated, ETA {eta}";
        let style = ProgressStyle::with_template(template);
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        ProgressBar::new(self.nulls as u64).with_style(style)
    }

    /// Samples a model into its own folder.
    fn sample(
        &self,
        declared: &dyn Declare,
        inputs: &Inputs,
        out: &OutputFolder,
        name: &str,
    ) -> Result<Sampling, Failure> {
        let begun = Instant::now();
        eprintln!("sample the model {name}");
        let basis = inputs.surface.as_ref().map(|(_, basis)| basis);
        let model = Model::new(declared, basis, &inputs.measurements)?;
        let settings = infer::Settings {
            seed: self.input.seed,
            threads: self.threads,
            ..infer::Settings::default()
        };
        let sampler = Sampler::of(&model);
        let starts = jittered_starts(&model, &model.initial(), settings.chains, settings.seed)?;
        let folder = OutputFolder::open(&out.file(name))?;
        let mut finished = Finished {
            model: &model,
            inputs,
            sampled: Sampled::default(),
            seed: settings.seed,
            settings: record_of(&settings, sampler.name()),
            compile_seconds: 0.0,
            begun,
        };
        let every = Duration::from_secs(2);
        let opened = interrupt::open(&folder, finished.identity(), &starts, false, every)?;
        let Some(checkpoint) = opened else { unreachable!("a run that begins is not complete") };
        let job = Job { model: &model, sampler, settings: &settings, starts: &starts, begun };
        let (sampled, checkpoint) = job.sample(checkpoint)?;
        checkpoint.remove()?;
        let sampled = sampled.ok_or_else(|| Failure::new("interrupted"))?;
        if sampled.chains.is_empty() {
            return Err(every_chain_failed(&sampled.failures));
        }
        finished.sampled = sampled;
        let converged = finished.write(&folder)?.converged();
        let chains = std::mem::take(&mut finished.sampled.chains);
        drop(finished);
        Ok(Sampling { model, chains, converged })
    }
}

/// The sites of a table by name, each with a row; `column` names them.
fn sites(table: &Measurements, column: Option<&str>) -> BTreeMap<String, usize> {
    let site = |row: usize| match column {
        Some(column) => table.cell(row, column).unwrap_or_default().to_owned(),
        None => row.to_string(),
    };
    (0..table.len()).map(|row| (site(row), row)).collect()
}

/// Complains about too few sites.
fn check_sites(table: &Measurements) -> Result<(), Failure> {
    let n = sites(table, site_column(table)).len();
    if n >= LEAST_SITES {
        return Ok(());
    }
    Err(Failure::new(format_args!(
        "{}: {n} sites; at least {LEAST_SITES} are needed to tell an effect from chance\nhelp: measure at more sites; rows of one site share what the column `site`, or else `vertex`, holds",
        table.file()
    )))
}

/// Complains about sites that would be predicted from themselves.
fn check_apart(train: &Measurements, heldout: &Measurements) -> Result<(), Failure> {
    let Some(column) = site_column(train).filter(|column| heldout.has(column)) else {
        return Ok(());
    };
    let own = sites(train, Some(column));
    let both = sites(heldout, Some(column)).into_iter().find(|(site, _)| own.contains_key(site));
    let Some((site, row)) = both else { return Ok(()) };
    Err(Failure::new(format_args!(
        "{}, line {}: {column} {site} is also in {}: it would be predicted from itself\nhelp: hold out whole sites",
        heldout.file(),
        heldout.line(row),
        train.file()
    )))
}

/// What was found as effects with names of their own, and why each is there.
fn added(
    model: &dyn Declare,
    outcome: &Outcome,
    table: &Measurements,
) -> Result<Vec<(AddedEffect, String)>, Failure> {
    let outline = Model::outline(model)?;
    let unit_of = |name: &str| {
        let statement = outline.statements.iter().find(|s| s.decl.name == name);
        statement.map(|s| s.decl.unit.to_owned()).unwrap_or_default()
    };
    let mut effects: Vec<(AddedEffect, String)> = vec![];
    let is_taken = |name: &str, effects: &[(AddedEffect, String)]| {
        outline.statements.iter().any(|s| s.decl.name == name)
            || effects.iter().any(|(e, _)| e.name == name)
    };
    for round in &outcome.rounds {
        let log_bf = round.taken.map_or(f64::NAN, |taken| round.tried[taken].log_bf);
        for (k, candidate) in round.claimed.iter().enumerate() {
            let found = &outcome.candidates[*candidate];
            let Some(form) = found.form.clone() else { continue };
            let (on, sd) = (found.on.clone(), found.sd);
            let mut name = found.name.clone();
            if k > 0 {
                name = format!("{name}_{}", on.join("_"));
            }
            while is_taken(&name, &effects) {
                name += "_effect";
            }
            let data = name_of(table);
            let why = format!("Found by `eplat loop` in {data}: log Bayes factor {log_bf:.1}.");
            let unit = unit_of(&on[0]);
            effects.push((AddedEffect { name, on, unit, form, sd }, why));
        }
    }
    Ok(effects)
}

/// The name of a table's file, without the folders above it.
fn name_of(table: &Measurements) -> String {
    let path = Path::new(table.file());
    path.file_name().unwrap_or(path.as_os_str()).display().to_string()
}

fn file_name(model: &Path, story: &Story<'_>) -> String {
    let stem = model.file_stem().unwrap_or("model".as_ref()).display().to_string();
    format!("{stem}_plus_{}.rs", story.outcome.findings().join("_"))
}

fn save(out: &OutputFolder, name: &str, text: &str) -> Result<(), Failure> {
    out.make()?;
    let path = out.file(name);
    write_file(&path, |file| file.write_all(text.as_bytes()))
        .map_err(|error| Failure::io("write", &path, &error))
}
