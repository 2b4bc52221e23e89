//! Linear regression on any number of columns.
//!
//! `eplat run models/regression.rs --data FILE.csv`, where FILE.csv has the columns y, x1, x2 and x3.
//! `beta(3)` takes three columns x1 to x3, counted from 1 without a gap; for another number of them
//! change the 3. A table with more or fewer is refused, with the number that it has.
use eplat::prelude::*;

model! {
    /// A straight line in several covariates; give these in comparable scales.
    model Regression;

    param intercept ~ Normal(0.0, 20.0);
    param beta(3) ~ Normal(0.0, 5.0);
    param sigma ~ HalfNormal(10.0);

    let mean(row) = linear(row.x; beta);

    observe y(row): Number ~ Normal(mean(row) + intercept, sigma);
}
