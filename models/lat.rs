//! Arrival times over a surface at one conduction velocity.
//!
//! `eplat loop models/lat.rs --mesh SHELL.vtk --units mm --data FILE.csv`
use eplat::prelude::*;

model! {
    /// Activation runs along geodesics from one source, everywhere as fast.
    model Lat;

    /// Length of the path from the vertex in column `source`: eplat adds it to the table.
    column path_mm [mm];

    param onset    [ms]    ~ Normal(0.0, 100.0);
    param slowness [ms/mm] ~ Normal(1.0, 0.5);
    param noise    [ms]    ~ HalfNormal(20.0);

    let arrival(row) [ms] = onset + slowness * row.path_mm;

    observe lat(row): Number [ms] ~ Normal(arrival(row), noise);
}
