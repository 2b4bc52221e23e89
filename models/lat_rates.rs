//! CV restitution over a surface, from the arrival times of beats at several coupling intervals.
//!
//! `eplat run models/lat_rates.rs --mesh SHELL.vtk --data FILE.csv`, a row per point and beat: `vertex` (or `x, y, z`),
//! `protocol` (lat), `value` (ms), `source`, the vertex at which the beat was paced, `s2_ms`, and `beat`, a name for each
//! activation of the surface.
use eplat::prelude::*;

/// In ms.
const TAU_OUT: f64 = 12.0;
const TAU_OPEN: f64 = 120.0;

model! {
    /// CV_max and tau_in over the surface: how fast activation is after a long rest, and how much slower it gets when
    /// beats come early. When it gets slower, which APD_max decides, is the same everywhere; tau_out and tau_open, which
    /// arrival times cannot tell from it, are taken as known.
    model LatRates;

    /// Interval to the last beat of a train of 600 ms, at least 50 ms beyond the ERP and up to 600 ms.
    column s2_ms [ms];

    field cv_max(x) [m/s] within 0.3..1.5 = m + alpha * gp(Matern52(rho), K = 32) where {
        m     [m/s] ~ Normal(0.8, 0.3);
        alpha [m/s] ~ LogNormal(-1.2, 0.5);
        rho   [mm]  ~ LogNormal(3.4, 0.5);
    }
    /// Of tau_in in ms, which ranges from 0.01 to 0.3.
    field ln_tau_in(x) [1] within -4.6..-1.2 = m + alpha * gp(Matern52(rho), K = 32) where {
        m     [1]  ~ Normal(-2.5, 0.7);
        alpha [1]  ~ LogNormal(-1.0, 0.5);
        rho   [mm] ~ LogNormal(3.4, 0.5);
    }
    param apd_max [ms] ~ TruncatedNormal(195.0, 40.0, 120.0, 270.0);

    let tau_in(x) [ms] = exp(ln_tau_in(x));
    let erp(x) [ms] = surrogate::five::erp_s2(cv_max(x), tau_in(x), TAU_OUT, TAU_OPEN, apd_max);
    /// What the gate has not regained at S2.
    let r(x) [1] = surrogate::five::unrecovered(erp(x), TAU_OPEN, x.s2_ms);
    let cv(x) [m/s] = surrogate::five::cv(cv_max(x), tau_in(x), TAU_OUT, TAU_OPEN, r(x));

    /// When the beat leaves its source, on the clock of the recording.
    param onset(beat) [ms] ~ Normal(0.0, 100.0);
    /// Of fronts, which are slower where they spread: diffusivity over squared velocity, by tau_in and CV_max.
    let thickness(x) [ms] = 3.125 * tau_in(x) * (cv_max(x) / cv(x)) * (cv_max(x) / cv(x));
    let arrival(row) [ms] = eikonal(1.0 / cv(row), 1.0, 0.0, thickness(row); row.source);

    /// Of one point: annotation and place of the electrode.
    param noise [ms] ~ LogNormal(0.7, 0.7);

    observe lat(row): Number [ms] ~ Normal(onset(row) + arrival(row), noise);
}
