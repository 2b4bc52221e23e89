//! `eplat simulate …`

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};

use super::atrium::AtriumArgs;
use super::cell::CellArgs;
use crate::ep::cell::OutOfRange;
use crate::ep::table::{CurveRow, OutcomeRow, finish_rows, new_file, read_parameters};
use crate::ep::{Grid, Protocol, StripOutcome, simulate_strips};
use crate::error::Failure;
use crate::store::NewFile;

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
            restitution: match self.restitution {
                Some(_) => curve_intervals(),
                None => vec![],
            },
        }
    }

    fn grid(&self) -> Result<Grid, Failure> {
        let nodes = |name, extent: f64| {
            let n = extent / self.spacing;
            if !(n >= 0.0 && (n - n.round()).abs() < 1e-6) {
                return Err(Failure::new(format_args!(
                    "--{name} {extent} is no multiple of the spacing {}\n\
                     help: nodes lie a spacing apart; give a multiple, or another --spacing",
                    self.spacing
                )));
            }
            Ok(n.round() as usize + 1)
        };
        Ok(Grid {
            n_along: nodes("length", self.length)?,
            n_across: if self.cable { 1 } else { nodes("width", self.width)? },
            spacing: self.spacing,
            dt: self.dt,
        })
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
        let (grid, protocol) = (self.grid()?, self.protocol());
        let curves = self.restitution.as_deref().map(new_file).transpose()?;
        let outcomes = simulate_table(&self.params, &self.out, &grid, &protocol)?;
        curves.map_or(Ok(()), |file| write_curves(file, &outcomes))
    }
}

/// S2 of the beats of a restitution curve, ms.
pub(super) fn curve_intervals() -> Vec<u32> {
    (200..=600).step_by(20).collect()
}

/// Writes every beat of every strip's curve.
pub(super) fn write_curves(
    file: NewFile,
    outcomes: &[Result<StripOutcome, OutOfRange>],
) -> Result<(), Failure> {
    let rows = outcomes.iter().enumerate().flat_map(|(row, outcome)| {
        let beats = outcome.iter().flat_map(|o| &o.restitution);
        beats.map(move |(s2, beat)| CurveRow::new(row, *s2, *beat))
    });
    Ok(finish_rows(file, &rows.collect::<Vec<_>>())?)
}

/// Runs `protocol` on a strip for each row of `params`, and writes the outcomes to `out`; a row out of
/// range has none.
pub(super) fn simulate_table(
    params: &Path,
    out: &Path,
    grid: &Grid,
    protocol: &Protocol,
) -> Result<Vec<Result<StripOutcome, OutOfRange>>, Failure> {
    let parameters = read_parameters(params)?;
    let file = new_file(out)?;
    let checked: Vec<_> = parameters.iter().map(|p| p.validate().map(|()| p.tissue())).collect();
    let tissues: Vec<_> = checked.iter().flatten().copied().collect();
    let bar = ProgressBar::new(tissues.len() as u64)
        .with_style(ProgressStyle::with_template("{bar:30} {pos}/{len} strips, {eta} left")?);
    bar.tick();
    let mut simulated =
        simulate_strips(&tissues, grid, protocol, &|n| bar.inc(n as u64))?.into_iter();
    bar.finish_and_clear();
    let outcomes: Vec<_> = checked
        .into_iter()
        .map_while(|tissue| match tissue {
            Ok(_) => simulated.next().map(Ok),
            Err(out_of_range) => Some(Err(out_of_range)),
        })
        .collect();
    let numbered = parameters.into_iter().zip(&outcomes).enumerate();
    let rows: Vec<_> = numbered.map(|(i, (p, outcome))| OutcomeRow::new(i, p, outcome)).collect();
    finish_rows(file, &rows)?;
    let absent = rows.iter().filter(|row| row.erp_s3_ms.is_none()).count();
    eprintln!("{} strips, {absent} without ERP_S3, written to {}", rows.len(), out.display());
    let refused = outcomes.iter().filter(|outcome| outcome.is_err()).count();
    if refused > 0 {
        eprintln!(
            "{refused} of them outside the valid ranges: not simulated, the reason is in the last columns"
        );
    }
    Ok(outcomes)
}
