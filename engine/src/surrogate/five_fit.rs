//! From strips that vary all five parameters to the emulators of [`five`](super::five).
//!
//! Knows the columns of the strip table and of the table of curves.

use std::fmt;

use serde::Deserialize;

use super::Emulator;
use super::erp_fit::{EMULATOR_HEADER, Emulated};
use super::five::{S2, cv_inputs, unrecovered};
use super::gp::GpError;
use super::inputs::{N_INPUTS, input_range};
use crate::ep::table::Columns;

/// Beats less than this after ERP_S2 (ms) are left out: they start late, and their APD changes with
/// every ms.
const MARGIN: f64 = 50.0;

/// Least time (ms) from ERP_S2 to the S2 of an ERP_S3. If they are nearer, that S2 fails or nearly
/// does, and ERP_S3 jumps.
const CONDITIONED: f64 = 30.0;

/// No beat of a strip with a smaller `cv_max` (m/s) is fitted: between stimulus and middle it lags
/// behind its S2.
const SLOWEST: f64 = 0.3;

/// Range of r: of beats, and of the S2 before an S3.
const UNRECOVERED: (f64, f64) = (0.0, 0.8);
const UNRECOVERED_S2: (f64, f64) = (0.05, 0.9);

/// What is needed of a strip table's row.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[allow(missing_docs, reason = "the columns say what they are")]
pub struct StripRow {
    pub row: usize,
    pub cv_max_m_per_s: f64,
    pub tau_in_ms: f64,
    pub tau_out_ms: f64,
    pub tau_open_ms: f64,
    pub apd_max_ms: f64,
    pub erp_s2_ms: Option<f64>,
    pub erp_s3_ms: Option<f64>,
}

impl Columns for StripRow {
    const REQUIRED: &'static [&'static str] = &[
        "row",
        "cv_max_m_per_s",
        "tau_in_ms",
        "tau_out_ms",
        "tau_open_ms",
        "apd_max_ms",
        "erp_s2_ms",
        "erp_s3_ms",
    ];
}

impl StripRow {
    fn inputs(&self) -> [f64; N_INPUTS] {
        [self.cv_max_m_per_s, self.tau_in_ms, self.tau_out_ms, self.tau_open_ms, self.apd_max_ms]
    }
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

/// What was left out, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Strips without ERP_S2.
    absent: usize,
    /// Strips whose ERP_S2 is near the S2 of ERP_S3, or that have no ERP_S3.
    unconditioned: usize,
    /// Beats of rows that the strip table does not have, or has without ERP_S2.
    strangers: usize,
    /// Beats of strips that are too slow.
    slow: usize,
    /// Beats too soon after ERP_S2, or without capture or recovery.
    early: usize,
    /// Valid beats of a strip of which another beat was fitted.
    siblings: usize,
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "left out: {} strips without ERP_S2; of ERP_S3 {} more with ERP_S2 above {} ms or without ERP_S3; of the beats {} not \
             captured or less than {MARGIN} ms after ERP_S2, {} with cv_max below {SLOWEST} m/s, {} of strips without ERP_S2 or \
             not in the table, {} beside another beat of their strip",
            self.absent,
            self.unconditioned,
            S2 - CONDITIONED,
            self.early,
            self.slow,
            self.strangers,
            self.siblings
        )
    }
}

/// The emulators and what was not fitted.
#[derive(Debug, Clone)]
pub struct FiveFit {
    /// ERP_S2, ms.
    pub erp_s2: Emulated<5>,
    /// ERP_S3, ms.
    pub erp_s3: Emulated<5>,
    /// APD90, ms.
    pub apd90: Emulated<5>,
    /// CV over `cv_max`.
    pub cv_ratio: Emulated<4>,
    /// What was not fitted.
    pub left_out: LeftOut,
}

/// Inputs and output of each point.
type Points<const D: usize> = Vec<([f64; D], f64)>;

/// Fits the emulators to strips and to one valid beat of each.
///
/// Only one beat, because the beats of a strip share what the inputs leave open (`tau_open` in
/// APD90, `apd_max` in CV). A process through several of them would take this for structure. Its
/// nugget would be far too small, and so would its errors at beats left out.
///
/// # Errors
/// [`GpError`]
pub fn fit_five(strips: &[StripRow], beats: &[BeatRow]) -> Result<FiveFit, GpError> {
    let mut left_out = LeftOut::default();
    let with: Points<5> =
        strips.iter().filter_map(|strip| Some((strip.inputs(), strip.erp_s2_ms?))).collect();
    left_out.absent = strips.len() - with.len();
    let whole: [(f64, f64); 5] = std::array::from_fn(input_range);
    let erp_s2 = Emulated::fit(&with, whole, "ms")?;
    let conditioned = conditioned(strips, &erp_s2.emulator);
    left_out.unconditioned = with.len() - conditioned.len();
    let (apd, ratio) = beats_of(strips, beats, &erp_s2.emulator, &mut left_out);
    let [(_, fastest), tau_in, tau_out, tau_open, apd_max] = whole;
    let slowest = (SLOWEST, fastest);
    let least = cv_inputs(SLOWEST, tau_in.0, tau_out.1, tau_open.0, UNRECOVERED.0);
    let most = cv_inputs(fastest, tau_in.1, tau_out.0, tau_open.1, UNRECOVERED.1);
    let cv_ranges = std::array::from_fn(|d| (least[d], most[d]));
    let s3_ranges = [whole[0], tau_in, tau_out, tau_open, UNRECOVERED_S2];
    Ok(FiveFit {
        erp_s3: Emulated::fit(&conditioned, s3_ranges, "ms")?,
        apd90: Emulated::fit(&apd, [slowest, tau_in, tau_out, apd_max, UNRECOVERED], "ms")?,
        cv_ratio: Emulated::fit(&ratio, cv_ranges, "of its maximum")?,
        erp_s2,
        left_out,
    })
}

/// ERP_S3 of the strips in which the S2 before it is not marginal.
fn conditioned(strips: &[StripRow], erp_s2: &Emulator<5>) -> Points<5> {
    let point = |strip: &StripRow| {
        strip.erp_s2_ms.filter(|erp| *erp <= S2 - CONDITIONED)?;
        let [cv_max, tau_in, tau_out, tau_open, _] = strip.inputs();
        let r = unrecovered(erp_s2.mean(strip.inputs()), tau_open, S2);
        Some(([cv_max, tau_in, tau_out, tau_open, r], strip.erp_s3_ms?))
    };
    strips.iter().filter_map(point).collect()
}

/// APD90, and CV over `cv_max`, of one beat of each strip.
fn beats_of(
    strips: &[StripRow],
    beats: &[BeatRow],
    erp_s2: &Emulator<5>,
    left_out: &mut LeftOut,
) -> (Points<5>, Points<4>) {
    let (mut apd, mut ratio) = (vec![], vec![]);
    for strip in strips {
        let own = beats.iter().filter(|beat| beat.row == strip.row);
        let valid: Vec<(f64, f64, f64)> =
            own.filter_map(|beat| valid_beat(strip, beat, left_out)).collect();
        // the golden section spreads the choice over early and late beats
        let place = (0.618_034 * strip.row as f64).fract() * valid.len() as f64;
        if let Some((s2, apd90, cv)) = valid.get(place as usize) {
            left_out.siblings += valid.len() - 1;
            let [cv_max, tau_in, tau_out, tau_open, apd_max] = strip.inputs();
            let r = unrecovered(erp_s2.mean(strip.inputs()), tau_open, *s2);
            apd.push(([cv_max, tau_in, tau_out, apd_max, r], *apd90));
            ratio.push((cv_inputs(cv_max, tau_in, tau_out, tau_open, r), cv / cv_max));
        }
    }
    let is_known = |beat: &&BeatRow| strips.iter().any(|strip| strip.row == beat.row);
    left_out.strangers += beats.len() - beats.iter().filter(is_known).count();
    (apd, ratio)
}

/// S2, APD90 and CV of a beat of this strip, or `None` and a count of why it is left out.
fn valid_beat(strip: &StripRow, beat: &BeatRow, left_out: &mut LeftOut) -> Option<(f64, f64, f64)> {
    let Some(erp_s2) = strip.erp_s2_ms else {
        left_out.strangers += 1;
        return None;
    };
    if strip.cv_max_m_per_s < SLOWEST {
        left_out.slow += 1;
        return None;
    }
    let captured = beat.apd90_ms.zip(beat.cv_m_per_s);
    let Some((apd90, cv)) = captured.filter(|_| beat.s2_ms >= erp_s2 + MARGIN) else {
        left_out.early += 1;
        return None;
    };
    Some((beat.s2_ms, apd90, cv))
}

impl FiveFit {
    /// All four as Rust source.
    pub fn to_rust(&self) -> String {
        let all = "`cv_max` (m/s), `tau_in`, `tau_out`";
        let doc = |what: &str, of: &str, quality: &str| format!("{what} from {of}.\n\n{quality}.");
        let erp_s2 = doc(
            "ERP_S2 (ms)",
            &format!("{all}, `tau_open` and `apd_max` (ms)"),
            &self.erp_s2.quality,
        );
        let erp_s3 = doc(
            "ERP_S3 (ms)",
            &format!("{all}, `tau_open` (ms) and r of the S2"),
            &self.erp_s3.quality,
        );
        let apd90 = doc("APD90 (ms)", &format!("{all}, `apd_max` (ms) and r"), &self.apd90.quality);
        let of = "ln(`cv_max` `tau_in`) (mm), `tau_in`/`tau_out`, `tau_open` (ms) and r";
        let cv_ratio = doc("CV over `cv_max`", of, &self.cv_ratio.quality);
        [
            String::from(EMULATOR_HEADER),
            self.erp_s2.emulator.to_rust("ERP_S2", &erp_s2),
            self.erp_s3.emulator.to_rust("ERP_S3", &erp_s3),
            self.apd90.emulator.to_rust("APD90", &apd90),
            self.cv_ratio.emulator.to_rust("CV_RATIO", &cv_ratio),
        ]
        .join("\n")
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
            tau_in_ms: 0.05,
            tau_out_ms: 10.0,
            tau_open_ms: 120.0,
            apd_max_ms: 180.0,
            erp_s2_ms,
            erp_s3_ms: Some(200.0),
        };
        let strips = [strip(0, 0.8, Some(220.0)), strip(1, 0.2, Some(280.0)), strip(2, 0.8, None)];
        let beat = |row, s2_ms, apd90_ms| BeatRow { row, s2_ms, cv_m_per_s: Some(0.7), apd90_ms };
        let beats = [
            beat(0, 300.0, Some(190.0)),
            beat(0, 320.0, Some(195.0)),
            beat(0, 269.0, Some(170.0)),
            beat(0, 400.0, None),
            beat(1, 400.0, Some(190.0)),
            beat(2, 400.0, Some(190.0)),
            beat(9, 400.0, Some(190.0)),
        ];
        let ranges = std::array::from_fn(input_range);
        let constant = |value: f64| vec![([0; 5], value)].into();
        let erp_s2 = Emulator { ranges, mean: constant(220.0), ln_sd: constant(0.0) };
        let mut left_out = LeftOut::default();
        let (apd, ratio) = beats_of(&strips, &beats, &erp_s2, &mut left_out);
        let expected =
            LeftOut { strangers: 2, slow: 1, early: 2, siblings: 1, ..Default::default() };
        assert_eq!(left_out, expected);
        let r = (-80.0f64 / 120.0).exp();
        assert_eq!((apd.len(), ratio.len()), (1, 1));
        assert!((apd[0].0[4] - r).abs() < 1e-12 && (ratio[0].1 - 0.7 / 0.8).abs() < 1e-12);
        // an ERP_S2 of 280 ms is too near the S2 at 300 ms
        let s3 = conditioned(&strips, &erp_s2);
        assert_eq!(s3.len(), 1);
        assert!((s3[0].0[4] - r).abs() < 1e-12);
        let too_few = fit_five(&strips, &beats).err();
        assert_eq!(too_few, Some(GpError::TooFewPoints { n_points: 2, n_inputs: 5, needed: 14 }));
    }
}
