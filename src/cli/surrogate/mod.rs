//! `eplat surrogate …`

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

mod fit;
mod sensitivity;

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::json;

use super::simulate::StripFiles;
use super::voice::{note, tell};
use crate::ep::table::{ParameterRow, finish_rows, new_file};
use crate::ep::{Grid, Protocol};
use crate::error::Failure;
use crate::surrogate::design_points;
use crate::surrogate::inputs::{N_INPUTS, input};
use fit::FitArgs;
use sensitivity::SensitivityArgs;

/// `eplat surrogate …`
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Choose the parameter sets at which the simulator will be run
    ///
    /// An optimised (maximin) Latin hypercube over the valid ranges of the parameters that vary.
    Design(DesignArgs),
    /// Run the strip simulator for every row of a design
    Run(RunArgs),
    /// Fit surrogates to the simulator's outcomes
    ///
    /// ERP_S2 and ERP_S3 become functions of tau_out and apd_max: cubic polynomials, or (--form gp) emulators
    /// that know their own error.  With --curves, ERP, APD90 and CV become emulators of all five parameters.  Every fit tells its
    /// leave-one-out error, and which rows it left out.  A model file reads an emulator's file as a
    /// module: `use surrogate::Emulator; mod NAME;`.
    Fit(FitArgs),
    /// Tell which parameters the outcomes depend on
    ///
    /// Two kinds of shares of an outcome's variance over the rows: that of the smooth function of each parameter in an
    /// additive model (ten penalised B-splines each, smoothing by generalised cross-validation), as in the paper's
    /// figure 2a; and Sobol's first-order and total indices of a Gaussian process.
    Sensitivity(SensitivityArgs),
}

#[derive(Debug, Args)]
pub(super) struct DesignArgs {
    /// Number of parameter sets
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    n: u32,
    /// Parameters that vary, between commas, or `all`: cv_max (0.1–1.5 m/s), tau_in (0.01–0.30 ms), tau_out
    /// (1–30 ms), tau_open (65–215 ms), apd_max (120–270 ms).  The others are 0.7 m/s, 0.05, 10, 120
    /// and 200 ms.  `all` for sensitivity, with --n 500, and for emulators of all, with --n 600
    #[arg(long, value_name = "NAMES", default_value = "cv_max,tau_out,apd_max")]
    vary: String,
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
    /// CSV to write CV and APD of single S2 beats to, S2 = 200, 220 … 600 ms; takes 2.5 times as long
    #[arg(long, value_name = "F.csv")]
    curves: Option<PathBuf>,
}

impl Command {
    pub(super) fn run(self) -> Result<(), Failure> {
        match self {
            Self::Design(args) => design(&args),
            Self::Run(args) => run(&args),
            Self::Fit(args) => args.run(),
            Self::Sensitivity(args) => args.run(),
        }
    }
}

/// Tells where the result is.
fn tell_written(file: &Path) {
    tell("written", format_args!("written to {}", file.display()), json!({ "file": file }));
}

/// Places of the parameters that `names` names.
fn varied(names: &str) -> Result<Vec<usize>, Failure> {
    if names == "all" {
        return Ok((0..N_INPUTS).collect());
    }
    let place = |name: &str| {
        input(name.trim()).ok_or_else(|| {
            Failure::usage(format_args!(
                "--vary {names}: `{name}` is no parameter\n\
                 help: name cv_max, tau_in, tau_out, tau_open or apd_max, between commas, or all"
            ))
        })
    };
    let mut places = names.split(',').map(place).collect::<Result<Vec<_>, _>>()?;
    places.sort_unstable();
    places.dedup();
    Ok(places)
}

fn design(args: &DesignArgs) -> Result<(), Failure> {
    let points = design_points(args.n as usize, &varied(&args.vary)?, args.seed);
    let rows: Vec<ParameterRow> = points.into_iter().map(ParameterRow::from).collect();
    finish_rows(new_file(&args.out)?, &rows)?;
    note(format_args!("{} parameter sets", rows.len()));
    tell_written(&args.out);
    Ok(())
}

fn run(args: &RunArgs) -> Result<(), Failure> {
    let files =
        StripFiles { parameters: &args.design, out: &args.out, curves: args.curves.as_deref() };
    files.simulate(&Grid::default(), &Protocol::default())
}
