//! `eplat surrogate …`

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::simulate::simulate_table;
use crate::ep::table::{ParameterRow, finish_rows, new_file, read_rows, write_text};
use crate::ep::{Grid, Protocol};
use crate::error::Failure;
use crate::surrogate::{CubicFit, DEFAULT_FILTER, ErpRow, design_points, fit_erp};

/// `eplat surrogate …`
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Choose the parameter sets at which the simulator will be run
    ///
    /// An optimised Latin hypercube over CV_max (0.1–1.5 m/s), tau_out (1–30 ms) and APD_max
    /// (120–270 ms), with tau_in = 0.05 ms and tau_open = 120 ms.
    Design(DesignArgs),
    /// Run the strip simulator for every row of a design
    Run(RunArgs),
    /// Fit the cubic ERP surrogates to the simulator's outcomes
    ///
    /// ERP_S2 and ERP_S3 become polynomials of degree 3 in t = tau_out and a = APD_max (ms).
    Fit(FitArgs),
}

#[derive(Debug, Args)]
pub(super) struct DesignArgs {
    /// Number of parameter sets
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    n: u32,
    /// Seed; the same seed gives the same design
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// CSV to write
    #[arg(long, value_name = "F.csv")]
    out: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct RunArgs {
    /// CSV made by `eplat surrogate design`, or any table with the same columns
    #[arg(long, value_name = "F.csv")]
    design: PathBuf,
    /// CSV to write: the design's columns, then CV, APD90 and ERP
    #[arg(long, value_name = "F.csv")]
    out: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct FitArgs {
    /// CSV made by `eplat surrogate run`, or any table with the columns tau_out_ms, apd_max_ms,
    /// erp_s2_ms, erp_s3_ms; an absent ERP is an empty cell
    #[arg(long, value_name = "F.csv")]
    table: PathBuf,
    /// File to write: coefficients as CSV, or as Rust source if the name ends in .rs
    #[arg(long, value_name = "F.csv|F.rs")]
    out: PathBuf,
    /// Fit only rows with an ERP_S2 above this, ms
    #[arg(long, default_value_t = DEFAULT_FILTER.start, value_name = "MS")]
    erp_above: f64,
    /// Fit only rows with an ERP_S2 up to this, ms; ERP_S3 is discontinuous near 285
    #[arg(long, default_value_t = DEFAULT_FILTER.end, value_name = "MS")]
    erp_up_to: f64,
}

impl Command {
    pub(super) fn run(self) -> Result<(), Failure> {
        match self {
            Self::Design(args) => design(&args),
            Self::Run(args) => {
                let (grid, protocol) = (Grid::default(), Protocol::default());
                simulate_table(&args.design, &args.out, &grid, &protocol).map(|_| ())
            }
            Self::Fit(args) => fit(&args),
        }
    }
}

fn design(args: &DesignArgs) -> Result<(), Failure> {
    let points = design_points(args.n as usize, args.seed);
    let rows: Vec<ParameterRow> = points.into_iter().map(ParameterRow::from).collect();
    finish_rows(new_file(&args.out)?, &rows)?;
    eprintln!("{} parameter sets written to {}", rows.len(), args.out.display());
    Ok(())
}

fn fit(args: &FitArgs) -> Result<(), Failure> {
    let table = read_rows::<ErpRow>(&args.table)?;
    let rows: Vec<ErpRow> = table.into_iter().map(|(_, row)| row).collect();
    let fit = fit_erp(&rows, &(args.erp_above..args.erp_up_to))?;
    let is_rust = args.out.extension().is_some_and(|ending| ending == "rs");
    let text = if is_rust { fit.to_rust() } else { fit.to_csv() };
    write_text(&args.out, &text)?;
    eprintln!("of {} rows:", rows.len());
    report("ERP_S2", &fit.erp_s2);
    report("ERP_S3", &fit.erp_s3);
    eprintln!("written to {}", args.out.display());
    Ok(())
}

fn report(name: &str, fit: &CubicFit) {
    eprintln!(
        "  {name}: {} used, residual RMSE {:.3} ms, max {:.2} ms, leave-one-out RMSE {:.3} ms",
        fit.n_points, fit.rmse, fit.max_error, fit.leave_one_out
    );
}
