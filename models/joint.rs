//! ERP, APD and CV together: all five parameters over the atrium, from measurements that may lie at different sites.
//!
//! `eplat run models/joint.rs --mesh SHELL.vtk --units mm --data FILE.csv`, with the columns `vertex`, `protocol`
//! (`s1s2`, `s1s2s3`, `apd` or `speed`), `lower` and `upper` of an ERP, `s2_ms` and `value` of an APD90 (ms) or a CV (m/s).
use eplat::prelude::*;

model! {
    /// ERP tells of the sum of what APD and recovery take, APD restitution tells them apart, CV gives its own height
    /// and, with the others, excitability.
    model Joint;

    /// Coupling interval of an APD90 or a CV, at least 50 ms beyond the ERP and up to 600 ms; of an ERP any number.
    column s2_ms [ms];

    field cv_max(x) [m/s] in 0.3..1.5 = m + alpha * gp(Rbf(rho), K = 16) where {
        m     [m/s] ~ Normal(0.8, 0.3);
        alpha [m/s] ~ LogNormal(-2.8, 0.8);
        rho   [mm]  ~ LogNormal(3.9, 0.5);
    }
    /// Of tau_in in ms, which ranges from 0.01 to 0.3.
    field ln_tau_in(x) [1] in -4.6..-1.2 = m + alpha * gp(Rbf(rho), K = 16) where {
        m     [1]  ~ Normal(-2.5, 0.7);
        alpha [1]  ~ LogNormal(-1.7, 0.8);
        rho   [mm] ~ LogNormal(3.9, 0.5);
    }
    field tau_out(x) [ms] in 1.0..30.0 = m + alpha * gp(Rbf(rho), K = 16) where {
        m     [ms] ~ Normal(15.0, 7.0);
        alpha [ms] ~ LogNormal(1.4, 0.8);
        rho   [mm] ~ LogNormal(3.9, 0.5);
    }
    field tau_open(x) [ms] in 65.0..215.0 = m + alpha * gp(Rbf(rho), K = 16) where {
        m     [ms] ~ Normal(130.0, 30.0);
        alpha [ms] ~ LogNormal(2.2, 0.8);
        rho   [mm] ~ LogNormal(3.9, 0.5);
    }
    field apd_max(x) [ms] in 120.0..270.0 = m + alpha * gp(Rbf(rho), K = 16) where {
        m     [ms] ~ Normal(195.0, 40.0);
        alpha [ms] ~ LogNormal(2.9, 0.8);
        rho   [mm] ~ LogNormal(3.9, 0.5);
    }
    param apd_noise [ms]  ~ HalfNormal(10.0);
    param cv_noise  [m/s] ~ HalfNormal(0.1);

    let tau_in(x) [ms] = exp(ln_tau_in(x));
    /// Beyond 270 ms ERP_S3 is void.
    let erp_s2(x) [ms] in 0.0..270.0 = surrogate::five::erp_s2(cv_max(x), tau_in(x), tau_out(x), tau_open(x), apd_max(x));
    let erp_s3(x) [ms] = surrogate::five::erp_s3(cv_max(x), tau_in(x), tau_out(x), tau_open(x), erp_s2(x));
    let sd_s2(x)  [ms] = surrogate::five::erp_s2_sd(cv_max(x), tau_in(x), tau_out(x), tau_open(x), apd_max(x));
    let sd_s3(x)  [ms] = surrogate::five::erp_s3_sd(cv_max(x), tau_in(x), tau_out(x), tau_open(x), erp_s2(x));

    /// What the gate has not regained at S2.
    let r(x)      [1]   = surrogate::five::unrecovered(erp_s2(x), tau_open(x), x.s2_ms);
    let apd90(x)  [ms]  = surrogate::five::apd90(cv_max(x), tau_in(x), tau_out(x), apd_max(x), r(x));
    let sd_apd(x) [ms]  = surrogate::five::apd90_sd(cv_max(x), tau_in(x), tau_out(x), apd_max(x), r(x));
    let cv(x)     [m/s] = surrogate::five::cv(cv_max(x), tau_in(x), tau_out(x), tau_open(x), r(x));
    let sd_cv(x)  [m/s] = surrogate::five::cv_sd(cv_max(x), tau_in(x), tau_out(x), tau_open(x), r(x));

    observe s1s2(x):   Bracket [ms] ~ Widened(TopHat(erp_s2(x)), sd_s2(x));
    observe s1s2s3(x): Bracket [ms] ~ Widened(TopHat(erp_s3(x)), sd_s3(x));
    observe apd(x):    Number [ms]  ~ Widened(Normal(apd90(x), apd_noise), sd_apd(x));
    observe speed(x):  Number [m/s] ~ Widened(Normal(cv(x), cv_noise), sd_cv(x));
}
