//! A map of arrival times, and the conduction velocity that it tells of each place.
//!
//! `eplat run models/lat_local.rs --mesh SHELL.vtk --data FILE.csv`, a row per point: `vertex` (or `x, y, z`) and `value` (ms).
//! Where activation starts need not be known. Where fronts meet or break through, arrivals are flat, and the velocity
//! is more than any of tissue: such draws are left out.
use eplat::prelude::*;

model! {
    /// Arrival times are a smooth map, whatever activation does between the points.
    model LatLocal;

    field arrival(x) [ms] = m + alpha * gp(Matern52(rho), K = 128) where {
        m     [ms] ~ Flat;
        alpha [ms] ~ HalfNormal(60.0);
        rho   [mm] ~ LogNormal(3.4, 0.5);
    }
    let steepness(x) [ms/mm] = gradient(arrival(x));
    let velocity(x) [m/s] in 0.0..3.0 = 1.0 / steepness(x);

    /// Of one point: annotation and place of the electrode.
    param noise [ms] ~ LogNormal(0.7, 0.7);

    observe lat(x): Number [ms] ~ Normal(arrival(x), noise);
}
