//! The emulators of all five parameters: ERP, and APD90 and CV of a beat S2 ms after the train.
//!
//! S2 acts on a beat through one number r: what the gate has not regained when S2 comes.
//!
//! ```text
//! r = exp(−(S2 − ERP_S2)/tau_open),   1 at the ERP and 0 after a long rest
//! ERP_S2   = e(cv_max, tau_in, tau_out, tau_open, apd_max)
//! ERP_S3   = f(cv_max, tau_in, tau_out, tau_open, r at the S2 of 300 ms)
//! APD90    = g(cv_max, tau_in, tau_out, apd_max, r)
//! CV/cv_max = h(ln(cv_max tau_in), tau_in/tau_out, tau_open, r)
//! ```
//! `cv_max tau_in` is the length of the upstroke, which the strip's spacing resolves more or less
//! well. `tau_in/tau_out` says how excitable the tissue is.
//!
//! Where they are fitted, within the valid ranges of the parameters:
//!
//! - ERP_S2: wherever there is one.
//! - ERP_S3: where ERP_S2 is at most 270 ms.
//! - APD90 and CV: with `cv_max` from 0.3 m/s, and at least 50 ms after ERP_S2.

use super::Emulator;
use crate::num::{Common, Real, Together, exp};

#[path = "five_emulators.rs"]
mod emulators;

/// The S2 of the S1S2S3 protocol, ms.
pub(super) const S2: f64 = 300.0;

/// Below this `cv_max tau_in` (mm) its logarithm goes on straight.
const SHORTEST: f64 = 0.003;

/// ERP under S1S2 (S1 600 ms), ms; `cv_max` in m/s, the other parameters in ms.
#[inline]
pub fn erp_s2<A, B, C, D, E>(
    cv_max: A,
    tau_in: B,
    tau_out: C,
    tau_open: D,
    apd_max: E,
) -> Common<(A, B, C, D, E), 5>
where
    (A, B, C, D, E): Together<5>,
{
    emulators::ERP_S2.mean((cv_max, tau_in, tau_out, tau_open, apd_max).together())
}

/// Standard deviation of an [`erp_s2`], ms.
#[inline]
pub fn erp_s2_sd<A, B, C, D, E>(
    cv_max: A,
    tau_in: B,
    tau_out: C,
    tau_open: D,
    apd_max: E,
) -> Common<(A, B, C, D, E), 5>
where
    (A, B, C, D, E): Together<5>,
{
    emulators::ERP_S2.sd((cv_max, tau_in, tau_out, tau_open, apd_max).together())
}

/// r of a beat `s2` ms after the train, from [`erp_s2`] and `tau_open` in ms.
#[inline]
pub fn unrecovered<A, B, C>(erp_s2: A, tau_open: B, s2: C) -> Common<(A, B, C), 3>
where
    (A, B, C): Together<3>,
{
    let [erp_s2, tau_open, s2] = (erp_s2, tau_open, s2).together();
    exp((erp_s2 - s2) / tau_open)
}

/// ERP under S1S2S3 (S1 600 ms, S2 300 ms), ms. In place of `apd_max` it takes [`erp_s2`]. It is
/// void where this is above 270 ms.
#[inline]
pub fn erp_s3<A, B, C, D, E>(
    cv_max: A,
    tau_in: B,
    tau_out: C,
    tau_open: D,
    erp_s2: E,
) -> Common<(A, B, C, D, E), 5>
where
    (A, B, C, D, E): Together<5>,
{
    let [cv_max, tau_in, tau_out, tau_open, erp_s2] =
        (cv_max, tau_in, tau_out, tau_open, erp_s2).together();
    emulators::ERP_S3.mean([cv_max, tau_in, tau_out, tau_open, unrecovered(erp_s2, tau_open, S2)])
}

/// Standard deviation of an [`erp_s3`], ms.
#[inline]
pub fn erp_s3_sd<A, B, C, D, E>(
    cv_max: A,
    tau_in: B,
    tau_out: C,
    tau_open: D,
    erp_s2: E,
) -> Common<(A, B, C, D, E), 5>
where
    (A, B, C, D, E): Together<5>,
{
    let [cv_max, tau_in, tau_out, tau_open, erp_s2] =
        (cv_max, tau_in, tau_out, tau_open, erp_s2).together();
    emulators::ERP_S3.sd([cv_max, tau_in, tau_out, tau_open, unrecovered(erp_s2, tau_open, S2)])
}

/// APD90 of a beat, ms; `cv_max` in m/s, the other parameters in ms, r from [`unrecovered`].
#[inline]
pub fn apd90<A, B, C, D, E>(
    cv_max: A,
    tau_in: B,
    tau_out: C,
    apd_max: D,
    r: E,
) -> Common<(A, B, C, D, E), 5>
where
    (A, B, C, D, E): Together<5>,
{
    emulators::APD90.mean((cv_max, tau_in, tau_out, apd_max, r).together())
}

/// Standard deviation of an [`apd90`], ms.
#[inline]
pub fn apd90_sd<A, B, C, D, E>(
    cv_max: A,
    tau_in: B,
    tau_out: C,
    apd_max: D,
    r: E,
) -> Common<(A, B, C, D, E), 5>
where
    (A, B, C, D, E): Together<5>,
{
    emulators::APD90.sd((cv_max, tau_in, tau_out, apd_max, r).together())
}

/// Conduction velocity of a beat, m/s; `cv_max` in m/s, the other parameters in ms, r from [`unrecovered`].
#[inline]
pub fn cv<A, B, C, D, E>(
    cv_max: A,
    tau_in: B,
    tau_out: C,
    tau_open: D,
    r: E,
) -> Common<(A, B, C, D, E), 5>
where
    (A, B, C, D, E): Together<5>,
{
    let [cv_max, tau_in, tau_out, tau_open, r] = (cv_max, tau_in, tau_out, tau_open, r).together();
    cv_max * emulators::CV_RATIO.mean(cv_inputs(cv_max, tau_in, tau_out, tau_open, r))
}

/// Standard deviation of a [`cv`], m/s.
#[inline]
pub fn cv_sd<A, B, C, D, E>(
    cv_max: A,
    tau_in: B,
    tau_out: C,
    tau_open: D,
    r: E,
) -> Common<(A, B, C, D, E), 5>
where
    (A, B, C, D, E): Together<5>,
{
    let [cv_max, tau_in, tau_out, tau_open, r] = (cv_max, tau_in, tau_out, tau_open, r).together();
    cv_max * emulators::CV_RATIO.sd(cv_inputs(cv_max, tau_in, tau_out, tau_open, r))
}

/// Inputs of CV over `cv_max`. No tissue has a `cv_max` below 0, but a chain may try one. It gets the inputs of the same number
/// above 0, so that its CV is below 0. If the logarithm went on straight there, CV over `cv_max` would be negative, and CV positive: every
/// measured CV would have a second answer.
#[inline]
pub(super) fn cv_inputs<D: Real>(cv_max: D, tau_in: D, tau_out: D, tau_open: D, r: D) -> [D; 4] {
    let signed = cv_max * tau_in;
    let length = if signed.re() < 0.0 { -signed } else { signed };
    let ln_length = if length.re() > SHORTEST {
        length.ln()
    } else {
        length / SHORTEST + (SHORTEST.ln() - 1.0)
    };
    [ln_length, tau_in / tau_out, tau_open, r]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovery_runs_from_one_at_the_erp_to_nothing() {
        assert!((unrecovered(220.0, 120.0, 220.0) - 1.0).abs() < 1e-12);
        assert!(unrecovered(220.0, 120.0, 600.0) < 0.05);
    }

    #[test]
    fn the_logarithm_goes_on_straight() {
        let ln = |cv_max: f64| cv_inputs(cv_max, 0.01, 10.0, 120.0, 0.1)[0];
        assert!((ln(0.3 + 1e-9) - ln(0.3 - 1e-9)).abs() < 1e-7);
        assert!(((ln(0.3) - ln(0.2)) - (ln(0.1) - ln(0.0))).abs() < 1e-12 && ln(-1.0).is_finite());
    }

    /// A CV that can be measured has one answer: below 0 there is none.
    #[test]
    fn no_cv_max_below_0_has_a_cv() {
        for tau_in in [0.01, 0.05, 0.1, 0.3] {
            for (tau_out, tau_open, r) in [(1.0, 65.0, 0.0), (10.0, 120.0, 0.1), (30.0, 215.0, 0.8)]
            {
                let speed = |k: i32| cv(0.01 * f64::from(k), tau_in, tau_out, tau_open, r);
                let most = (-300..0).map(speed).fold(f64::NEG_INFINITY, f64::max);
                assert!(most < 0.05, "{tau_in} {tau_out} {tau_open} {r}: {most}");
                assert!((speed(-70) + speed(70)).abs() < 1e-12);
            }
        }
    }

    /// Orders of magnitude that physics gives: ERP and APD go with `apd_max`, CV with `cv_max`; what has not recovered is slow and short.
    #[test]
    fn emulators_go_the_way_physics_does() {
        let erp = |apd_max: f64| erp_s2(0.7, 0.05, 10.0, 120.0, apd_max);
        assert!(erp(220.0) > erp(180.0) + 20.0);
        let apd = |r: f64| apd90(0.7, 0.05, 10.0, 200.0, r);
        assert!(apd(0.02) > apd(0.5) + 10.0);
        let speed = |cv_max: f64, r: f64| cv(cv_max, 0.05, 10.0, 120.0, r);
        assert!(speed(0.7, 0.02) > speed(0.7, 0.6) && speed(1.0, 0.1) > 1.2 * speed(0.7, 0.1));
    }
}
