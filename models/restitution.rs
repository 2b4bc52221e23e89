//! How much of its size a paced beat's transient has regained: S2 amplitude over S1 amplitude.
//!
//! `eplat loop models/restitution.rs --data FILE.csv`
use eplat::prelude::*;

model! {
    /// One ratio of amplitudes for every site and recording. It knows nothing of the coupling interval S2.
    model Restitution;

    column amp_s1;
    column amp_s2;

    param level [1] ~ Normal(1.0, 0.5);
    param noise [1] ~ HalfNormal(0.5);

    let recovered(row) [1] = level;

    observe ratio(row): Number [1] from (row.amp_s2 / row.amp_s1) ~ Normal(recovered(row), noise);
}
