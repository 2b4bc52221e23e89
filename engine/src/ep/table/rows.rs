//! Rows of the tables of strips.

use serde::{Deserialize, Serialize};

use crate::ep::cell::{OutOfRange, Parameters};
use crate::ep::restitution::Restitution;
use crate::ep::strip::{Absence, Beat, StripOutcome};

/// A row type that knows its columns.
pub trait Columns {
    /// The columns that must be there.
    const REQUIRED: &'static [&'static str];
}

/// One parameter set, with units in the column names.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the fields are those of `Parameters`, each with its unit")]
pub struct ParameterRow {
    pub cv_max_m_per_s: f64,
    pub tau_in_ms: f64,
    pub tau_out_ms: f64,
    pub tau_open_ms: f64,
    pub apd_max_ms: f64,
}

impl Columns for ParameterRow {
    const REQUIRED: &'static [&'static str] =
        &["cv_max_m_per_s", "tau_in_ms", "tau_out_ms", "tau_open_ms", "apd_max_ms"];
}

impl From<Parameters> for ParameterRow {
    fn from(p: Parameters) -> Self {
        Self {
            cv_max_m_per_s: p.cv_max,
            tau_in_ms: p.tau_in,
            tau_out_ms: p.tau_out,
            tau_open_ms: p.tau_open,
            apd_max_ms: p.apd_max,
        }
    }
}

impl From<ParameterRow> for Parameters {
    fn from(row: ParameterRow) -> Self {
        Self {
            cv_max: row.cv_max_m_per_s,
            tau_in: row.tau_in_ms,
            tau_out: row.tau_out_ms,
            tau_open: row.tau_open_ms,
            apd_max: row.apd_max_ms,
        }
    }
}

/// One parameter set and what the strip did with it.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs, reason = "the fields are those of `Parameters`, `Tissue` and `StripOutcome`")]
pub struct OutcomeRow {
    pub row: usize,
    pub cv_max_m_per_s: f64,
    pub tau_in_ms: f64,
    pub tau_out_ms: f64,
    pub tau_open_ms: f64,
    pub apd_max_ms: f64,
    pub diffusivity_mm2_per_ms: f64,
    pub tau_close_ms: f64,
    pub cv_s1_m_per_s: Option<f64>,
    pub apd20_s1_ms: Option<f64>,
    pub apd30_s1_ms: Option<f64>,
    pub apd50_s1_ms: Option<f64>,
    pub apd90_s1_ms: Option<f64>,
    pub erp_s2_ms: Option<u32>,
    pub cv_s2_m_per_s: Option<f64>,
    pub apd20_s2_ms: Option<f64>,
    pub apd30_s2_ms: Option<f64>,
    pub apd50_s2_ms: Option<f64>,
    pub apd90_s2_ms: Option<f64>,
    pub erp_s3_ms: Option<u32>,
    /// Coefficients of CV(S2) and APD90(S2), see [`Restitution`]; empty where no curve was asked for.
    pub cv_restitution_a: Option<f64>,
    pub cv_restitution_b: Option<f64>,
    pub cv_restitution_c: Option<f64>,
    pub cv_restitution_d: Option<f64>,
    pub apd_restitution_a: Option<f64>,
    pub apd_restitution_b: Option<f64>,
    pub apd_restitution_c: Option<f64>,
    pub apd_restitution_d: Option<f64>,
    /// Why ERP_S2 (and, for the S1 beat, everything) is absent; empty where it is not.
    pub erp_s2_absence: Option<String>,
    /// Why ERP_S3 is absent; empty where it is not.
    pub erp_s3_absence: Option<String>,
}

impl OutcomeRow {
    /// The table's row number `row` (from 0): what the strip did, or why it was not simulated.
    pub fn new(
        row: usize,
        parameters: Parameters,
        outcome: &Result<StripOutcome, OutOfRange>,
    ) -> Self {
        let mut new = Self::of_parameters(row, parameters);
        if let Ok(outcome) = outcome {
            new.set_s1(outcome);
            new.set_s2(outcome);
            new.set_curves(outcome);
        }
        let absence = |of: fn(&StripOutcome) -> Result<u32, Absence>| match outcome {
            Ok(outcome) => of(outcome).err().map(|absence| absence.to_string()),
            Err(out_of_range) => out_of_range.to_string().lines().next().map(String::from),
        };
        new.erp_s2_absence = absence(|o| o.erp_s2);
        new.erp_s3_absence = absence(|o| o.erp_s3);
        new
    }

    fn of_parameters(row: usize, parameters: Parameters) -> Self {
        let ParameterRow { cv_max_m_per_s, tau_in_ms, tau_out_ms, tau_open_ms, apd_max_ms } =
            parameters.into();
        let tissue = parameters.tissue();
        Self {
            row,
            cv_max_m_per_s,
            tau_in_ms,
            tau_out_ms,
            tau_open_ms,
            apd_max_ms,
            diffusivity_mm2_per_ms: rounded(tissue.diffusivity, 1e9),
            tau_close_ms: rounded(tissue.tau_close, 1e6),
            ..Self::default()
        }
    }

    fn set_s1(&mut self, outcome: &StripOutcome) {
        if let Ok(beat) = outcome.s1 {
            self.cv_s1_m_per_s = Some(rounded(beat.cv, 1e5));
            [self.apd20_s1_ms, self.apd30_s1_ms, self.apd50_s1_ms, self.apd90_s1_ms] =
                durations(&beat);
        }
        self.erp_s2_ms = outcome.erp_s2.ok();
    }

    fn set_s2(&mut self, outcome: &StripOutcome) {
        if let Ok(beat) = outcome.s2 {
            self.cv_s2_m_per_s = Some(rounded(beat.cv, 1e5));
            [self.apd20_s2_ms, self.apd30_s2_ms, self.apd50_s2_ms, self.apd90_s2_ms] =
                durations(&beat);
        }
        self.erp_s3_ms = outcome.erp_s3.ok();
    }

    fn set_curves(&mut self, outcome: &StripOutcome) {
        let curve = |of: fn(&Beat) -> f64| {
            let fit = Restitution::fit(&outcome.restitution, of);
            let value = |value: fn(&Restitution) -> f64| fit.map(|f| rounded(value(&f), 1e5));
            [value(|f| f.a), value(|f| f.b), value(|f| f.c), value(|f| f.d)]
        };
        [
            self.cv_restitution_a,
            self.cv_restitution_b,
            self.cv_restitution_c,
            self.cv_restitution_d,
        ] = curve(|beat| beat.cv);
        [
            self.apd_restitution_a,
            self.apd_restitution_b,
            self.apd_restitution_c,
            self.apd_restitution_d,
        ] = curve(|beat| beat.apd90);
    }
}

/// APD20, APD30, APD50 and APD90 of a beat, ms, as far as there are.
fn durations(beat: &Beat) -> [Option<f64>; 4] {
    [beat.apd20, beat.apd30, beat.apd50, Some(beat.apd90)].map(|x| Some(rounded(x?, 1e3)))
}

/// One beat of a restitution curve.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs, reason = "the fields are those of `Beat`, each with its unit")]
pub struct CurveRow {
    /// Row of the table of parameters, from 0.
    pub row: usize,
    pub s2_ms: u32,
    pub cv_m_per_s: Option<f64>,
    pub apd20_ms: Option<f64>,
    pub apd30_ms: Option<f64>,
    pub apd50_ms: Option<f64>,
    pub apd90_ms: Option<f64>,
    /// Why there is no beat; empty where there is one.
    pub absence: Option<String>,
}

impl CurveRow {
    /// The beat at `s2` of the table's row number `row` (from 0).
    pub fn new(row: usize, s2: u32, beat: Result<Beat, Absence>) -> Self {
        let [apd20_ms, apd30_ms, apd50_ms, apd90_ms] = beat.as_ref().map_or([None; 4], durations);
        Self {
            row,
            s2_ms: s2,
            cv_m_per_s: beat.ok().map(|b| rounded(b.cv, 1e5)),
            apd20_ms,
            apd30_ms,
            apd50_ms,
            apd90_ms,
            absence: beat.err().map(|absence| absence.to_string()),
        }
    }
}

/// `value` to one part in `per_unit`, so that tables are short to read.
pub fn rounded(value: f64, per_unit: f64) -> f64 {
    (value * per_unit).round() / per_unit
}
