//! `eplat surrogate sensitivity`

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;

use super::super::voice::note;
use super::tell_written;
use crate::ep::cell::RANGES;
use crate::ep::table::{read_rows, write_text};
use crate::error::Failure;
use crate::report::figures::main_effects;
use crate::surrogate::inputs::input_range;
use crate::surrogate::{DEFAULT_FILTER, Sensitivity, SensitivityRow, analyse};

#[derive(Debug, Args)]
pub(in crate::cli) struct SensitivityArgs {
    /// CSV made by `eplat surrogate run` from a design of `--vary all --n 500`
    #[arg(long, value_name = "F.csv")]
    table: PathBuf,
    /// CSV to write: a row for each outcome and parameter
    #[arg(long, value_name = "F.csv")]
    out: PathBuf,
    /// Use only rows with an ERP_S2 up to this, ms; ERP_S3 is discontinuous near 285
    #[arg(long, default_value_t = DEFAULT_FILTER.end, value_name = "MS")]
    erp_up_to: f64,
    /// Picture to write: the indices as bars, and how each outcome goes with each parameter
    #[arg(long, value_name = "F.svg")]
    figure: Option<PathBuf>,
}

impl SensitivityArgs {
    pub(super) fn run(&self) -> Result<(), Failure> {
        let table = read_rows::<SensitivityRow>(&self.table)?;
        let rows: Vec<SensitivityRow> = table.into_iter().map(|(_, row)| row).collect();
        let result = analyse(&rows, self.erp_up_to)?;
        write_text(&self.out, &result.to_csv())?;
        note(format_args!(
            "of {} rows left out: {} with ERP_S2 above {} ms, {} without ERP_S2",
            rows.len(),
            result.n_beyond,
            self.erp_up_to,
            result.n_without_erp_s2
        ));
        note(table_of(&result).trim_end());
        if let Some(figure) = &self.figure {
            write_text(figure, &main_effects(&result))?;
            note(format_args!("picture written to {}", figure.display()));
        }
        tell_written(&self.out);
        Ok(())
    }
}

/// The indices as a person reads them.
fn table_of(result: &Sensitivity) -> String {
    let cells =
        |cells: Vec<String>| cells.iter().fold(String::new(), |row, c| row + &format!("{c:>10}"));
    let line = |name: &str, row: Vec<String>| format!("{name:<22}{}\n", cells(row));
    let names = result.inputs.iter().map(|&i| RANGES[i].0.to_owned()).collect();
    let mut text = String::from("\n") + &line("share of variance", names);
    for outcome in &result.outcomes {
        let (gam, digits) = (&outcome.gam, |v: f64| format!("{v:.3}"));
        let additive = gam.smooths.iter().map(|smooth| digits(smooth.index)).collect();
        text += &line(&format!("{} additive", outcome.name), additive);
        text +=
            &line("  Sobol, alone", outcome.sobol.iter().map(|s| digits(s.first.value)).collect());
        text +=
            &line("  Sobol, in all", outcome.sobol.iter().map(|s| digits(s.total.value)).collect());
        let _ = writeln!(
            text,
            "  {} rows; additive model explains {:.3} with {:.1} degrees of freedom\n  \
             Gaussian process off by {:.3} {} at points left out; Sobol over {}",
            gam.n_points,
            gam.r_squared,
            gam.degrees_of_freedom,
            outcome.leave_one_out,
            outcome.unit,
            ranges(&result.inputs, &outcome.sobol_box)
        );
    }
    text + "Sobol: where an outcome is void beyond the limit, over an apd_max that leaves 95 % of the box valid\n"
}

/// The box of Sobol's inputs, in words where it is not the inputs' valid ranges.
fn ranges(inputs: &[usize], sobol_box: &[(f64, f64)]) -> String {
    let trimmed = inputs.iter().zip(sobol_box).filter(|&(&i, range)| input_range(i) != *range);
    let told = trimmed.map(|(&i, (lower, upper))| {
        let (name, unit, ..) = RANGES[i];
        format!("{name} {lower}–{upper} {unit}")
    });
    let told: Vec<String> = told.collect();
    if told.is_empty() { "the whole ranges".into() } else { told.join(", ") }
}
