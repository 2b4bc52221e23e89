//! Which of two models predicts the same measurements better.
//!
//! ```text
//! elpd_A − elpd_B = Σᵢ dᵢ,   se = √(n var d)
//! ```
//! # Source
//! Vehtari, Gelman & Gabry 2017, section 5.2; when the standard error is not to be trusted: Sivula, Magnusson,
//! Alonzo Matamoros & Vehtari 2020, "Uncertainty in Bayesian leave-one-out cross-validation based model comparison".

mod error;

use std::fmt::Write as _;
use std::path::Path;

use serde_json::{Value, json};

use super::{Results, RunError};
use crate::diagnostics::standard_error;
use crate::report::{LooRecord, LooRow, read_loo};

pub use error::CompareError;

/// Below this the two models predict alike, and the error of the difference is skewed.
const SMALL_DIFFERENCE: f64 = 4.0;
/// Fewer measurements than this tell too little about the variance of the difference.
const FEW_MEASUREMENTS: usize = 100;
/// Standard errors by which a difference must exceed zero to be called one.
const CLEAR: f64 = 2.0;

/// One of the two runs.
#[derive(Debug)]
struct Side {
    folder: String,
    model: String,
    converged: bool,
    totals: LooRecord,
    /// Ordered by measurement.
    rows: Vec<LooRow>,
}

impl Side {
    fn read(folder: &Path) -> Result<Self, RunError> {
        let results = Results::read(folder)?;
        let converged = results.converged();
        let path = folder.display().to_string();
        let rows = || read_loo(&results.record.own(folder, "loo.csv")?);
        let Some(totals) = results.record.loo.clone() else {
            return Err(CompareError::NoLoo { folder: path }.into());
        };
        let rows = rows()?;
        let side = Self { folder: path, model: results.record.model, converged, totals, rows };
        Ok(side.checked()?)
    }

    /// Puts the measurements in order, and refuses what cannot be compared.
    fn checked(mut self) -> Result<Self, CompareError> {
        let (expected, got) = (self.totals.n_measurements, self.rows.len());
        if got != expected {
            return Err(CompareError::Edited { folder: self.folder, expected, got });
        }
        if let Some(row) = self.rows.iter().find(|row| !row.elpd.is_finite()) {
            let measurement = row.name();
            return Err(CompareError::NoElpd { folder: self.folder, measurement });
        }
        self.rows.sort_by(|a, b| key(a).cmp(&key(b)));
        Ok(self)
    }
}

/// What makes two rows the same measurement.
fn key(row: &LooRow) -> [&str; 3] {
    [&row.measurement, &row.place, &row.observed]
}

/// Two runs on the same measurements, and which predicts them better.
#[derive(Debug)]
pub struct Comparison {
    a: Side,
    b: Side,
    /// `elpd_A − elpd_B`.
    difference: f64,
    /// NaN for a single measurement.
    se: f64,
}

impl Comparison {
    /// Of the runs in two output folders.
    ///
    /// # Errors
    /// [`RunError::NoRun`], [`RunError::Report`] for what cannot be read; [`RunError::Compare`].
    pub fn of(a: &Path, b: &Path) -> Result<Self, RunError> {
        Ok(Self::new(Side::read(a)?, Side::read(b)?)?)
    }

    fn new(a: Side, b: Side) -> Result<Self, CompareError> {
        same_measurements(&a, &b)?;
        let pointwise: Vec<f64> =
            a.rows.iter().zip(&b.rows).map(|(a, b)| a.elpd - b.elpd).collect();
        Ok(Self { a, b, difference: pointwise.iter().sum(), se: standard_error(&pointwise) })
    }

    /// `A` or `B` if it predicts clearly better.
    pub fn better(&self) -> Option<&'static str> {
        let size = self.difference.abs();
        let is_clear = size >= SMALL_DIFFERENCE && size > CLEAR * self.se;
        is_clear.then_some(if self.difference > 0.0 { "A" } else { "B" })
    }

    /// Why the difference or its standard error is not to be trusted.
    pub fn warnings(&self) -> Vec<String> {
        let (n, mut warnings) = (self.a.rows.len(), vec![]);
        for (name, side) in [("A", &self.a), ("B", &self.b)] {
            let LooRecord { n_high_k: high, k_threshold, worst, .. } = &side.totals;
            if *high > 0 {
                warnings.push(format!(
                    "{name}: Pareto k is above {k_threshold:.2} at {high} of {n} measurements, worst {}: its elpd may be far off; \
                     draw more (--draws), or fit again without these measurements and predict them",
                    worst.join(", ")
                ));
            }
            if !side.converged {
                warnings.push(format!(
                    "{name} has not converged: `eplat report {}` says why",
                    side.folder
                ));
            }
        }
        if let Some((a, b)) = self.other_scale() {
            warnings.push(format!(
                "A gives {} the likelihood {}, B {}: for a bracket one may be a density and the other a probability, \
                 which differ by a constant that is no difference in prediction",
                a.name(), a.likelihood, b.likelihood
            ));
        }
        if n < FEW_MEASUREMENTS {
            warnings.push(format!(
                "{n} measurements, fewer than {FEW_MEASUREMENTS}: the standard error is likely too small; \
                 trust a difference only if it is many times larger"
            ));
        }
        if self.difference.abs() < SMALL_DIFFERENCE {
            warnings.push(format!(
                "a difference below {SMALL_DIFFERENCE} is small: the models predict alike, and neither the sign nor the standard error is to be trusted"
            ));
        }
        warnings
    }

    /// The first bracket to which the two models give likelihoods of different names.
    fn other_scale(&self) -> Option<(&LooRow, &LooRow)> {
        let is_bracket = |row: &LooRow| row.observed.contains(' ');
        let mut pairs = self.a.rows.iter().zip(&self.b.rows);
        pairs.find(|(a, b)| is_bracket(a) && a.likelihood != b.likelihood)
    }

    fn conclusion(&self) -> String {
        match self.better() {
            Some(name) => format!("{name} predicts better"),
            None if self.difference.abs() < SMALL_DIFFERENCE => "A and B predict alike".to_owned(),
            None => format!(
                "the difference is within {CLEAR} standard errors: neither is shown to predict better"
            ),
        }
    }

    /// `elpd_A − elpd_B`, and its standard error (NaN for a single measurement).
    pub fn difference(&self) -> [f64; 2] {
        [self.difference, self.se]
    }

    /// The figures of both, and the conclusion.
    pub fn text(&self) -> String {
        let mut text =
            format!("   {:>9} {:>6} {:>6} {:>7}  run\n", "elpd_loo", "se", "p_loo", "high k");
        for (name, side) in [("A", &self.a), ("B", &self.b)] {
            let LooRecord { elpd_loo, se, p_loo, n_high_k, .. } = &side.totals;
            let (model, folder) = (&side.model, &side.folder);
            let _ = writeln!(
                text,
                "{name}  {elpd_loo:>9.1} {se:>6.1} {p_loo:>6.1} {n_high_k:>7}  {model} in {folder}"
            );
        }
        let (difference, se, n) = (self.difference, self.se, self.a.rows.len());
        let _ = write!(
            text,
            "A − B: {difference:.1} ± {se:.1} over {n} measurements; {}",
            self.conclusion()
        );
        for warning in self.warnings() {
            let _ = write!(text, "\nwarning: {warning}");
        }
        text
    }

    /// The same as one object.
    pub fn json(&self) -> Value {
        let warnings = self.warnings();
        json!({
            "a": self.a.json(),
            "b": self.b.json(),
            "n_measurements": self.a.rows.len(),
            "elpd_diff": self.difference,
            "se_diff": self.se,
            "better": self.better(),
            "trustworthy": warnings.is_empty(),
            "warnings": warnings,
        })
    }
}

impl Side {
    fn json(&self) -> Value {
        json!({
            "folder": self.folder,
            "model": self.model,
            "converged": self.converged,
            "loo": self.totals,
        })
    }
}

/// Complains unless both runs have the same measurements; they are in order.
fn same_measurements(a: &Side, b: &Side) -> Result<(), CompareError> {
    if a.rows.len() != b.rows.len() {
        let folders = [a, b].map(|side| side.folder.clone());
        return Err(CompareError::Counts { folders, n: [a.rows.len(), b.rows.len()] });
    }
    let Some((in_a, in_b)) = a.rows.iter().zip(&b.rows).find(|(a, b)| key(a) != key(b)) else {
        return Ok(());
    };
    // Of two sorted lists the smaller of the first that differ is in one only.
    let (row, has, lacks) = if key(in_a) < key(in_b) { (in_a, a, b) } else { (in_b, b, a) };
    Err(CompareError::Measurements {
        measurement: row.name(),
        observed: row.observed.clone(),
        has: has.folder.clone(),
        lacks: lacks.folder.clone(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::LeftOutBy;

    /// A run with these pointwise elpd, nothing wrong with it.
    fn side(folder: &str, elpd: &[f64]) -> Side {
        let row = |(i, elpd): (usize, &f64)| LooRow {
            measurement: "s1s2".into(),
            place: format!("at site {i:03}"),
            likelihood: "TopHat".into(),
            observed: "240 250".into(),
            elpd: *elpd,
            pareto_k: 0.3,
            loo_by: LeftOutBy::Weights,
        };
        let totals = LooRecord {
            elpd_loo: elpd.iter().sum(),
            se: standard_error(elpd),
            p_loo: 2.5,
            n_measurements: elpd.len(),
            k_threshold: 0.7,
            n_high_k: 0,
            n_integrated: 0,
            n_left_out: 0,
            worst: vec![],
        };
        let rows = elpd.iter().enumerate().map(row).collect();
        Side { folder: folder.into(), model: "Erp".into(), converged: true, totals, rows }
    }

    /// 100 measurements that A predicts better by 0.15 ± 0.5 each.
    fn clear() -> (Side, Side) {
        let b: Vec<f64> = (0..100).map(|i| -2.0 + 0.01 * f64::from(i)).collect();
        let better = |(i, b): (usize, &f64)| b + if i % 2 == 0 { 0.65 } else { -0.35 };
        let a: Vec<f64> = b.iter().enumerate().map(better).collect();
        (side("out/a", &a), side("out/b", &b))
    }

    fn compared(change: impl Fn(&mut Side, &mut Side)) -> Comparison {
        let (mut a, mut b) = clear();
        change(&mut a, &mut b);
        Comparison::new(a.checked().unwrap(), b.checked().unwrap()).unwrap()
    }

    #[test]
    fn the_difference_has_the_error_of_its_pointwise_sum() {
        let a = side("out/a", &[-1.0, -2.0, -3.0]);
        let b = side("out/b", &[-2.0, -4.0, -9.0]);
        let comparison = Comparison::new(a, b).unwrap();
        assert!((comparison.difference - 9.0).abs() < 1e-12);
        assert!((comparison.se - 21f64.sqrt()).abs() < 1e-12, "{}", comparison.se);
        assert_eq!(comparison.better(), None, "9 is within two times 4.6");
    }

    #[test]
    fn a_clear_difference_comes_without_a_warning() {
        let comparison = compared(|_, _| ());
        assert_eq!((comparison.better(), comparison.warnings().len()), (Some("A"), 0));
        let json = comparison.json();
        assert_eq!((&json["better"], &json["trustworthy"]), (&json!("A"), &json!(true)));
        insta::assert_snapshot!(comparison.text());
    }

    #[test]
    fn each_reason_for_distrust_is_said() {
        let texts = [
            compared(|a, _| {
                a.totals.n_high_k = 3;
                a.totals.worst = vec!["s1s2 at site 004 (0.92)".into()];
            }),
            compared(|_, b| b.converged = false),
            compared(|_, b| b.rows[5].likelihood = "Interval".into()),
            compared(|a, b| {
                for side in [a, b] {
                    side.rows.truncate(99);
                    side.totals.n_measurements = 99;
                }
            }),
            compared(|a, _| a.rows[0].elpd -= 12.0),
        ];
        let texts = texts.map(|comparison| {
            assert_eq!(comparison.json()["trustworthy"], false);
            comparison.warnings().join("\n")
        });
        assert!(texts.iter().all(|text| text.lines().count() == 1), "{texts:?}");
        insta::assert_snapshot!(texts.join("\n"));
    }

    #[test]
    fn only_the_same_measurements_are_compared_whatever_their_order() {
        assert_eq!(compared(|a, _| a.rows.reverse()).better(), Some("A"));
        let refused = |change: fn(&mut Side)| {
            let (a, mut b) = clear();
            change(&mut b);
            let compare = || Comparison::new(a.checked()?, b.checked()?);
            compare().unwrap_err().to_string()
        };
        let texts = [
            refused(|b| b.rows[7].observed = "250 260".into()),
            refused(|b| {
                b.rows.pop();
                b.totals.n_measurements = 99;
            }),
            refused(|b| b.rows.truncate(50)),
            refused(|b| b.rows[2].elpd = f64::NAN),
        ];
        insta::assert_snapshot!(texts.join("\n\n"));
    }
}
