//! A map of voltage from point measurements: plain GP regression on the surface.
//!
//! `eplat run models/voltage.rs --mesh SHELL.vtk --units mm --data FILE.csv`, a row per point: `vertex`
//! (or `x, y, z`), `protocol` (bipolar), `value` (mV).
use eplat::prelude::*;

model! {
    /// Peak-to-peak bipolar voltage over the surface, measured with Gaussian noise.
    model Voltage;

    field voltage(x) [mV] in 0.0..10.0 = m + alpha * gp(Matern52(rho), K = 64) where {
        m     [mV] ~ Normal(3.0, 3.0);
        alpha [mV] ~ HalfNormal(3.0);
        rho   [mm] ~ InvGamma(3.0, 60.0);
    }

    /// Of one point: catheter contact and beat to beat. Never none: one point per site could not
    /// rule that out.
    param noise [mV] ~ LogNormal(-0.7, 0.5);

    observe bipolar(x): Number [mV] ~ Normal(voltage(x), noise);
}
