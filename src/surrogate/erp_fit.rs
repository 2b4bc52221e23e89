//! From strip simulations to the ERP polynomials, and their files.
//!
//! Knows the columns of the strip table and which of them are the inputs:
//! t = `tau_out`, a = `apd_max`.

use std::fmt::Write as _;
use std::ops::Range;

use serde::Deserialize;

use super::cubic::{CubicFit, FitError, TERMS, fit};
use super::design::latin_hypercube;
use crate::ep::Parameters;
use crate::ep::cell::RANGES;
use crate::ep::table::{Columns, rounded};

/// Rows with `start < ERP_S2 ≤ end` (ms) are fitted: beyond it ERP_S3 is discontinuous.
///
/// # Source
/// The upper bound is the paper's (its authors' code has 285), the lower one the authors'.
pub const DEFAULT_FILTER: Range<f64> = 160.0..280.0;

/// Held fixed over the design, ms.
const TAU_IN: f64 = 0.05;

/// Held fixed over the design, ms.
const TAU_OPEN: f64 = 120.0;

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

/// The fits of both ERP, with t = `tau_out` and a = `apd_max` in ms.
#[derive(Debug, Clone, PartialEq)]
pub struct ErpFit {
    /// ERP_S2, ms.
    pub erp_s2: CubicFit,
    /// ERP_S3, ms.
    pub erp_s3: CubicFit,
}

/// Parameter sets that vary `cv_max`, `tau_out` and `apd_max` over their valid ranges.
pub fn design_points(n: usize, seed: u64) -> Vec<Parameters> {
    let [cv_max, _, tau_out, _, apd_max] = RANGES.map(|(_, _, lower, upper)| (lower, upper));
    let points = latin_hypercube(n, &[cv_max, tau_out, apd_max], seed);
    let parameters = |[cv_max, tau_out, apd_max]: [f64; 3]| Parameters {
        cv_max: rounded(cv_max, 1e6),
        tau_in: TAU_IN,
        tau_out: rounded(tau_out, 1e6),
        tau_open: TAU_OPEN,
        apd_max: rounded(apd_max, 1e6),
    };
    points.into_iter().map(parameters).collect()
}

/// Fits both ERP to the rows with `filter.start < ERP_S2 ≤ filter.end`.
///
/// # Errors
/// Too few rows are left, or their inputs do not vary independently.
pub fn fit_erp(rows: &[ErpRow], filter: &Range<f64>) -> Result<ErpFit, FitError> {
    let is_kept = |erp: f64| filter.start < erp && erp <= filter.end;
    let kept: Vec<&ErpRow> = rows.iter().filter(|row| row.erp_s2_ms.is_some_and(is_kept)).collect();
    let points = |erp: fn(&ErpRow) -> Option<f64>| -> Vec<[f64; 3]> {
        kept.iter().filter_map(|row| Some([row.tau_out_ms, row.apd_max_ms, erp(row)?])).collect()
    };
    Ok(ErpFit {
        erp_s2: fit(&points(|row| row.erp_s2_ms))?,
        erp_s3: fit(&points(|row| row.erp_s3_ms))?,
    })
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

    /// The coefficients as the Rust source `src/surrogate/erp_cubic.rs`.
    pub fn to_rust(&self) -> String {
        let mut text = String::from(RUST_HEADER);
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

const RUST_HEADER: &str = "\
//! Generated: the ERP polynomials that the models use.  Do not edit; make it again with
//!
//! ```text
//! eplat surrogate design --n 100 --seed 1 --out design.csv
//! eplat surrogate run --design design.csv --out src/surrogate/erp_design.csv
//! eplat surrogate fit --table src/surrogate/erp_design.csv --out src/surrogate/erp_cubic.rs
//! ```

#![allow(clippy::unreadable_literal, reason = \"generated\")]

use super::cubic::Cubic;
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
        let fit = fit_erp(&rows, &(lowest..highest)).unwrap();
        assert_eq!(fit.erp_s2.n_points, expected);
    }

    #[test]
    fn the_design_lies_in_the_valid_ranges() {
        for parameters in design_points(50, 4) {
            assert_eq!(parameters.validate(), Ok(()));
        }
    }
}
