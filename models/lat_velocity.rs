//! Conduction velocity over a surface, from arrival times.
//!
//! `eplat run models/lat_velocity.rs --mesh SHELL.vtk --data FILE.csv`, a row per point: `vertex` (or `x, y, z`),
//! `protocol` (lat), `value` (ms), and `source`, the vertex at which activation starts.
use eplat::prelude::*;

model! {
    /// Activation takes the fastest way from its source, through tissue that is as fast in all directions.
    model LatVelocity;

    field velocity(x) [m/s] within 0.1..1.5 = m + alpha * gp(Matern52(rho), K = 64) where {
        m     [m/s] ~ Normal(0.8, 0.3);
        alpha [m/s] ~ LogNormal(-1.2, 0.5);
        rho   [mm]  ~ LogNormal(3.4, 0.5);
    }
    let slowness(x) [ms/mm] = 1.0 / velocity(x);

    /// When activation starts, on the clock of the recording: one for each source.
    param onset(source) [ms] ~ Normal(0.0, 100.0);
    /// Of fronts, which are slower where they spread: diffusivity over squared velocity.
    param thickness [ms] ~ LogNormal(-1.2, 0.7);
    let arrival(row) [ms] = eikonal(slowness(row), 1.0, 0.0, thickness; row.source);

    /// Of one point: annotation and place of the electrode.
    param noise [ms] ~ LogNormal(0.7, 0.7);

    observe lat(row): Number [ms] ~ Normal(onset(row) + arrival(row), noise);
}
