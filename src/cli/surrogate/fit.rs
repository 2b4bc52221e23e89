//! `eplat surrogate fit`

#![allow(clippy::doc_markdown, reason = "help texts are read on the terminal, without backticks")]

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::super::voice::note;
use super::tell_written;
use crate::ep::table::{read_rows, write_text};
use crate::error::Failure;
use crate::report::figures::contours;
use crate::surrogate::five_fit::{BeatRow, StripRow, fit_five};
use crate::surrogate::{
    CubicFit, DEFAULT_FILTER, ErpRow, Valid, emulate_erp, erp_emulators_to_rust, fit_erp,
};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Form {
    /// A polynomial of degree 3 in t = tau_out and a = apd_max, as in the paper
    Cubic,
    /// The mean and standard deviation of a Gaussian process, for likelihoods that allow for the surrogate's error
    Gp,
}

#[derive(Debug, Args)]
pub(in crate::cli) struct FitArgs {
    /// CSV made by `eplat surrogate run`, or any table with the columns tau_out_ms, apd_max_ms,
    /// erp_s2_ms, erp_s3_ms; an absent ERP is an empty cell
    #[arg(long, value_name = "F.csv")]
    table: PathBuf,
    /// File to write: Rust source for model files (.rs), or of a cubic the coefficients (.csv)
    #[arg(long, value_name = "F.rs|F.csv")]
    out: PathBuf,
    /// What ERP_S2 and ERP_S3 become
    #[arg(long, value_enum, default_value_t = Form::Cubic)]
    form: Form,
    /// Curves made by `eplat surrogate run --curves` from a design that varies all five parameters: emulates ERP_S2,
    /// ERP_S3, APD90 and CV over cv_max as functions of these and of r = exp(−(S2 − ERP_S2)/tau_open)
    #[arg(long, value_name = "F.csv", conflicts_with_all = ["form", "figure", "erp_above", "erp_up_to"])]
    curves: Option<PathBuf>,
    /// Fit only rows with an ERP_S2 above this, ms
    #[arg(long, default_value_t = DEFAULT_FILTER.start, value_name = "MS")]
    erp_above: f64,
    /// Fit only rows with an ERP_S2 up to this, ms; ERP_S3 is discontinuous near 285
    #[arg(long, default_value_t = DEFAULT_FILTER.end, value_name = "MS")]
    erp_up_to: f64,
    /// Picture to write: contours of both ERP over tau_out and apd_max, white where they are void
    #[arg(long, value_name = "F.svg")]
    figure: Option<PathBuf>,
}

impl FitArgs {
    pub(super) fn run(&self) -> Result<(), Failure> {
        if let Some(curves) = &self.curves {
            return self.all_five(curves);
        }
        let table = read_rows::<ErpRow>(&self.table)?;
        let rows: Vec<ErpRow> = table.into_iter().map(|(_, row)| row).collect();
        let filter = self.erp_above..self.erp_up_to;
        let valid = Valid::of(&rows, &filter);
        note(&valid);
        match self.form {
            Form::Cubic => {
                let fit = fit_erp(&rows, &filter)?;
                let is_rust = self.is_rust();
                write_text(&self.out, &if is_rust { fit.to_rust() } else { fit.to_csv() })?;
                report_cubic("ERP_S2", &fit.erp_s2);
                report_cubic("ERP_S3", &fit.erp_s3);
                self.draw(|t, a| [fit.erp_s2.cubic.eval(t, a), fit.erp_s3.cubic.eval(t, a)])?;
            }
            Form::Gp => {
                self.require_rust()?;
                let both = emulate_erp(&valid)?;
                write_text(&self.out, &erp_emulators_to_rust(&both))?;
                let [s2, s3] = &both;
                note(format_args!("  ERP_S2: {}\n  ERP_S3: {}", s2.quality, s3.quality));
                self.draw(|t, a| [s2.emulator.mean([t, a]), s3.emulator.mean([t, a])])?;
            }
        }
        tell_written(&self.out);
        Ok(())
    }

    fn all_five(&self, curves: &Path) -> Result<(), Failure> {
        self.require_rust()?;
        let strips: Vec<StripRow> = read_rows(&self.table)?.into_iter().map(|r| r.1).collect();
        let beats: Vec<BeatRow> = read_rows(curves)?.into_iter().map(|r| r.1).collect();
        let fit = fit_five(&strips, &beats)?;
        write_text(&self.out, &fit.to_rust())?;
        note(format_args!(
            "{} strips, {} beats; {}\n  ERP_S2: {}\n  ERP_S3: {}\n  APD90: {}\n  CV/cv_max: {}",
            strips.len(),
            beats.len(),
            fit.left_out,
            fit.erp_s2.quality,
            fit.erp_s3.quality,
            fit.apd90.quality,
            fit.cv_ratio.quality
        ));
        tell_written(&self.out);
        Ok(())
    }

    fn is_rust(&self) -> bool {
        self.out.extension().is_some_and(|ending| ending == "rs")
    }

    fn require_rust(&self) -> Result<(), Failure> {
        if self.is_rust() {
            return Ok(());
        }
        Err(Failure::usage(format_args!(
            "--out {}: emulators are written as Rust source\nhelp: give a name that ends in .rs",
            self.out.display()
        )))
    }

    /// Draws ERP_S2 and ERP_S3, where ERP_S2 is in the range that was fitted.
    fn draw(&self, erp: impl Fn(f64, f64) -> [f64; 2]) -> Result<(), Failure> {
        let Some(figure) = &self.figure else { return Ok(()) };
        let valid = |t: f64, a: f64, which: usize| {
            let both = erp(t, a);
            (both[0] <= self.erp_up_to).then_some(both[which])
        };
        let s2 = |t: f64, a: f64| valid(t, a, 0);
        let s3 = |t: f64, a: f64| valid(t, a, 1);
        write_text(figure, &contours(&[("ERP_S2 (ms)", &s2), ("ERP_S3 (ms)", &s3)]))?;
        note(format_args!("picture written to {}", figure.display()));
        Ok(())
    }
}

fn report_cubic(name: &str, fit: &CubicFit) {
    note(format_args!(
        "  {name}: {} used, residual RMSE {:.3} ms, max {:.2} ms, leave-one-out RMSE {:.3} ms",
        fit.n_points, fit.rmse, fit.max_error, fit.leave_one_out
    ));
}
