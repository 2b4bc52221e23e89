//! CV restitution: the conduction velocity of a beat S2 ms after a train of 600 ms, at sites and several S2.
//!
//! `eplat run models/cv_restitution.rs --mesh SHELL.vtk --units mm --data FILE.csv`, with the columns
//! `vertex`, `s2_ms` and `value` (m/s).
use eplat::prelude::*;

/// In ms.
const TAU_OUT: f64 = 12.0;
const TAU_OPEN: f64 = 120.0;

model! {
    /// CV_max and tau_in over the atrium, from CV at several coupling intervals: the height of the curve and
    /// how steeply it falls. Where it falls, which APD_max decides, is the same everywhere; tau_out and tau_open, which CV
    /// cannot tell from it, are taken as known.
    model CvRestitution;

    /// Coupling interval, at least 50 ms beyond the ERP and up to 600 ms.
    column s2_ms [ms];

    field cv_max(x) [m/s] in 0.3..1.5 = m + alpha * gp(Rbf(rho), K = 24) where {
        m     [m/s] ~ Normal(0.8, 0.3);
        alpha [m/s] ~ LogNormal(-2.8, 0.8);
        rho   [mm]  ~ LogNormal(3.9, 0.5);
    }
    /// Of tau_in in ms, which ranges from 0.01 to 0.3.
    field ln_tau_in(x) [1] in -4.6..-1.2 = m + alpha * gp(Rbf(rho), K = 24) where {
        m     [1]  ~ Normal(-2.5, 0.7);
        alpha [1]  ~ LogNormal(-1.7, 0.8);
        rho   [mm] ~ LogNormal(3.9, 0.5);
    }
    param apd_max [ms]  ~ TruncatedNormal(195.0, 40.0, 120.0, 270.0);
    param noise   [m/s] ~ HalfNormal(0.1);

    let tau_in(x) [ms] = exp(ln_tau_in(x));
    let erp(x) [ms] = surrogate::five::erp_s2(cv_max(x), tau_in(x), TAU_OUT, TAU_OPEN, apd_max);
    /// What the gate has not regained at S2.
    let r(x) [1] = surrogate::five::unrecovered(erp(x), TAU_OPEN, x.s2_ms);
    let cv(x) [m/s] = surrogate::five::cv(cv_max(x), tau_in(x), TAU_OUT, TAU_OPEN, r(x));
    let sd(x) [m/s] = surrogate::five::cv_sd(cv_max(x), tau_in(x), TAU_OUT, TAU_OPEN, r(x));

    observe speed(x): Number [m/s] ~ Widened(Normal(cv(x), noise), sd(x));
}
