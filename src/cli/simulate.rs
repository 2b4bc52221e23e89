//! `eplat simulate …`

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Subcommand};
use serde_json::json;

use super::atrium::AtriumArgs;
use super::cell::CellArgs;
use super::voice::{Count, note, tell};
use crate::ep::table::{StripTable, curve_intervals, finish_rows, new_file, read_parameters};
use crate::ep::{Grid, GridError, Protocol};
use crate::error::Failure;

/// `eplat simulate …`
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Pace a strip of tissue for every parameter set of a table
    ///
    /// The strip is paced from one end with a train of S1 beats.  Conduction velocity and action
    /// potential duration are measured in its middle; the effective refractory periods are found by
    /// bisection, ERP_S2 after the last of these beats and ERP_S3 after a further beat, S2.  An ERP is
    /// the largest whole interval in ms whose stimulus fails.  A set outside the model's valid ranges,
    /// and whatever is not captured or blocked on the way, has empty cells and a reason.
    Strip(StripArgs),
    /// Pace one cell: V and the gate in time, and the APD restitution curve
    ///
    /// After a train of S1 beats a single S2 beat, at each of several intervals; its durations are drawn
    /// over the diastolic interval before it. An S2 that meets a cell above the threshold, or does not
    /// excite it, has empty cells.
    Cell(CellArgs),
    /// Pace a whole surface with a parameter set at every vertex, and map activation and recovery
    ///
    /// The monodomain equation with the strip's cell at every vertex. `eplat run` leaves fields.vtp
    /// with the posterior means of its fields.
    Atrium(Box<AtriumArgs>),
}

#[derive(Debug, Args)]
pub(super) struct StripArgs {
    /// CSV with the columns cv_max_m_per_s, tau_in_ms, tau_out_ms, tau_open_ms, apd_max_ms
    #[arg(long, value_name = "F.csv")]
    params: PathBuf,
    /// CSV to write: the parameters, then CV, APD and ERP; an absent value is an empty cell with
    /// its reason in the last columns
    #[arg(long, value_name = "F.csv")]
    out: PathBuf,
    /// CSV to write CV and APD of single S2 beats to, S2 = 200, 220 … 600 ms; their curves
    /// a − b exp(−(S2 − d)/c) are fitted and go to --out.  Takes 2.5 times as long
    #[arg(long, value_name = "F.csv")]
    restitution: Option<PathBuf>,
    /// Interval of the S1 train, ms
    #[arg(long, value_name = "MS", default_value_t = Protocol::default().s1)]
    s1: u32,
    /// Interval of the conditioning S2 of S1S2S3, ms
    #[arg(long, value_name = "MS", default_value_t = Protocol::default().s2)]
    s2: u32,
    /// Beats of the S1 train
    #[arg(long, value_name = "N", default_value_t = Protocol::default().n_beats)]
    beats: u32,
    /// Strength of the conditioning stimuli, 1/ms
    #[arg(long, value_name = "X", default_value_t = Protocol::default().conditioning_strength)]
    strength: f64,
    /// Strength of the test stimulus whose ERP is sought, 1/ms
    #[arg(long, value_name = "X", default_value_t = Protocol::default().test_strength)]
    test_strength: f64,
    /// Shortest interval an ERP may have, ms
    #[arg(long, value_name = "MS", default_value_t = Protocol::default().shortest)]
    shortest: u32,
    /// Longest interval that is tried, ms
    #[arg(long, value_name = "MS", default_value_t = Protocol::default().longest)]
    longest: u32,
    /// Length of the strip, mm
    #[arg(long, value_name = "MM", default_value_t = Grid::default().length())]
    length: f64,
    /// Width of the strip, mm: 2, 4, 6 or 8 times the spacing
    #[arg(long, value_name = "MM", default_value_t = 0.6)]
    width: f64,
    /// Distance of neighbouring nodes, mm
    #[arg(long, value_name = "MM", default_value_t = Grid::default().spacing)]
    spacing: f64,
    /// Time step of diffusion, ms; the cells take five substeps in it
    #[arg(long, value_name = "MS", default_value_t = Grid::default().dt)]
    dt: f64,
    /// One row of nodes instead of a strip: 2.5 times as fast, with ERP_S2 0.2 and ERP_S3 0.3 ms rms
    /// (at most 2 ms) from the strip's and CV 0.002 m/s higher
    #[arg(long, conflicts_with = "width")]
    cable: bool,
}

impl StripArgs {
    fn protocol(&self) -> Protocol {
        Protocol {
            s1: self.s1,
            s2: self.s2,
            n_beats: self.beats,
            conditioning_strength: self.strength,
            test_strength: self.test_strength,
            shortest: self.shortest,
            longest: self.longest,
            restitution: vec![],
        }
    }

    fn grid(&self) -> Result<Grid, GridError> {
        let width = if self.cable { 0.0 } else { self.width };
        Grid::of_size([self.length, width], self.spacing, self.dt)
    }
}

impl Command {
    pub(super) fn run(self) -> Result<ExitCode, Failure> {
        match self {
            Self::Strip(args) => args.run().map(|()| ExitCode::SUCCESS),
            Self::Cell(args) => args.run().map(|()| ExitCode::SUCCESS),
            Self::Atrium(args) => args.run(),
        }
    }
}

impl StripArgs {
    fn run(&self) -> Result<(), Failure> {
        let grid = self.grid()?;
        let files = StripFiles {
            parameters: &self.params,
            out: &self.out,
            curves: self.restitution.as_deref(),
        };
        files.simulate(&grid, &self.protocol())
    }
}

/// Files of a table of strips.
pub(super) struct StripFiles<'a> {
    pub(super) parameters: &'a Path,
    pub(super) out: &'a Path,
    /// For every beat of every strip's restitution curve.
    pub(super) curves: Option<&'a Path>,
}

impl StripFiles<'_> {
    /// Runs `protocol`, with beats of a restitution curve if their file is asked for, on a strip for each
    /// row of parameters.
    pub(super) fn simulate(&self, grid: &Grid, protocol: &Protocol) -> Result<(), Failure> {
        let restitution = self.curves.map_or(vec![], |_| curve_intervals());
        let protocol = Protocol { restitution, ..protocol.clone() };
        let curves = self.curves.map(new_file).transpose()?;
        let parameters = read_parameters(self.parameters)?;
        let file = new_file(self.out)?;
        let in_range = parameters.iter().filter(|p| p.validate().is_ok()).count();
        let bar = Count::new("strips", in_range as u64, "{bar:30} {pos}/{len} strips, {eta} left")?;
        let table = StripTable::simulate(&parameters, grid, &protocol, &|n| bar.add(n))?;
        bar.finish();
        finish_rows(file, &table.rows)?;
        let (n, absent) = (table.rows.len(), table.n_without_erp_s3());
        tell(
            "written",
            format_args!("{n} strips, {absent} without ERP_S3, written to {}", self.out.display()),
            json!({ "file": self.out, "strips": n, "without_erp_s3": absent }),
        );
        if table.n_refused > 0 {
            note(format_args!(
                "{} of them outside the valid ranges: not simulated, the reason is in the last columns",
                table.n_refused
            ));
        }
        Ok(curves.map_or(Ok(()), |file| finish_rows(file, &table.curves))?)
    }
}
