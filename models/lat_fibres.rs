//! Conduction velocity and the direction of fibres over a surface, from arrival times of several activations.
//!
//! `eplat run models/lat_fibres.rs --mesh SHELL.vtk --data FILE.csv`, with the columns of `lat_velocity.rs`. The mesh's
//! own fibres are where the angle starts from; `eplat mesh fibres` takes those of an atlas. Activation from one source
//! cannot tell an angle from a ratio: the intervals of both are then as wide as their priors.
use eplat::prelude::*;

model! {
    /// Activation takes the fastest way from its source, faster along fibres than across them.
    model LatFibres;

    field velocity(x) [m/s] within 0.1..1.5 = m + alpha * gp(Matern52(rho), K = 64) where {
        m     [m/s] ~ Normal(0.8, 0.3);
        alpha [m/s] ~ LogNormal(-1.2, 0.5);
        rho   [mm]  ~ LogNormal(3.4, 0.5);
    }
    /// By how much fibres are turned from those of the mesh.
    field angle(x) [rad] = m + alpha * gp(Matern52(rho), K = 64) where {
        m     [rad] ~ Normal(0.0, 0.3);
        alpha [rad] ~ LogNormal(-1.0, 0.5);
        rho   [mm]  ~ LogNormal(3.0, 0.5);
    }
    /// Velocity along fibres over that across.
    param ratio ~ LogNormal(0.6, 0.3);

    let slowness(x) [ms/mm] = 1.0 / velocity(x);
    let velocity_across(x) [m/s] = velocity(x) / ratio;

    /// When activation starts, on the clock of the recording: one for each source.
    param onset(source) [ms] ~ Normal(0.0, 100.0);
    /// Of fronts, which are slower where they spread: diffusivity over squared velocity.
    param thickness [ms] ~ LogNormal(-1.2, 0.7);
    let arrival(row) [ms] = eikonal(slowness(row), ratio, angle(row), thickness; row.source);

    /// By how much the activation of a source is later than that: where fronts meet, and for the wall's own thickness.
    field delay(x, source) [ms] = alpha * gp(Matern32(rho), K = 64) where {
        alpha [ms] ~ HalfNormal(1.0);
        rho   [mm] ~ LogNormal(2.5, 0.4);
    }

    /// Of one point: annotation and place of the electrode.
    param noise [ms] ~ LogNormal(0.7, 0.7);

    observe lat(row): Number [ms] ~ Normal(onset(row) + arrival(row) + delay(row), noise);
}
