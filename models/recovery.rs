//! Recovery time from 10 ms brackets, as a field over a flat patch.
//!
//! `eplat run models/recovery.rs --data FILE.csv --mesh PATCH.vtk --units mm`
use eplat::prelude::*;

model! {
    /// The coupling interval at which the transient recovers, from brackets of it; open ends occur.
    model Recovery;

    field recovery(x) [ms] in 40.0..140.0 = m + alpha * gp(Matern32(rho), K = 24) where {
        m     [ms] ~ Flat;
        alpha [ms] ~ InvGamma(2.0, 10.0);
        rho   [mm] ~ InvGamma(2.0, 10.0);
    }

    /// Of one measurement, beat to beat. Never none: one bracket per site could not rule that out.
    param noise [ms] ~ LogNormal(1.0, 0.5);

    observe s1s2(x): Bracket [ms] ~ Interval(recovery(x), noise);
}
