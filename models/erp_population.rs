//! ERP calibration of three patients on one atlas surface: fields of their own, hyperparameters in common.
//!
//! A row's `protocol` says whose it is: `a_s1s2`, `a_s1s2s3`, `b_s1s2`, … What one patient's sites say
//! about amplitude and lengthscale serves the others; the means are drawn towards each other by as much
//! as they are alike. For more patients, more of the same lines.
use eplat::prelude::*;

model! {
    model ErpPopulation;

    param tau_alpha [ms] ~ InvGamma(1.0, 5.0);
    param tau_rho   [mm] ~ InvGamma(1.01, 64.0);
    param tau_mean  [ms] ~ Normal(12.0, 10.0);
    param tau_sd    [ms] ~ HalfNormal(5.0);
    param apd_alpha [ms] ~ InvGamma(1.0, 5.0);
    param apd_rho   [mm] ~ InvGamma(1.01, 64.0);
    param apd_mean  [ms] ~ Normal(190.0, 50.0);
    param apd_sd    [ms] ~ HalfNormal(25.0);

    field tau_out_a(x) [ms] in 1.0..30.0 = m + tau_alpha * gp(authors(Rbf(tau_rho)), K = 24) where {
        m [ms] ~ Normal(tau_mean, tau_sd);
    }
    field tau_out_b(x) [ms] in 1.0..30.0 = m + tau_alpha * gp(authors(Rbf(tau_rho)), K = 24) where {
        m [ms] ~ Normal(tau_mean, tau_sd);
    }
    field tau_out_c(x) [ms] in 1.0..30.0 = m + tau_alpha * gp(authors(Rbf(tau_rho)), K = 24) where {
        m [ms] ~ Normal(tau_mean, tau_sd);
    }
    field apd_max_a(x) [ms] in 120.0..270.0 = m + apd_alpha * gp(authors(Rbf(apd_rho)), K = 24) where {
        m [ms] ~ Normal(apd_mean, apd_sd);
    }
    field apd_max_b(x) [ms] in 120.0..270.0 = m + apd_alpha * gp(authors(Rbf(apd_rho)), K = 24) where {
        m [ms] ~ Normal(apd_mean, apd_sd);
    }
    field apd_max_c(x) [ms] in 120.0..270.0 = m + apd_alpha * gp(authors(Rbf(apd_rho)), K = 24) where {
        m [ms] ~ Normal(apd_mean, apd_sd);
    }

    let erp_s2_a(x) [ms] = surrogate::erp_s2(tau_out_a(x), apd_max_a(x));
    let erp_s3_a(x) [ms] = surrogate::erp_s3(tau_out_a(x), apd_max_a(x));
    let erp_s2_b(x) [ms] = surrogate::erp_s2(tau_out_b(x), apd_max_b(x));
    let erp_s3_b(x) [ms] = surrogate::erp_s3(tau_out_b(x), apd_max_b(x));
    let erp_s2_c(x) [ms] = surrogate::erp_s2(tau_out_c(x), apd_max_c(x));
    let erp_s3_c(x) [ms] = surrogate::erp_s3(tau_out_c(x), apd_max_c(x));

    observe a_s1s2(x):   Bracket [ms] ~ TopHat(erp_s2_a(x));
    observe a_s1s2s3(x): Bracket [ms] ~ TopHat(erp_s3_a(x));
    observe b_s1s2(x):   Bracket [ms] ~ TopHat(erp_s2_b(x));
    observe b_s1s2s3(x): Bracket [ms] ~ TopHat(erp_s3_b(x));
    observe c_s1s2(x):   Bracket [ms] ~ TopHat(erp_s2_c(x));
    observe c_s1s2s3(x): Bracket [ms] ~ TopHat(erp_s3_c(x));
}
