//! From strip simulations to the ERP surrogates, and their files.
//!
//! Knows the columns of the strip table and which of them are the inputs:
//! t = `tau_out`, a = `apd_max`.

use std::fmt::{self, Write as _};
use std::ops::Range;

use serde::Deserialize;

use super::cubic::{CubicFit, FitError, TERMS, fit};
use super::emulator::Emulator;
use super::gp::{Gp, GpError};
use super::inputs::{ERP_INPUTS, input_range};
use crate::ep::table::Columns;

/// Rows with `start < ERP_S2 ≤ end` (ms) are fitted. Above this range ERP_S3 is discontinuous.
///
/// # Source
/// The upper bound is that of the paper's text; the authors' code has 285. The lower bound is the
/// authors'.
pub const DEFAULT_FILTER: Range<f64> = 160.0..280.0;

/// What a fit needs of a strip table's row; an absent ERP is an empty cell.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[allow(missing_docs, reason = "the columns say what they are")]
pub struct ErpRow {
    pub tau_out_ms: f64,
    pub apd_max_ms: f64,
    pub erp_s2_ms: Option<f64>,
    pub erp_s3_ms: Option<f64>,
}

impl Columns for ErpRow {
    const REQUIRED: &'static [&'static str] =
        &["tau_out_ms", "apd_max_ms", "erp_s2_ms", "erp_s3_ms"];
}

/// The valid rows of a table, and how many are not, by reason.
#[derive(Debug, Clone, PartialEq)]
pub struct Valid {
    /// (`tau_out`, `apd_max`, ERP_S2), ms.
    pub erp_s2: Vec<[f64; 3]>,
    /// (`tau_out`, `apd_max`, ERP_S3), ms.
    pub erp_s3: Vec<[f64; 3]>,
    filter: Range<f64>,
    n_rows: usize,
    n_absent: usize,
    n_below: usize,
    n_beyond: usize,
}

impl Valid {
    /// Of `rows`, those with `filter.start < ERP_S2 ≤ filter.end`.
    pub fn of(rows: &[ErpRow], filter: &Range<f64>) -> Self {
        let count = |is: &dyn Fn(f64) -> bool| {
            rows.iter().filter(|row| row.erp_s2_ms.is_some_and(is)).count()
        };
        let is_kept = |erp: f64| filter.start < erp && erp <= filter.end;
        let points = |erp: fn(&ErpRow) -> Option<f64>| -> Vec<[f64; 3]> {
            let kept = rows.iter().filter(|row| row.erp_s2_ms.is_some_and(is_kept));
            kept.filter_map(|row| Some([row.tau_out_ms, row.apd_max_ms, erp(row)?])).collect()
        };
        Self {
            erp_s2: points(|row| row.erp_s2_ms),
            erp_s3: points(|row| row.erp_s3_ms),
            filter: filter.clone(),
            n_rows: rows.len(),
            n_absent: rows.len() - count(&|_| true),
            n_below: count(&|erp| erp <= filter.start),
            n_beyond: count(&|erp| erp > filter.end),
        }
    }
}

impl fmt::Display for Valid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Range { start, end } = self.filter;
        write!(
            f,
            "of {} rows {} are valid; left out: {} with ERP_S2 up to {start} ms, {} above {end} ms, {} without ERP_S2; \
             {} of the valid without ERP_S3",
            self.n_rows,
            self.erp_s2.len(),
            self.n_below,
            self.n_beyond,
            self.n_absent,
            self.erp_s2.len() - self.erp_s3.len()
        )
    }
}

/// The cubics of both ERP, with t = `tau_out` and a = `apd_max` in ms.
#[derive(Debug, Clone, PartialEq)]
pub struct ErpFit {
    /// ERP_S2, ms.
    pub erp_s2: CubicFit,
    /// ERP_S3, ms.
    pub erp_s3: CubicFit,
}

/// Fits cubics to both ERP of the rows with `filter.start < ERP_S2 ≤ filter.end`.
///
/// # Errors
/// Too few rows are left, or their inputs do not vary independently.
pub fn fit_erp(rows: &[ErpRow], filter: &Range<f64>) -> Result<ErpFit, FitError> {
    let valid = Valid::of(rows, filter);
    Ok(ErpFit { erp_s2: fit(&valid.erp_s2)?, erp_s3: fit(&valid.erp_s3)? })
}

impl ErpFit {
    /// The coefficients as CSV with columns `term,erp_s2,erp_s3`.
    pub fn to_csv(&self) -> String {
        let mut text = String::from("term,erp_s2,erp_s3\n");
        let coefficients = self.erp_s2.cubic.0.iter().zip(self.erp_s3.cubic.0);
        for (term, (s2, s3)) in TERMS.iter().zip(coefficients) {
            let _ = writeln!(text, "{term},{s2:e},{s3:e}");
        }
        text
    }

    /// The coefficients as the Rust source `engine/src/surrogate/erp_cubic.rs`.
    pub fn to_rust(&self) -> String {
        let mut text = String::from(CUBIC_HEADER);
        for (name, fit) in [("ERP_S2", &self.erp_s2), ("ERP_S3", &self.erp_s3)] {
            let _ = writeln!(
                text,
                "\n/// {name} in ms.  {} points, residual RMSE {:.3} and max {:.2}, leave-one-out {:.3} ms.\n\
                 #[rustfmt::skip]\npub(super) const {name}: Cubic = Cubic([",
                fit.n_points, fit.rmse, fit.max_error, fit.leave_one_out
            );
            for (coefficient, term) in fit.cubic.0.iter().zip(TERMS) {
                let _ = writeln!(text, "    {coefficient:e}, // {term}");
            }
            text.push_str("]);\n");
        }
        text
    }
}

const CUBIC_HEADER: &str = "\
//! Generated: the ERP polynomials that the models use.  Do not edit; make it again with
//!
//! ```text
//! eplat surrogate design --n 100 --seed 1 --out design.csv
//! eplat surrogate run --design design.csv --out engine/src/surrogate/erp_design.csv
//! eplat surrogate fit --table engine/src/surrogate/erp_design.csv --out engine/src/surrogate/erp_cubic.rs
//! ```

#![allow(clippy::unreadable_literal, reason = \"generated\")]

use super::cubic::Cubic;
";

/// An emulator and how well it predicts.
#[derive(Debug, Clone)]
pub struct Emulated<const D: usize> {
    /// What a model evaluates.
    pub emulator: Emulator<D>,
    /// How good it is, in one line: points, leave-one-out errors, departure from the Gaussian
    /// process.
    pub quality: String,
}

impl<const D: usize> Emulated<D> {
    /// The emulator of a Gaussian process through `points` (inputs, output) over `ranges`; `unit` is the output's.
    ///
    /// # Errors
    /// [`GpError`]
    pub fn fit(
        points: &[([f64; D], f64)],
        ranges: [(f64, f64); D],
        unit: &str,
    ) -> Result<Self, GpError> {
        let x: Vec<Vec<f64>> = points.iter().map(|point| point.0.to_vec()).collect();
        let y: Vec<f64> = points.iter().map(|point| point.1).collect();
        let gp = Gp::fit(&x, &y)?;
        let (emulator, departure) = Emulator::of(&gp, ranges);
        let quality = format!(
            "{} points, leave-one-out RMSE {:.4} {unit} (sd raised {:.2}-fold to it), nugget sd {:.4} {unit}, lengthscales {:.3?}; \
             {} terms of the mean, off by {:.2} sd, and {} of the sd, off by {:.0} %",
            gp.n_points(),
            gp.left_out_rmse(),
            gp.raised(),
            gp.nugget_sd(),
            gp.lengthscales(),
            emulator.mean.len(),
            departure.mean,
            emulator.ln_sd.len(),
            100.0 * departure.sd
        );
        Ok(Self { emulator, quality })
    }
}

/// Emulators of ERP_S2 and ERP_S3 over `tau_out` and `apd_max`, from valid rows.
///
/// # Errors
/// [`GpError`]
pub fn emulate_erp(valid: &Valid) -> Result<[Emulated<2>; 2], GpError> {
    let ranges = [ERP_INPUTS[1], ERP_INPUTS[2]].map(input_range);
    let emulate = |points: &[[f64; 3]]| {
        let points: Vec<_> = points.iter().map(|&[t, a, erp]| ([t, a], erp)).collect();
        Emulated::fit(&points, ranges, "ms")
    };
    Ok([emulate(&valid.erp_s2)?, emulate(&valid.erp_s3)?])
}

/// Both as Rust source.
pub fn erp_emulators_to_rust([s2, s3]: &[Emulated<2>; 2]) -> String {
    let doc = |name: &str, quality: &str| {
        format!("{name} (ms) from `tau_out` and `apd_max` (ms).\n\n{quality}.")
    };
    String::from(EMULATOR_HEADER)
        + "\n"
        + &s2.emulator.to_rust("ERP_S2", &doc("ERP_S2", &s2.quality))
        + "\n"
        + &s3.emulator.to_rust("ERP_S3", &doc("ERP_S3", &s3.quality))
}

/// The head of a file of emulators, made by `eplat surrogate fit`.
pub(super) const EMULATOR_HEADER: &str = "\
//! Generated by `eplat surrogate fit`: emulators.  Do not edit, make it again.
//!
//! In a model file: `use surrogate::Emulator; mod NAME;`, then `NAME::OUTPUT.mean([…])` and `.sd([…])`.

#![allow(clippy::unreadable_literal, reason = \"generated\")]

use super::Emulator;
";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ep::table::read_rows;
    use crate::surrogate::erp_cubic;
    use std::path::Path;

    fn committed_rows() -> Vec<ErpRow> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/surrogate/erp_design.csv");
        read_rows::<ErpRow>(&path).unwrap().into_iter().map(|(_, row)| row).collect()
    }

    #[test]
    fn the_committed_table_gives_the_committed_coefficients() {
        let fit = fit_erp(&committed_rows(), &DEFAULT_FILTER).unwrap();
        let pairs = [(&fit.erp_s2, erp_cubic::ERP_S2), (&fit.erp_s3, erp_cubic::ERP_S3)];
        for (fitted, committed) in pairs {
            for (a, b) in fitted.cubic.0.iter().zip(committed.0) {
                assert!((a - b).abs() <= 1e-9 * b.abs(), "{a} {b}");
            }
            assert!(fitted.rmse < 1.5 && fitted.max_error < 5.0);
        }
    }

    #[test]
    fn the_filter_excludes_its_lower_and_includes_its_upper_bound() {
        let rows = committed_rows();
        let erps: Vec<f64> = rows.iter().filter_map(|row| row.erp_s2_ms).collect();
        let (lowest, highest) = (200.0, 251.0);
        assert!(erps.contains(&lowest) && erps.contains(&highest), "the bounds occur in the table");
        let expected = erps.iter().filter(|&&erp| erp > lowest && erp < highest + 0.5).count();
        let valid = Valid::of(&rows, &(lowest..highest));
        assert_eq!(valid.erp_s2.len(), expected);
        assert_eq!(valid.n_below + valid.n_beyond + valid.n_absent + expected, rows.len());
    }
}
