//! ERP calibration of any number of patients on one atlas surface.
//!
//! The column `patient` says whose a row is; `protocol` is `s1s2` or `s1s2s3` as in `erp.rs`.
use eplat::prelude::*;

model! {
    /// Every patient has fields of their own. Amplitude and lengthscale are common to all, and the means are drawn
    /// towards each other by as much as the patients are alike.
    model ErpPopulation;

    param tau_mean [ms] ~ Normal(12.0, 10.0);
    param tau_sd   [ms] ~ HalfNormal(5.0);
    param apd_mean [ms] ~ Normal(190.0, 50.0);
    param apd_sd   [ms] ~ HalfNormal(25.0);

    hyper smooth {
        rho [mm] ~ LogNormal(3.9, 0.5);
    }
    field tau_out(x, patient) [ms] in 1.0..30.0 = m + alpha * gp(Rbf(rho), K = 24) where smooth {
        m(patient) [ms] ~ Normal(tau_mean, tau_sd);
        alpha      [ms] ~ LogNormal(1.4, 0.8);
    }
    field apd_max(x, patient) [ms] in 120.0..270.0 = m + alpha * gp(Rbf(rho), K = 24) where smooth {
        m(patient) [ms] ~ Normal(apd_mean, apd_sd);
        alpha      [ms] ~ LogNormal(2.9, 0.8);
    }

    let erp_s2(x) [ms] in 0.0..280.0 = surrogate::erp_s2(tau_out(x), apd_max(x));
    let erp_s3(x) [ms] = surrogate::erp_s3(tau_out(x), apd_max(x));

    observe s1s2(x):   Bracket [ms] ~ TopHat(erp_s2(x));
    observe s1s2s3(x): Bracket [ms] ~ TopHat(erp_s3(x));
}
