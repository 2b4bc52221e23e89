//! The first model to read: the mean and the spread of some numbers.
//!
//! `eplat run models/normal.rs --data FILE.csv`, where FILE.csv has a column `y`.
use eplat::prelude::*;

model! {
    /// Numbers from one normal distribution: where do they lie, and how far do they spread?
    model MeanAndSpread;

    /// What is believed before seeing any: the mean is tens at most, the spread is positive.
    param mu ~ Normal(0.0, 50.0);
    param sigma ~ HalfNormal(20.0);

    /// One row of the table, one number.
    observe y(row): Number ~ Normal(mu, sigma);
}
