//! From restitution curves of the strip to emulators of APD90 and CV of a beat S2 ms after the train.
//!
//! Knows the columns of the strip table and of the table of curves.  With `tau_in` and `tau_open` fixed, both follow nearly
//! in a line what the gate has not regained when the beat comes,
//!
//! ```text
//! r = exp(−(S2 − ERP_S2)/tau_open),   1 at the ERP and 0 after a long rest
//! APD90 = f(tau_out, apd_max, r)      CV/cv_max = g(cv_max, tau_out, r)
//! ```

use std::fmt;

use serde::Deserialize;

use super::emulated;
use super::erp_fit::{EMULATOR_HEADER, Emulated};
use super::gp::GpError;
use super::inputs::{ERP_INPUTS, NOMINAL, input_range};
use crate::ep::table::Columns;
use crate::num::Real;

/// Beats less than this after ERP_S2 (ms) are left out: they start late, and APD changes with every ms.
const MARGIN: f64 = 50.0;

/// Strips with a smaller `cv_max` (m/s) are left out: between stimulus and middle the beat lags behind its S2.
const SLOWEST: f64 = 0.3;

/// Of strips with a smaller `cv_max` (m/s) CV is fitted, but not APD90, which depends on that lag.
const LAGGING: f64 = 0.5;

/// Range of r.
const UNRECOVERED: (f64, f64) = (0.0, 0.7);

/// Place of `tau_open` among the parameters.
const TAU_OPEN: usize = 3;

/// r from `tau_out`, `apd_max` and S2, all in ms, with the emulated ERP_S2.
#[inline]
pub fn unrecovered<D: Real>(tau_out: D, apd_max: D, s2: f64) -> D {
    ((emulated::erp_s2(tau_out, apd_max) - s2) / NOMINAL[TAU_OPEN]).exp()
}

/// What is needed of a strip table's row.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[allow(missing_docs, reason = "the columns say what they are")]
pub struct StripRow {
    pub row: usize,
    pub cv_max_m_per_s: f64,
    pub tau_out_ms: f64,
    pub apd_max_ms: f64,
    pub erp_s2_ms: Option<f64>,
}

impl Columns for StripRow {
    const REQUIRED: &'static [&'static str] =
        &["row", "cv_max_m_per_s", "tau_out_ms", "apd_max_ms", "erp_s2_ms"];
}

/// What is needed of a beat of a curve; a beat that failed has empty cells.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[allow(missing_docs, reason = "the columns say what they are")]
pub struct BeatRow {
    pub row: usize,
    pub s2_ms: f64,
    pub cv_m_per_s: Option<f64>,
    pub apd90_ms: Option<f64>,
}

impl Columns for BeatRow {
    const REQUIRED: &'static [&'static str] = &["row", "s2_ms", "cv_m_per_s", "apd90_ms"];
}

/// How many beats were left out, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct BeatsLeftOut {
    /// Of rows that the strip table does not have, or has without ERP_S2.
    strangers: usize,
    /// Of strips that are too slow.
    slow: usize,
    /// Too soon after ERP_S2, or without capture or recovery.
    early: usize,
    /// Valid, but another beat of the strip is fitted.
    siblings: usize,
}

impl fmt::Display for BeatsLeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} not captured or less than {MARGIN} ms after ERP_S2, {} with cv_max below {SLOWEST} m/s ({LAGGING} for APD90), \
             {} of strips without ERP_S2 or not in the table, {} beside another beat of their strip",
            self.early, self.slow, self.strangers, self.siblings
        )
    }
}

/// Emulators over (`tau_out`, `apd_max`, r) and (`cv_max`, `tau_out`, r).
#[derive(Debug, Clone)]
pub struct RestitutionFit {
    /// APD90, ms.
    pub apd90: Emulated<3>,
    /// CV over `cv_max`.
    pub cv_ratio: Emulated<3>,
    /// What was not fitted.
    pub left_out: BeatsLeftOut,
}

/// A beat that is fitted.
struct ValidBeat {
    r: f64,
    apd: f64,
    ratio: f64,
}

impl ValidBeat {
    /// The beat of this strip, or why it is left out.
    fn of(strip: &StripRow, beat: &BeatRow, left_out: &mut BeatsLeftOut) -> Option<Self> {
        let Some(erp_s2) = strip.erp_s2_ms else {
            left_out.strangers += 1;
            return None;
        };
        if strip.cv_max_m_per_s < SLOWEST {
            left_out.slow += 1;
            return None;
        }
        let captured = beat.apd90_ms.zip(beat.cv_m_per_s);
        let Some((apd, cv)) = captured.filter(|_| beat.s2_ms >= erp_s2 + MARGIN) else {
            left_out.early += 1;
            return None;
        };
        let r = unrecovered(strip.tau_out_ms, strip.apd_max_ms, beat.s2_ms);
        Some(Self { r, apd, ratio: cv / strip.cv_max_m_per_s })
    }
}

/// Fits emulators to one valid beat of each strip.
///
/// One, because beats of a strip share what the inputs leave open (`cv_max` in APD90, `apd_max` in CV), which a process
/// through several of them would take for structure: its nugget would be far too small, and so would its errors
/// at beats left out.
///
/// # Errors
/// [`GpError`]
pub fn fit_restitution(strips: &[StripRow], beats: &[BeatRow]) -> Result<RestitutionFit, GpError> {
    let mut left_out = BeatsLeftOut::default();
    let (mut apd90, mut cv_ratio) = (vec![], vec![]);
    for strip in strips {
        let own = beats.iter().filter(|beat| beat.row == strip.row);
        let valid: Vec<ValidBeat> =
            own.filter_map(|beat| ValidBeat::of(strip, beat, &mut left_out)).collect();
        // the golden section spreads the choice over early and late beats
        let place = (0.618_034 * strip.row as f64).fract() * valid.len() as f64;
        if let Some(ValidBeat { r, apd, ratio }) = valid.get(place as usize) {
            left_out.siblings += valid.len() - 1;
            if strip.cv_max_m_per_s >= LAGGING {
                apd90.push(([strip.tau_out_ms, strip.apd_max_ms, *r], *apd));
            }
            cv_ratio.push(([strip.cv_max_m_per_s, strip.tau_out_ms, *r], *ratio));
        }
    }
    let is_known = |beat: &&BeatRow| strips.iter().any(|strip| strip.row == beat.row);
    left_out.strangers += beats.len() - beats.iter().filter(is_known).count();
    let [(_, fastest), tau_out, apd_max] = ERP_INPUTS.map(input_range);
    Ok(RestitutionFit {
        apd90: Emulated::fit(&apd90, [tau_out, apd_max, UNRECOVERED], "ms")?,
        cv_ratio: Emulated::fit(
            &cv_ratio,
            [(SLOWEST, fastest), tau_out, UNRECOVERED],
            "of its maximum",
        )?,
        left_out,
    })
}

impl RestitutionFit {
    /// Both emulators as Rust source.
    pub fn to_rust(&self) -> String {
        let apd90 = format!(
            "APD90 (ms) from `tau_out` (ms), `apd_max` (ms) and r.\n\n{}.",
            self.apd90.quality
        );
        let cv_ratio = format!(
            "CV over `cv_max` from `cv_max` (m/s), `tau_out` (ms) and r.\n\n{}.",
            self.cv_ratio.quality
        );
        String::from(EMULATOR_HEADER)
            + "\n"
            + &self.apd90.emulator.to_rust("APD90", &apd90)
            + "\n"
            + &self.cv_ratio.emulator.to_rust("CV_RATIO", &cv_ratio)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_is_counted_by_reason() {
        let strip = |row, cv_max_m_per_s, erp_s2_ms| StripRow {
            row,
            cv_max_m_per_s,
            tau_out_ms: 10.0,
            apd_max_ms: 180.0,
            erp_s2_ms,
        };
        let strips = [strip(0, 0.8, Some(220.0)), strip(1, 0.2, Some(220.0)), strip(2, 0.8, None)];
        let beat = |row, s2_ms, apd90_ms| BeatRow { row, s2_ms, cv_m_per_s: Some(0.7), apd90_ms };
        let beats = [
            beat(0, 300.0, Some(190.0)),
            beat(0, 269.0, Some(170.0)),
            beat(0, 400.0, None),
            beat(1, 400.0, Some(190.0)),
            beat(2, 400.0, Some(190.0)),
            beat(9, 400.0, Some(190.0)),
        ];
        let mut left_out = BeatsLeftOut::default();
        let valid = |beat: &BeatRow, left_out: &mut BeatsLeftOut| {
            ValidBeat::of(&strips[beat.row.min(2)], beat, left_out).is_some()
        };
        assert_eq!(beats.iter().filter(|beat| valid(beat, &mut left_out)).count(), 1);
        // the last beat is of a row that is not in the table, but here of the third strip
        let expected = BeatsLeftOut { strangers: 2, slow: 1, early: 2, siblings: 0 };
        assert_eq!(left_out, expected);
        let too_few = fit_restitution(&strips, &beats).err();
        assert_eq!(too_few, Some(GpError::TooFewPoints { n_points: 1, n_inputs: 3, needed: 10 }));
    }

    #[test]
    fn recovery_runs_from_one_at_the_erp_to_nothing() {
        let erp = emulated::erp_s2(10.0, 180.0);
        assert!((unrecovered(10.0, 180.0, erp) - 1.0).abs() < 1e-12);
        assert!(unrecovered(10.0, 180.0, 600.0) < 0.05);
    }
}
