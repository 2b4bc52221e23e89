//! Eight schools (Rubin 1981): a hierarchical model, in its non-centred form.
//!
//! `eplat run models/eight_schools.rs --data models/eight_schools.csv`
use eplat::prelude::*;

model! {
    /// The effect of coaching in each school, and how much it differs between schools.
    model EightSchools;

    /// Standard error of the school's estimate.
    column se;

    param mu ~ Normal(0.0, 5.0);
    param tau ~ HalfCauchy(5.0);

    /// One number per label of the column `school`. Written as a deviation in units of `tau`, so that
    /// a small `tau` does not squeeze the space that is sampled.
    param z(school) ~ Normal(0.0, 1.0);
    let theta(row) = mu + tau * z(row);

    observe effect_size(row): Number ~ Normal(theta(row), row.se);
}
