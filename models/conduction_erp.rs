//! ERP, APD and arrival times together: all five parameters over the surface, from measurements that may lie at
//! different sites.
//!
//! `eplat run models/conduction_erp.rs --mesh SHELL.vtk --data FILE.csv`, with the columns `vertex` (or `x, y, z`),
//! `protocol` (`s1s2`, `s1s2s3`, `apd` or `lat`), `lower` and `upper` of an ERP, `value` of an APD90 or an arrival (ms),
//! `s2_ms`, `source`, the vertex at which the beat was paced (of an ERP or an APD its own), and `beat`, a name for each
//! activation of the surface (of an ERP or an APD any).
use eplat::prelude::*;

model! {
    /// As `joint.rs`, but CV is seen through the arrival times that it makes.
    model ConductionErp;

    /// Interval to the last beat of a train of 600 ms, at least 50 ms beyond the ERP and up to 600 ms; of an ERP any
    /// number.
    column s2_ms [ms];

    field cv_max(x) [m/s] within 0.3..1.5 = m + alpha * gp(Matern52(rho), K = 24) where {
        m     [m/s] ~ Normal(0.8, 0.3);
        alpha [m/s] ~ LogNormal(-1.2, 0.5);
        rho   [mm]  ~ LogNormal(3.4, 0.5);
    }
    /// Of tau_in in ms, which ranges from 0.01 to 0.3.
    field ln_tau_in(x) [1] within -4.6..-1.2 = m + alpha * gp(Matern52(rho), K = 24) where {
        m     [1]  ~ Normal(-2.5, 0.7);
        alpha [1]  ~ LogNormal(-1.0, 0.5);
        rho   [mm] ~ LogNormal(3.4, 0.5);
    }
    field tau_out(x) [ms] within 1.0..30.0 = m + alpha * gp(Matern52(rho), K = 24) where {
        m     [ms] ~ Normal(15.0, 7.0);
        alpha [ms] ~ LogNormal(1.6, 0.5);
        rho   [mm] ~ LogNormal(3.4, 0.5);
    }
    field tau_open(x) [ms] within 65.0..215.0 = m + alpha * gp(Matern52(rho), K = 24) where {
        m     [ms] ~ Normal(130.0, 30.0);
        alpha [ms] ~ LogNormal(2.7, 0.5);
        rho   [mm] ~ LogNormal(3.4, 0.5);
    }
    field apd_max(x) [ms] within 120.0..270.0 = m + alpha * gp(Matern52(rho), K = 24) where {
        m     [ms] ~ Normal(195.0, 40.0);
        alpha [ms] ~ LogNormal(2.7, 0.5);
        rho   [mm] ~ LogNormal(3.4, 0.5);
    }

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

    /// When the beat leaves its source, on the clock of the recording.
    param onset(beat) [ms] ~ Normal(0.0, 100.0);
    /// Of fronts, which are slower where they spread: diffusivity over squared velocity, by tau_in and CV_max.
    let thickness(x) [ms] = 3.125 * tau_in(x) * (cv_max(x) / cv(x)) * (cv_max(x) / cv(x));
    let arrival(row) [ms] = eikonal(1.0 / cv(row), 1.0, 0.0, thickness(row); row.source);

    param apd_noise [ms] ~ HalfNormal(10.0);
    /// Of one arrival: annotation and place of the electrode.
    param lat_noise [ms] ~ LogNormal(0.7, 0.7);

    observe s1s2(x):   Bracket [ms] ~ Widened(TopHat(erp_s2(x)), sd_s2(x));
    observe s1s2s3(x): Bracket [ms] ~ Widened(TopHat(erp_s3(x)), sd_s3(x));
    observe apd(x):    Number [ms]  ~ Widened(Normal(apd90(x), apd_noise), sd_apd(x));
    observe lat(row):  Number [ms]  ~ Normal(onset(row) + arrival(row), lat_noise);
}
