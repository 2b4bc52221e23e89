//! ERP calibration as in `erp.rs`, with emulators that know their own error instead of cubics that do not.
use eplat::prelude::*;

model! {
    /// tau_out and APD_max over the atrium; the likelihood allows for what the emulators leave open.
    model ErpEmulated;

    field tau_out(x) [ms] in 1.0..30.0 = m + alpha * gp(Rbf(rho), K = 24) where {
        m     [ms] ~ Normal(15.0, 10.0);
        alpha [ms] ~ LogNormal(1.4, 0.8);
        rho   [mm] ~ LogNormal(3.9, 0.5);
    }
    field apd_max(x) [ms] in 120.0..270.0 = m + alpha * gp(Rbf(rho), K = 24) where {
        m     [ms] ~ Normal(195.0, 50.0);
        alpha [ms] ~ LogNormal(2.9, 0.8);
        rho   [mm] ~ LogNormal(3.9, 0.5);
    }

    /// Beyond 280 ms nothing was fitted, and ERP_S3 jumps.
    let erp_s2(x) [ms] in 0.0..280.0 = surrogate::emulated::erp_s2(tau_out(x), apd_max(x));
    let erp_s3(x) [ms] = surrogate::emulated::erp_s3(tau_out(x), apd_max(x));

    /// Of an ERP at this tau_out and apd_max: conduction, rounding, and what the emulator does not know.
    let sd_s2(x) [ms] = surrogate::emulated::erp_s2_sd(tau_out(x), apd_max(x));
    let sd_s3(x) [ms] = surrogate::emulated::erp_s3_sd(tau_out(x), apd_max(x));

    observe s1s2(x):   Bracket [ms] ~ Widened(TopHat(erp_s2(x)), sd_s2(x));
    observe s1s2s3(x): Bracket [ms] ~ Widened(TopHat(erp_s3(x)), sd_s3(x));
}
