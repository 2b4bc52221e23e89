//! ERP calibration as in `erp.rs`, with fields that vary on two length scales.
//!
//! Kernels without `authors(…)`: the amplitudes are the standard deviations of the fields in ms.
use eplat::prelude::*;

model! {
    /// tau_out and APD_max as a smooth trend over the atrium plus shorter-range variation.
    model ErpMultiscale;

    field tau_out(x) [ms] in 1.0..30.0 = m + alpha * gp(Rbf(rho), K = 24) + beta * gp(Matern52(ell), K = 60) where {
        m     [ms] ~ Flat;
        alpha [ms] ~ HalfNormal(8.0);
        rho   [mm] ~ InvGamma(5.0, 320.0);
        beta  [ms] ~ HalfNormal(2.0);
        ell   [mm] ~ InvGamma(5.0, 80.0);
    }
    field apd_max(x) [ms] in 120.0..270.0 = m + alpha * gp(Rbf(rho), K = 24) + beta * gp(Matern52(ell), K = 60) where {
        m     [ms] ~ Flat;
        alpha [ms] ~ HalfNormal(30.0);
        rho   [mm] ~ InvGamma(5.0, 320.0);
        beta  [ms] ~ HalfNormal(8.0);
        ell   [mm] ~ InvGamma(5.0, 80.0);
    }

    let erp_s2(x) [ms] in 0.0..280.0 = surrogate::erp_s2(tau_out(x), apd_max(x));
    let erp_s3(x) [ms] = surrogate::erp_s3(tau_out(x), apd_max(x));

    observe s1s2(x):   Bracket [ms] ~ TopHat(erp_s2(x));
    observe s1s2s3(x): Bracket [ms] ~ TopHat(erp_s3(x));
}
