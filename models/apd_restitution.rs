//! APD restitution: the APD90 of a beat S2 ms after a train of 600 ms, at sites and several S2.
//!
//! `eplat run models/apd_restitution.rs --mesh SHELL.vtk --units mm --data FILE.csv`, with the columns
//! `vertex`, `s2_ms` and `value` (ms).
use eplat::prelude::*;

model! {
    /// tau_out and APD_max over the atrium, from APD90 at several coupling intervals.
    model ApdRestitution;

    /// Coupling interval, at least 50 ms beyond the ERP and up to 600 ms.
    column s2_ms [ms];

    field tau_out(x) [ms] in 1.0..30.0 = m + alpha * gp(Rbf(rho), K = 24) where {
        m     [ms] ~ Normal(15.0, 7.0);
        alpha [ms] ~ InvGamma(2.0, 5.0);
        rho   [mm] ~ InvGamma(2.0, 64.0);
    }
    field apd_max(x) [ms] in 120.0..270.0 = m + alpha * gp(Rbf(rho), K = 24) where {
        m     [ms] ~ Normal(195.0, 40.0);
        alpha [ms] ~ InvGamma(2.0, 15.0);
        rho   [mm] ~ InvGamma(2.0, 64.0);
    }
    param noise [ms] ~ HalfNormal(10.0);

    let apd90(x) [ms] = surrogate::emulated::apd90(tau_out(x), apd_max(x), x.s2_ms);
    let sd(x)    [ms] = surrogate::emulated::apd90_sd(tau_out(x), apd_max(x), x.s2_ms);

    observe apd(x): Number [ms] ~ Widened(Normal(apd90(x), noise), sd(x));
}
