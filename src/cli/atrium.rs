//! `eplat simulate atrium`: paced tissue on a surface, from parameter fields to maps of LAT and APD.

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use super::interrupt::{INTERRUPTED, farewell, stop_flag};
use super::reading::ReadingArgs;
use super::run::tell_complete;
use super::simulation::{tell_event, warn};
use super::voice::{bar_target, note, tell, tell_progress, voice};
use super::vulnerability::S1S2Args;
use crate::error::Failure;
use crate::run::OutputFolder;
use crate::run::atrium::{
    Atrium, AtriumError, AtriumSettings, Beat, Begin, Ended, Event, Ground, Numerics,
    PacingSettings, Resume, Source, Summary, TissueSettings, Watch,
};

#[derive(Debug, Args)]
pub(super) struct AtriumArgs {
    #[command(flatten)]
    tissue: TissueArgs,
    #[command(flatten)]
    pacing: PacingArgs,
    #[command(flatten)]
    s1s2: S1S2Args,
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
    compare: Option<PathBuf>,
    /// Go on with the interrupted simulation in the output folder, to the same numbers as without the
    /// interruption
    #[arg(long)]
    resume: bool,
    /// Least time between two savings of what --resume goes on from; they never take more than 1 %
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0)]
    checkpoint_every: f64,
    /// Folder to write: beat.vtp (parameters, LAT, APD20 to APD90), simulation.json; with --s1s2 vulnerability.vtp,
    /// s1s2.csv, sites.csv, vulnerability.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct TissueArgs {
    /// Surface with parameter fields as point data, such as fields.vtp of a run; the
    /// embedded left atrium with 0.4 mm edges without it
    #[arg(long, value_name = "F.vtp", conflicts_with = "run")]
    fields: Option<PathBuf>,
    /// Output folder of a run: its fields.vtp is the surface
    #[arg(long, value_name = "DIR")]
    run: Option<PathBuf>,
    #[command(flatten)]
    reading: ReadingArgs,
    /// Cut every triangle into four, this many times: fronts need edges below 0.5 mm
    #[arg(long, value_name = "N", default_value_t = 0)]
    refine: u32,
    /// CV_max, with fibres along them: a number, m/s, or the name of a field
    #[arg(long, value_name = "X", default_value = "0.7")]
    cv_max: Source,
    /// tau_in: a number, ms, or the name of a field
    #[arg(long, value_name = "X", default_value = "0.05")]
    tau_in: Source,
    /// tau_out: a number, ms, or the name of a field
    #[arg(long, value_name = "X", default_value = "tau_out_mean")]
    tau_out: Source,
    /// tau_open: a number, ms, or the name of a field
    #[arg(long, value_name = "X", default_value = "120")]
    tau_open: Source,
    /// APD_max: a number, ms, or the name of a field
    #[arg(long, value_name = "X", default_value = "apd_max_mean")]
    apd_max: Source,
    /// Vectors of points or triangles along which conduction is faster
    #[arg(long, value_name = "NAME", requires = "anisotropy")]
    fibres: Option<String>,
    /// CV along the fibres over CV across, 1 or more
    #[arg(long, value_name = "R", requires = "fibres")]
    anisotropy: Option<f64>,
}

#[derive(Debug, Args)]
struct PacingArgs {
    /// Vertices that are paced together (with --s1s2 each by itself), counted from 0 as in the file
    #[arg(
        long,
        value_name = "VERTEX",
        value_delimiter = ',',
        required_unless_present_any = ["pace_region", "sites"]
    )]
    pace: Vec<usize>,
    /// Pace all vertices at which point data have this value, such as region=6, the embedded atrium's
    /// mitral rim
    #[arg(long, value_name = "NAME=VALUE", value_parser = named_value, conflicts_with = "pace")]
    pace_region: Option<(String, f64)>,
    /// Vertices closer than this to one of --pace are stimulated with it, mm
    #[arg(long, value_name = "MM", default_value_t = 3.0)]
    radius: f64,
    /// Interval of the S1 train, ms
    #[arg(long, value_name = "MS", default_value_t = 600.0)]
    s1: f64,
    /// Beats of the S1 train
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..))]
    beats: u32,
    /// Intervals of further stimuli, ms: S2, S3 and so on; any train is --beats 1 and its intervals
    #[arg(long, value_name = "MS", value_delimiter = ',')]
    extra: Vec<f64>,
    /// Strength of the stimuli, 1/ms
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    strength: f64,
    /// Beat that is measured, from 1; the last without it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    measure: Option<u32>,
    /// How long the last beat is followed, ms
    #[arg(long, value_name = "MS", default_value_t = 600.0)]
    last: f64,
}

fn named_value(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    let value = value.parse().map_err(|_| format!("expected a number after =, got {value:?}"))?;
    Ok((name.into(), value))
}

impl TissueArgs {
    /// The surface, with the draws of its run where these are asked for.
    pub(super) fn ground(&self, with_draws: bool) -> Result<Ground, AtriumError> {
        let Self { fields, run, reading, .. } = self;
        match (run, fields) {
            (Some(run), _) => {
                let ground = Ground::of_run(run, |file| reading.of(file))?;
                if with_draws { ground.with_draws_of(run) } else { Ok(ground) }
            }
            (None, Some(file)) => Ground::read(file, reading.of(file)),
            (None, None) => Ok(Ground::embedded()),
        }
    }

    pub(super) fn settings(&self) -> TissueSettings {
        TissueSettings {
            refine: self.refine,
            cv_max: self.cv_max.clone(),
            tau_in: self.tau_in.clone(),
            tau_out: self.tau_out.clone(),
            tau_open: self.tau_open.clone(),
            apd_max: self.apd_max.clone(),
            fibres: self.fibres.clone(),
            anisotropy: self.anisotropy,
        }
    }
}

impl PacingArgs {
    fn settings(&self) -> PacingSettings {
        PacingSettings {
            pace: self.pace.clone(),
            pace_region: self.pace_region.clone(),
            radius: self.radius,
            s1: self.s1,
            beats: self.beats,
            extra: self.extra.clone(),
            strength: self.strength,
            measure: self.measure,
            last: self.last,
        }
    }
}

impl AtriumArgs {
    fn settings(&self) -> AtriumSettings {
        let Self { dt, double, snapshots, draws, .. } = *self;
        AtriumSettings {
            tissue: self.tissue.settings(),
            pacing: self.pacing.settings(),
            numerics: Numerics { dt, double, snapshots },
            draws,
            compare: self.compare.clone(),
        }
    }

    fn begin(&self) -> Result<Begin, Failure> {
        let seconds = self.checkpoint_every;
        let every = Duration::try_from_secs_f64(seconds).map_err(|_| {
            Failure::usage(format_args!(
                "--checkpoint-every: expected seconds, 0 or more, got {seconds}\nhelp: 10 is the default"
            ))
        })?;
        Ok(Begin { resume: if self.resume { Resume::Always } else { Resume::Never }, every })
    }

    pub(super) fn run(&self) -> Result<ExitCode, Failure> {
        let ground = self.tissue.ground(self.draws.is_some())?;
        if self.s1s2.is_asked() {
            return self.s1s2.run(ground, &self.settings(), self.begin()?, &self.out);
        }
        let atrium = Atrium::new(ground, &self.settings()).map_err(|error| match error {
            AtriumError::Snapshots(_) => Failure::usage(error),
            other => other.into(),
        })?;
        introduce(&atrium);
        if let Some((fields, n)) = atrium.drawn() {
            let (asked, fields) = (self.draws.unwrap_or(0), fields.join(", "));
            note(format_args!("{asked} of {n} draws of {fields}"));
        }
        let out = OutputFolder::open(&self.out)?;
        let bar = AtriumBar::new(atrium.total_time())?;
        let stop = stop_flag()?;
        let watch = Watch { stop: &stop, on_event: &|event| bar.show(event) };
        match atrium.simulate_into(&self.out, self.begin()?, watch)? {
            Ended::Before => tell_complete(&self.out),
            Ended::Now(beat) => {
                bar.finish();
                tell_beat(&atrium, &beat, &self.out);
            }
            Ended::Interrupted => {
                farewell(&out);
                return Ok(ExitCode::from(INTERRUPTED));
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Says on stderr what will be simulated.
pub(super) fn introduce(atrium: &Atrium) {
    warn(atrium);
    let (mesh, pacing) = (atrium.mesh(), atrium.pacing());
    note(format_args!(
        "{} vertices, edges {:.2} mm; {} stimuli at {} vertices, {:.0} ms in all",
        mesh.n_vertices(),
        mesh.mean_edge_length(),
        pacing.times.len(),
        pacing.vertices.len(),
        pacing.end
    ));
}

/// Says on stderr what came of a simulation and where it is.
pub(super) fn tell_beat(atrium: &Atrium, beat: &Beat, out: &Path) {
    tell_summary(atrium, beat);
    if let Some(file) = &atrium.settings().compare {
        note(format_args!("against {}:", file.display()));
    }
    for (name, difference) in &beat.record.compared {
        note(format_args!(
            "  {name:<6} RMSE {:6.2} ms, mean difference {:+6.2} ms, {} vertices",
            difference.rmse_ms, difference.mean_difference_ms, difference.vertices
        ));
    }
    let seconds = beat.record.seconds;
    let text = format_args!("{seconds:.1} s; written to {}", out.display());
    tell("written", text, json!({ "folder": out, "seconds": seconds }));
}

/// Says on stderr how far the activation came.
fn tell_summary(atrium: &Atrium, beat: &Beat) {
    match beat.record.summary {
        Summary::One { activated_vertices, latest_activation_ms } => note(format_args!(
            "beat {} of {}: {activated_vertices} of {} vertices activated, the last after {latest_activation_ms:.1} ms",
            beat.record.measured_beat,
            atrium.pacing().times.len(),
            beat.record.vertices
        )),
        Summary::Many { draws, captured_pairs, pairs_in_range } => {
            let captured = beat.maps.iter().find(|(name, _)| name == "captured");
            let always = captured
                .map_or(0, |(_, shares)| shares.iter().filter(|share| **share >= 1.0).count());
            note(format_args!(
                "{draws} draws: {:.2} % of (vertex, draw) pairs captured, all draws at {always} of {} vertices; {:.2} % of pairs \
                 out of range: simulated at the nearest valid values, left out of the maps",
                100.0 * captured_pairs,
                beat.record.vertices,
                100.0 * (1.0 - pairs_in_range)
            ));
        }
    }
}

/// How far simulations are, on stderr: a bar on a terminal, a line for every tenth otherwise.
pub(super) struct AtriumBar {
    bar: ProgressBar,
    is_terminal: bool,
    total: f64,
}

impl AtriumBar {
    /// Of `total` ms.
    pub(super) fn new(total: f64) -> Result<Self, Failure> {
        let style = ProgressStyle::with_template("{bar:30} {pos}/{len} ms, {eta} left")?;
        let bar = ProgressBar::with_draw_target(Some(total as u64), bar_target()).with_style(style);
        Ok(Self { bar, is_terminal: std::io::stderr().is_terminal(), total })
    }

    pub(super) fn show(&self, event: Event<'_>) {
        match event {
            Event::Time(time) => self.at(time),
            other => tell_event(other),
        }
    }
    /// `time` ms are done.
    fn at(&self, time: f64) {
        let part = |time: f64, of: f64| (of * time / self.total) as u64;
        let before = self.bar.position();
        if time as u64 == before {
            return;
        }
        self.bar.set_position(time as u64);
        if voice().json && part(time, 100.0) > part(before as f64, 100.0) {
            tell_progress("time", json!({ "done": time as u64, "of": self.total as u64 }));
        } else if voice().is_words()
            && !self.is_terminal
            && part(time, 10.0) > part(before as f64, 10.0)
        {
            let eta = self.bar.eta().as_secs();
            note(format_args!("{} of {} ms, {eta} s left", time as u64, self.total as u64));
        }
    }

    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
