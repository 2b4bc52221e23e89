//! Which parameters an outcome of the strip depends on: additive-model indices and Sobol indices.
//!
//! Knows the columns of the strip table; it knows nothing of fields or measurements.

use std::fmt::Write as _;

use crate::random::procedure;
use serde::Deserialize;
use thiserror::Error;

use super::design::random_hypercube;
use super::gam::{Gam, GamError, fit_gam};
use super::gp::{Gp, GpError};
use super::inputs::{N_INPUTS, input_range};
use super::sobol::{SobolIndex, sobol};
use crate::ep::cell::RANGES;
use crate::ep::table::Columns;

/// At most this share of the box of Sobol's inputs may be void.
const VOID_SHARE: f64 = 0.05;

/// Number of points of the box at which its void share is counted.
const N_PROBES: usize = 2000;

/// Place of `apd_max` among the parameters. Its range is cut where too much of the box is void.
const APD_MAX: usize = 4;

/// What the analysis needs of a strip table's row; an absent outcome is an empty cell, or no column at all.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[allow(missing_docs, reason = "the columns say what they are")]
pub struct SensitivityRow {
    pub cv_max_m_per_s: f64,
    pub tau_in_ms: f64,
    pub tau_out_ms: f64,
    pub tau_open_ms: f64,
    pub apd_max_ms: f64,
    pub erp_s2_ms: Option<f64>,
    #[serde(default)]
    pub erp_s3_ms: Option<f64>,
    #[serde(default)]
    pub cv_s1_m_per_s: Option<f64>,
    #[serde(default)]
    pub apd90_s1_ms: Option<f64>,
    #[serde(default)]
    pub cv_s2_m_per_s: Option<f64>,
    #[serde(default)]
    pub apd90_s2_ms: Option<f64>,
}

impl Columns for SensitivityRow {
    const REQUIRED: &'static [&'static str] =
        &["cv_max_m_per_s", "tau_in_ms", "tau_out_ms", "tau_open_ms", "apd_max_ms", "erp_s2_ms"];
}

impl SensitivityRow {
    /// The parameters in the order of [`RANGES`].
    fn inputs(&self) -> [f64; N_INPUTS] {
        [self.cv_max_m_per_s, self.tau_in_ms, self.tau_out_ms, self.tau_open_ms, self.apd_max_ms]
    }
}

/// An outcome: its name, its unit, whether it is void where ERP_S2 is above the limit, and its
/// cell.
pub type Output = (&'static str, &'static str, bool, fn(&SensitivityRow) -> Option<f64>);

/// The outcomes that are analysed where a table has them.
pub const OUTPUTS: [Output; 6] = [
    ("ERP_S2", "ms", false, |row| row.erp_s2_ms),
    ("ERP_S3", "ms", true, |row| row.erp_s3_ms),
    ("CV_S1", "m/s", false, |row| row.cv_s1_m_per_s),
    ("APD90_S1", "ms", false, |row| row.apd90_s1_ms),
    ("CV_S2", "m/s", true, |row| row.cv_s2_m_per_s),
    ("APD90_S2", "ms", true, |row| row.apd90_s2_ms),
];

/// The analysis of a table.
#[derive(Debug, Clone)]
pub struct Sensitivity {
    /// The parameters that vary, as places in [`RANGES`].
    pub inputs: Vec<usize>,
    /// Rows without ERP_S2.
    pub n_without_erp_s2: usize,
    /// Rows with ERP_S2 above the limit.
    pub n_beyond: usize,
    /// Each outcome that the table has.
    pub outcomes: Vec<OutcomeSensitivity>,
}

/// How one outcome depends on the inputs.
#[derive(Debug, Clone)]
pub struct OutcomeSensitivity {
    /// Its name.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// The additive model.
    pub gam: Gam,
    /// Root mean square error of the Gaussian process at points left out, in the outcome's unit.
    pub leave_one_out: f64,
    /// Sobol indices of the Gaussian process over `sobol_box`.
    pub sobol: Vec<SobolIndex>,
    /// The box for these indices: over which values each input varies, in its unit.
    pub sobol_box: Vec<(f64, f64)>,
}

/// A table that cannot be analysed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum SensitivityError {
    /// Every parameter is the same on all rows.
    #[error(
        "no parameter varies over the rows\nhelp: make the table from `eplat surrogate design --vary all --n 500`"
    )]
    NothingVaries,
    /// No box can be found of which 95 % is valid.
    #[error(
        "ERP_S2 is above the limit in most of the inputs' ranges\nhelp: give a wider --erp-up-to, or a design with smaller apd_max"
    )]
    Void,
    /// One outcome's additive model.
    #[error("{output}: {error}")]
    Gam {
        /// The outcome.
        output: &'static str,
        /// What is wrong.
        error: GamError,
    },
    /// One outcome's Gaussian process.
    #[error("{output}: {error}")]
    Gp {
        /// The outcome.
        output: &'static str,
        /// What is wrong.
        error: GpError,
    },
}

/// Analyses a table: additive models over the rows with ERP_S2 up to `limit` (ms), and Sobol
/// indices over boxes.
///
/// Beyond the limit the S2 at 300 ms fails and ERP_S3 jumps. Sobol indices need inputs that vary
/// independently over a box, and the valid region is no box. So, for outcomes of or after that S2,
/// the upper end of `apd_max` is lowered until ERP_S2 stays below `limit` in 95 % of the box. The
/// other outcomes are smooth over all rows and have the whole box.
///
/// # Errors
/// [`SensitivityError`]
pub fn analyse(rows: &[SensitivityRow], limit: f64) -> Result<Sensitivity, SensitivityError> {
    let varies = |d: &usize| {
        rows.iter().any(|row| row.inputs()[*d].to_bits() != rows[0].inputs()[*d].to_bits())
    };
    let inputs: Vec<usize> = (0..N_INPUTS).filter(varies).collect();
    if inputs.is_empty() {
        return Err(SensitivityError::NothingVaries);
    }
    let with: Vec<&SensitivityRow> = rows.iter().filter(|row| row.erp_s2_ms.is_some()).collect();
    let is_valid = |row: &&SensitivityRow| row.erp_s2_ms.is_some_and(|erp| erp <= limit);
    let valid: Vec<&SensitivityRow> = with.iter().copied().filter(is_valid).collect();
    let whole: Vec<(f64, f64)> = inputs.iter().map(|&d| input_range(d)).collect();
    let trimmed = valid_box(&with, &inputs, limit);
    let mut outcomes = vec![];
    for output in OUTPUTS {
        let (x, y) = points(&valid, &inputs, output);
        if y.is_empty() {
            continue;
        }
        let (name, unit, can_be_void, _) = output;
        let gam = fit_gam(&x, &y).map_err(|error| SensitivityError::Gam { output: name, error })?;
        let (over, sobol_box) =
            if can_be_void { (&valid, trimmed.clone()?) } else { (&with, whole.clone()) };
        let (gp, leave_one_out) = process(over, &inputs, output)?;
        let sobol = sobol(|u| gp.mean(&within(u, &sobol_box)), inputs.len(), 1);
        outcomes.push(OutcomeSensitivity { name, unit, gam, leave_one_out, sobol, sobol_box });
    }
    let (n_without_erp_s2, n_beyond) = (rows.len() - with.len(), with.len() - valid.len());
    Ok(Sensitivity { inputs, n_without_erp_s2, n_beyond, outcomes })
}

/// Inputs and output of the rows that have it.
fn points(
    rows: &[&SensitivityRow],
    inputs: &[usize],
    (.., cell): Output,
) -> (Vec<Vec<f64>>, Vec<f64>) {
    let of = |row: &SensitivityRow| inputs.iter().map(|&d| row.inputs()[d]).collect();
    rows.iter().filter_map(|row| Some((of(row), cell(row)?))).unzip()
}

/// A Gaussian process through `output` at `rows`, and its root mean square error at points left out.
fn process(
    rows: &[&SensitivityRow],
    inputs: &[usize],
    output: Output,
) -> Result<(Gp, f64), SensitivityError> {
    let (x, y) = points(rows, inputs, output);
    let gp =
        Gp::smooth(&x, &y).map_err(|error| SensitivityError::Gp { output: output.0, error })?;
    let leave_one_out = gp.left_out_rmse();
    Ok((gp, leave_one_out))
}

/// The point `u` of the unit cube in `ranges`.
fn within(u: &[f64], ranges: &[(f64, f64)]) -> Vec<f64> {
    u.iter().zip(ranges).map(|(u, (lower, upper))| lower + u * (upper - lower)).collect()
}

/// The inputs' valid ranges. That of `apd_max` goes only as far up as ERP_S2 stays up to `limit`.
fn valid_box(
    rows: &[&SensitivityRow],
    inputs: &[usize],
    limit: f64,
) -> Result<Vec<(f64, f64)>, SensitivityError> {
    let (erp_s2, _) = process(rows, inputs, OUTPUTS[0])?;
    let mut ranges: Vec<(f64, f64)> = inputs.iter().map(|&d| input_range(d)).collect();
    let probes = random_hypercube(N_PROBES, inputs.len(), &mut procedure(1));
    let is_void = |ranges: &[(f64, f64)]| {
        let void = probes.iter().filter(|u| erp_s2.mean(&within(u, ranges)) > limit).count();
        void as f64 > VOID_SHARE * N_PROBES as f64
    };
    let shrinking = inputs.iter().position(|&d| d == APD_MAX);
    while is_void(&ranges) {
        let d = shrinking.ok_or(SensitivityError::Void)?;
        ranges[d].1 -= 1.0;
        if ranges[d].1 <= ranges[d].0 {
            return Err(SensitivityError::Void);
        }
    }
    Ok(ranges)
}

impl Sensitivity {
    /// One row for each outcome and input, as CSV.
    pub fn to_csv(&self) -> String {
        let mut text = String::from(
            "output,input,gam_index,sobol_first,sobol_first_se,sobol_total,sobol_total_se,n_rows\n",
        );
        for outcome in &self.outcomes {
            let indices = outcome.gam.smooths.iter().zip(&outcome.sobol);
            for (&input, (smooth, s)) in self.inputs.iter().zip(indices) {
                let _ = writeln!(
                    text,
                    "{},{},{:.4},{:.4},{:.4},{:.4},{:.4},{}",
                    outcome.name,
                    RANGES[input].0,
                    smooth.index,
                    s.first.value,
                    s.first.error,
                    s.total.value,
                    s.total.error,
                    outcome.gam.n_points
                );
            }
        }
        text
    }
}
