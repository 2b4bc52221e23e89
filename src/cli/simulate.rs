//! `eplat simulate …`

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};

use crate::ep::table::{OutcomeRow, finish_rows, new_file, read_parameters};
use crate::ep::{Parameters, Protocol, simulate_strips};
use crate::error::Failure;

/// `eplat simulate …`
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Pace a strip of tissue for every parameter set of a table
    ///
    /// The strip (24.0 × 0.6 mm) is paced from one end with 8 beats at 600 ms.  Conduction velocity
    /// and action potential duration are measured in its middle; the effective refractory periods
    /// are found by bisection, ERP_S2 after the last of these beats and ERP_S3 after a further beat
    /// at 300 ms.  An ERP is the largest whole interval in ms whose stimulus fails.
    Strip(StripArgs),
}

#[derive(Debug, Args)]
pub(super) struct StripArgs {
    /// CSV with the columns cv_max_m_per_s, tau_in_ms, tau_out_ms, tau_open_ms, apd_max_ms
    #[arg(long, value_name = "F.csv")]
    params: PathBuf,
    /// CSV to write: the parameters, then CV, APD90 and ERP; an absent value is an empty cell with
    /// its reason in the last columns
    #[arg(long, value_name = "F.csv")]
    out: PathBuf,
}

impl Command {
    pub(super) fn run(self) -> Result<(), Failure> {
        match self {
            Self::Strip(args) => simulate_table(&args.params, &args.out),
        }
    }
}

/// Runs the default protocol for each row of `params` and writes the outcomes to `out`.
pub(super) fn simulate_table(params: &Path, out: &Path) -> Result<(), Failure> {
    let parameters = read_parameters(params)?;
    let file = new_file(out)?;
    let tissues: Vec<_> = parameters.iter().copied().map(Parameters::tissue).collect();
    let bar = ProgressBar::new(tissues.len() as u64)
        .with_style(ProgressStyle::with_template("{bar:30} {pos}/{len} strips, {eta} left")?);
    bar.tick();
    let outcomes = simulate_strips(&tissues, &Protocol::default(), &|n| bar.inc(n as u64))?;
    bar.finish_and_clear();
    let rows: Vec<_> = parameters
        .iter()
        .zip(&outcomes)
        .enumerate()
        .map(|(i, (parameters, outcome))| OutcomeRow::new(i, *parameters, outcome))
        .collect();
    finish_rows(file, &rows)?;
    let absent = rows.iter().filter(|row| row.erp_s3_ms.is_none()).count();
    eprintln!("{} strips, {absent} without ERP_S3, written to {}", rows.len(), out.display());
    Ok(())
}
