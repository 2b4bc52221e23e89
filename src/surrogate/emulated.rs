//! The emulators that ship: ERP and restitution with `tau_in` = 0.05 ms and `tau_open` = 120 ms, each with the standard
//! deviation of an outcome at given inputs.
//!
//! Fitted where the outcome exists: 160 < ERP_S2 ≤ 280 ms; beats at least 50 ms after ERP_S2, with
//! `cv_max` from 0.3 m/s (CV) and 0.5 m/s (APD90).

use super::Emulator;
use super::restitution_fit::unrecovered;
use crate::num::Real;

#[path = "erp_emulator.rs"]
mod erp;
#[path = "restitution_emulator.rs"]
mod restitution;

/// ERP under S1S2 (S1 600 ms), ms, from `tau_out` and `apd_max` in ms.
#[inline]
pub fn erp_s2<D: Real>(tau_out: D, apd_max: D) -> D {
    erp::ERP_S2.mean([tau_out, apd_max])
}

/// Standard deviation of an [`erp_s2`], ms.
#[inline]
pub fn erp_s2_sd<D: Real>(tau_out: D, apd_max: D) -> D {
    erp::ERP_S2.sd([tau_out, apd_max])
}

/// ERP under S1S2S3 (S1 600 ms, S2 300 ms), ms, from `tau_out` and `apd_max` in ms; void where [`erp_s2`] is above 280.
#[inline]
pub fn erp_s3<D: Real>(tau_out: D, apd_max: D) -> D {
    erp::ERP_S3.mean([tau_out, apd_max])
}

/// Standard deviation of an [`erp_s3`], ms.
#[inline]
pub fn erp_s3_sd<D: Real>(tau_out: D, apd_max: D) -> D {
    erp::ERP_S3.sd([tau_out, apd_max])
}

/// APD90 of a beat `s2` ms after the S1 train, ms, from `tau_out` and `apd_max` in ms.
#[inline]
pub fn apd90<D: Real>(tau_out: D, apd_max: D, s2: f64) -> D {
    restitution::APD90.mean([tau_out, apd_max, unrecovered(tau_out, apd_max, s2)])
}

/// Standard deviation of an [`apd90`], ms.
#[inline]
pub fn apd90_sd<D: Real>(tau_out: D, apd_max: D, s2: f64) -> D {
    restitution::APD90.sd([tau_out, apd_max, unrecovered(tau_out, apd_max, s2)])
}

/// Conduction velocity of a beat `s2` ms after the S1 train, m/s, from `cv_max` in m/s, `tau_out` and `apd_max` in ms.
#[inline]
pub fn cv<D: Real>(cv_max: D, tau_out: D, apd_max: D, s2: f64) -> D {
    let inputs = [cv_max, tau_out, unrecovered(tau_out, apd_max, s2)];
    cv_max * restitution::CV_RATIO.mean(inputs)
}

/// Standard deviation of a [`cv`], m/s.
#[inline]
pub fn cv_sd<D: Real>(cv_max: D, tau_out: D, apd_max: D, s2: f64) -> D {
    let inputs = [cv_max, tau_out, unrecovered(tau_out, apd_max, s2)];
    cv_max * restitution::CV_RATIO.sd(inputs)
}
