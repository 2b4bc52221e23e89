//! APD restitution: the APD90 of a beat S2 ms after a train of 600 ms, at sites and several S2.
//!
//! `eplat run models/apd_restitution.rs --mesh SHELL.vtk --units mm --data FILE.csv`, with the columns
//! `vertex`, `s2_ms` and `value` (ms).
use eplat::prelude::*;

/// In m/s, and in ms.
const CV_MAX: f64 = 0.8;
const TAU_IN: f64 = 0.1;

model! {
    /// tau_out, tau_open and APD_max over the atrium, from APD90 at several coupling intervals. CV_max and tau_in, which
    /// APD hardly shows, are taken as known.
    model ApdRestitution;

    /// Coupling interval, at least 50 ms beyond the ERP and up to 600 ms.
    column s2_ms [ms];

    field tau_out(x) [ms] in 1.0..30.0 = m + alpha * gp(Rbf(rho), K = 24) where {
        m     [ms] ~ Normal(15.0, 7.0);
        alpha [ms] ~ LogNormal(1.4, 0.8);
        rho   [mm] ~ LogNormal(3.9, 0.5);
    }
    field tau_open(x) [ms] in 65.0..215.0 = m + alpha * gp(Rbf(rho), K = 24) where {
        m     [ms] ~ Normal(130.0, 30.0);
        alpha [ms] ~ LogNormal(2.2, 0.8);
        rho   [mm] ~ LogNormal(3.9, 0.5);
    }
    field apd_max(x) [ms] in 120.0..270.0 = m + alpha * gp(Rbf(rho), K = 24) where {
        m     [ms] ~ Normal(195.0, 40.0);
        alpha [ms] ~ LogNormal(2.9, 0.8);
        rho   [mm] ~ LogNormal(3.9, 0.5);
    }
    param noise [ms] ~ HalfNormal(10.0);

    let erp(x) [ms] = surrogate::five::erp_s2(CV_MAX, TAU_IN, tau_out(x), tau_open(x), apd_max(x));
    /// What the gate has not regained at S2.
    let r(x) [1] = surrogate::five::unrecovered(erp(x), tau_open(x), x.s2_ms);
    let apd90(x) [ms] = surrogate::five::apd90(CV_MAX, TAU_IN, tau_out(x), apd_max(x), r(x));
    let sd(x)    [ms] = surrogate::five::apd90_sd(CV_MAX, TAU_IN, tau_out(x), apd_max(x), r(x));

    observe apd(x): Number [ms] ~ Widened(Normal(apd90(x), noise), sd(x));
}
