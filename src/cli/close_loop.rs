//! `eplat loop MODEL.rs`: what the model lacks, the model with it, and the error before and after.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};

use super::compile::run_compiled;
use super::events::loop_event;
use super::inputs::InputArgs;
use super::interrupt::{INTERRUPTED, farewell};
use super::models::{Compiled, ModelFile};
use super::progress::Console;
use super::voice::{Voice, bar_target, print_of_files, tell};
use crate::closed_loop::{FITS, Loop, LoopError, LoopEvent, LoopSettings, LoopWatch, Story};
use crate::criticism::{SearchProgress, SearchSettings};
use crate::error::Failure;
use crate::infer::Settings;
use crate::model::Declare;
use crate::run::OutputFolder;
use crate::table::{Columns, Measurements, Role};

/// `eplat loop MODEL.rs`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Model file (.rs), or the name of a model that ships, for instance erp
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
    /// Replace results in the output folder that are of another model, or files of yours with the same names
    #[arg(long)]
    force: bool,
    /// Go on with the interrupted loop in the output folder, to the same files as without the interruption
    #[arg(long)]
    resume: bool,
    /// Searches on data simulated from the base fit, at least 19: what a claim must beat
    #[arg(long, default_value_t = 99, value_parser = at_most_a_million)]
    nulls: usize,
    /// What a column of the table means, where its name does not tell: distance, time, region, unit,
    /// fold, structural or covariate; may be repeated
    #[arg(long = "column", value_name = "NAME=ROLE", value_parser = named_role)]
    columns: Vec<(String, Role)>,
    /// Threads; 0 means one per core. Changes no number
    #[arg(long, default_value_t = 0)]
    threads: usize,
    #[command(flatten)]
    pub(super) voice: Voice,
}

impl Command {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let begun = Instant::now();
        let file = ModelFile::read(&self.model, compiled)?;
        let Some(model) = file.find(compiled)? else { return run_compiled(&file) };
        if !self.input.has_data() {
            return Err(Failure::usage(
                "eplat loop criticises a model on measurements\nhelp: give them with --data FILE.csv",
            ));
        }
        let out = OutputFolder::open(self.folder())?;
        if !self.force {
            for fit in FITS.iter().filter(|fit| out.file(fit).exists()) {
                OutputFolder::open(out.file(fit))?.refuse_another(model.name())?;
            }
            Story::refuse_foreign(&out)?;
        }
        let prepared = self.prepare(&file, model)?;
        let story = match self.watched(|watch| prepared.close(Some(&out), watch))? {
            Err(LoopError::Stopped) => {
                farewell(&out);
                return Ok(ExitCode::from(INTERRUPTED));
            }
            closed => closed?,
        };
        let files = story.write(&out, &file.source, &self.stem())?;
        self.show(&story, &files, &out, begun);
        Ok(ExitCode::from(story.exit_code()))
    }

    /// Reads and checks everything.
    fn prepare<'m>(&self, file: &ModelFile, model: &'m dyn Declare) -> Result<Loop<'m>, Failure> {
        let mut loaded = self.input.load(file, model)?;
        let roles = self.columns.iter();
        let roles = roles.fold(Columns::default(), |all, (name, role)| all.with(name, *role));
        loaded.measurements.set_roles(roles)?;
        let heldout = self.heldout.as_deref().map(Measurements::read).transpose()?;
        let settings = LoopSettings {
            search: SearchSettings {
                nulls: self.nulls,
                seed: self.input.seed,
                ..SearchSettings::default()
            },
            sampling: Settings { threads: self.threads, ..Settings::default() },
            basis_is_given: self.input.basis.is_some(),
            resume: self.resume,
        };
        Loop::new(model, loaded, heldout, settings).map_err(usage)
    }

    /// Runs with a bar for the search and the console of a run for the fits.
    fn watched<T>(&self, run: impl FnOnce(&LoopWatch<'_>) -> T) -> Result<T, Failure> {
        let (bar, is_terminal) = (self.bar(), std::io::stderr().is_terminal());
        Ok(Console::new()?.watching(|fit| {
            let on_event = |event: &LoopEvent<'_>| match event {
                LoopEvent::Search(SearchProgress { round, done, of }) => {
                    bar.set_message((round + 1).to_string());
                    bar.set_position(*done as u64);
                    if self.voice.json || !is_terminal && done == of {
                        tell_loop_event(event);
                    }
                }
                LoopEvent::Searched => bar.finish_and_clear(),
                LoopEvent::Fit(event) => (fit.on_event)(event),
                LoopEvent::Sample { .. } => tell_loop_event(event),
            };
            run(&LoopWatch { on_event: &on_event, stop: fit.stop })
        }))
    }

    fn bar(&self) -> ProgressBar {
        let template = "search round {msg} {bar:24} {pos:>3}/{len} simulated, ETA {eta}";
        let style = ProgressStyle::with_template(template);
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        ProgressBar::with_draw_target(Some(self.nulls as u64), bar_target()).with_style(style)
    }

    fn show(&self, story: &Story, files: &[String], out: &OutputFolder, begun: Instant) {
        if self.voice.json {
            return print_of_files(format_args!("{:#}", story.finding()));
        }
        print_of_files(format_args!(
            "\n{}\nwrote {} to {} in {:.1} s",
            story.text(),
            files.join(", "),
            out.path().display(),
            begun.elapsed().as_secs_f64()
        ));
    }

    /// Name of the model file without its ending.
    fn stem(&self) -> String {
        self.model.file_stem().unwrap_or("model".as_ref()).display().to_string()
    }

    fn folder(&self) -> PathBuf {
        let default = || Path::new("out").join(format!("{}-loop", self.stem()));
        self.out.clone().unwrap_or_else(default)
    }
}

/// Tells one event, with its figures.
fn tell_loop_event(event: &LoopEvent<'_>) {
    let (name, fields) = loop_event(event);
    tell(name, event, fields);
}

/// Too few searches are a matter of the command line.
fn usage(error: LoopError) -> Failure {
    match error {
        LoopError::TooFewNulls { .. } => Failure::usage(error),
        other => other.into(),
    }
}

/// A number of searches that can be made.
fn at_most_a_million(text: &str) -> Result<usize, String> {
    let n: usize = text.parse().map_err(|_| "expected a whole number".to_owned())?;
    if n <= 1_000_000 { Ok(n) } else { Err("more than a million".to_owned()) }
}

/// `NAME=ROLE`.
fn named_role(text: &str) -> Result<(String, Role), String> {
    let (name, role) = text.split_once('=').ok_or("expected NAME=ROLE, for instance age=unit")?;
    Ok((name.to_owned(), role.parse()?))
}
