//! Surrogates of the strip simulator: ERP as a cheap, differentiable function of parameters.
//!
//! Knows designs, fits and the polynomials the project made from its own strip simulations; it
//! knows nothing of fields, measurements or sampling.

mod chebyshev;
pub mod cubic;
pub mod design;
pub mod emulated;
pub mod emulator;
mod erp_cubic;
mod erp_fit;
pub mod five;
pub mod five_fit;
pub mod gam;
pub mod gp;
pub mod inputs;
pub mod sensitivity;
pub mod sobol;
mod sparse;

pub use chebyshev::Term;
pub use cubic::{Cubic, CubicFit, FitError};
pub use emulator::{Departure, Emulator};
pub use erp_fit::{
    DEFAULT_FILTER, Emulated, ErpFit, ErpRow, Valid, emulate_erp, erp_emulators_to_rust, fit_erp,
};
pub use gam::{Gam, GamError, fit_gam};
pub use gp::{Gp, GpError, LeftOut};
pub use inputs::{ERP_INPUTS, design_points};
pub use sensitivity::{OutcomeSensitivity, Sensitivity, SensitivityError, SensitivityRow, analyse};
pub use sobol::{Estimate, SobolIndex, sobol};

use crate::num::{Common, Together};

/// ERP under S1S2 (S1 600 ms), ms, from `tau_out` and `apd_max` in ms.
///
/// It is fitted to strip simulations with 160 < ERP_S2 ≤ 280 ms. Outside this range it
/// extrapolates.
#[inline(always)]
pub fn erp_s2<A, B>(tau_out: A, apd_max: B) -> Common<(A, B), 2>
where
    (A, B): Together<2>,
{
    let [tau_out, apd_max] = (tau_out, apd_max).together();
    erp_cubic::ERP_S2.eval(tau_out, apd_max)
}

/// ERP under S1S2S3 (S1 600 ms, S2 300 ms), ms, from `tau_out` and `apd_max` in ms.
///
/// It is a smooth polynomial everywhere, for use inside a model. Where [`erp_s2`] is above 285 ms
/// it means nothing, because the S2 at 300 ms fails or nearly does.
#[inline(always)]
pub fn erp_s3<A, B>(tau_out: A, apd_max: B) -> Common<(A, B), 2>
where
    (A, B): Together<2>,
{
    let [tau_out, apd_max] = (tau_out, apd_max).together();
    erp_cubic::ERP_S3.eval(tau_out, apd_max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn erp_rises_with_apd_max_and_shortens_at_the_premature_beat() {
        for tau_out in [2.0, 10.0, 25.0] {
            assert!(erp_s2(tau_out, 200.0) > erp_s2(tau_out, 180.0) + 10.0);
            assert!(erp_s3(tau_out, 180.0) < erp_s2(tau_out, 180.0));
        }
    }
}
