//! ERP calibration as in `erp.rs`, with the exact probability of a bracket and a noise that is learnt.
//!
//! A bracket may be open: an empty `upper` where no interval tried failed to be refractory, an empty
//! `lower` where the shortest already captured.
use eplat::prelude::*;

model! {
    /// tau_out and APD_max over the atrium, from ERP brackets whose ends may be open.
    model ErpExact;

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

    let erp_s2(x) [ms] in 0.0..280.0 = surrogate::erp_s2(tau_out(x), apd_max(x));
    let erp_s3(x) [ms] = surrogate::erp_s3(tau_out(x), apd_max(x));

    /// Of one measurement: beat to beat, and the surrogate's own error. Some 1.6 to 4.5 ms.
    param noise [ms] ~ LogNormal(1.0, 0.3);

    observe s1s2(x):   Bracket [ms] ~ Interval(erp_s2(x), noise);
    observe s1s2s3(x): Bracket [ms] ~ Interval(erp_s3(x), noise);
}
