//! `erp.rs` of this folder without S1S2S3.
use eplat::prelude::*;

model! {
    /// tau_out and APD_max over the atrium, from ERP_S2 at a few sites.
    model Erp;

    field tau_out(x) [ms] in 1.0..30.0 = m + alpha * gp(authors(Rbf(rho)), K = 32) where {
        m     [ms] ~ Flat;
        alpha [ms] ~ InvGamma(1.0, 5.0);
        rho   [mm] ~ InvGamma(1.01, 64.0);
    }
    field apd_max(x) [ms] in 120.0..270.0 = m + alpha * gp(authors(Rbf(rho)), K = 32) where {
        m     [ms] ~ Flat;
        alpha [ms] ~ InvGamma(1.0, 5.0);
        rho   [mm] ~ InvGamma(1.01, 64.0);
    }

    /// Beyond 280 ms the tissue would not follow the pacing, and the ERP_S3 surrogate is void.
    let erp_s2(x) [ms] in 0.0..280.0 = surrogate::erp_s2(tau_out(x), apd_max(x));
    let erp_s3(x) [ms] = surrogate::erp_s3(tau_out(x), apd_max(x));

    observe s1s2(x): Bracket [ms] ~ TopHat(erp_s2(x));
}
