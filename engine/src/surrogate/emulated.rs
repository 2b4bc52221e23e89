//! The emulators of the ERP model, for `tau_in` = 0.05 ms and `tau_open` = 120 ms. `cv_max` is no
//! input; what this leaves open is in the standard deviation.
//!
//! They are fitted where 160 < ERP_S2 ≤ 280 ms. The emulators of all five parameters
//! ([`five`](super::five)) must be told `cv_max`, and are no closer to the simulator.

use super::Emulator;
use crate::num::{Common, Together};

#[path = "erp_emulator.rs"]
mod erp;

/// ERP under S1S2 (S1 600 ms), ms, from `tau_out` and `apd_max` in ms.
#[inline]
pub fn erp_s2<A, B>(tau_out: A, apd_max: B) -> Common<(A, B), 2>
where
    (A, B): Together<2>,
{
    erp::ERP_S2.mean((tau_out, apd_max).together())
}

/// Standard deviation of an [`erp_s2`], ms.
#[inline]
pub fn erp_s2_sd<A, B>(tau_out: A, apd_max: B) -> Common<(A, B), 2>
where
    (A, B): Together<2>,
{
    erp::ERP_S2.sd((tau_out, apd_max).together())
}

/// ERP under S1S2S3 (S1 600 ms, S2 300 ms), ms, from `tau_out` and `apd_max` in ms. It is void
/// where [`erp_s2`] is above 280.
#[inline]
pub fn erp_s3<A, B>(tau_out: A, apd_max: B) -> Common<(A, B), 2>
where
    (A, B): Together<2>,
{
    erp::ERP_S3.mean((tau_out, apd_max).together())
}

/// Standard deviation of an [`erp_s3`], ms.
#[inline]
pub fn erp_s3_sd<A, B>(tau_out: A, apd_max: B) -> Common<(A, B), 2>
where
    (A, B): Together<2>,
{
    erp::ERP_S3.sd((tau_out, apd_max).together())
}
