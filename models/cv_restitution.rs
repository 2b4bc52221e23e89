//! CV restitution: the conduction velocity of a beat S2 ms after a train of 600 ms, at sites and several S2.
//!
//! `eplat run models/cv_restitution.rs --mesh SHELL.vtk --units mm --data FILE.csv`, with the columns
//! `vertex`, `s2_ms` and `value` (m/s).
use eplat::prelude::*;

model! {
    /// CV_max and APD_max over the atrium, from CV at several coupling intervals: the height of the curve and
    /// where it falls. tau_out, which CV hardly shows, is the same everywhere.
    model CvRestitution;

    /// Coupling interval, at least 50 ms beyond the ERP and up to 600 ms.
    column s2_ms [ms];

    field cv_max(x) [m/s] in 0.3..1.5 = m + alpha * gp(Rbf(rho), K = 24) where {
        m     [m/s] ~ Normal(0.8, 0.3);
        alpha [m/s] ~ InvGamma(2.0, 0.1);
        rho   [mm]  ~ InvGamma(2.0, 64.0);
    }
    field apd_max(x) [ms] in 120.0..270.0 = m + alpha * gp(Rbf(rho), K = 24) where {
        m     [ms] ~ Normal(195.0, 40.0);
        alpha [ms] ~ InvGamma(2.0, 15.0);
        rho   [mm] ~ InvGamma(2.0, 64.0);
    }
    param tau_out [ms]  ~ TruncatedNormal(15.0, 7.0, 1.0, 30.0);
    param noise   [m/s] ~ HalfNormal(0.1);

    let cv(x) [m/s] = surrogate::emulated::cv(cv_max(x), tau_out, apd_max(x), x.s2_ms);
    let sd(x) [m/s] = surrogate::emulated::cv_sd(cv_max(x), tau_out, apd_max(x), x.s2_ms);

    observe speed(x): Number [m/s] ~ Widened(Normal(cv(x), noise), sd(x));
}
