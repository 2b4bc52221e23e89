//! Fields within their range by the language, and the same by hand.
use eplat::prelude::*;

/// What `within LOW..HIGH` makes of a sum.
fn bent<T: Real>(low: f64, high: f64, x: Num<T>) -> Num<T> {
    eplat::num::within(low, high, x)
}

pub(crate) mod linked {
    use eplat::prelude::*;
    model! {
        /// A link on a field, and on one for each patient.
        model Linked;
        field level(x) [ms] within -4.0..6.0 = m + alpha * gp(Matern32(rho), K = 12) where {
            m [ms] ~ Normal(1.0, 3.0);
            alpha [ms] ~ LogNormal(1.0, 0.5);
            rho [mm] ~ LogNormal(3.0, 0.5);
        }
        field own(x, patient) [ms] within 120.0..270.0 = m + 20.0 * gp(Matern32(Num::from(20.0)), K = 12) where {
            m(patient) [ms] ~ Normal(195.0, 30.0);
        }
        let product(x) [ms] = 2.0 * own(x) + level(x) * level(x) / own(x);
        effect force on level [ms] = linear(row.force_g) ~ Normal(0.0, 1.0);
        observe direct(x): Number [ms] ~ Normal(product(x), 3.0);
        observe flat(x): Number [ms] ~ Normal(level(x), 1.0);
    }
}

pub(crate) mod by_hand {
    use super::bent;
    use eplat::prelude::*;
    model! {
        /// The same with the links as `let`s.
        model ByHand;
        field sum(x) [ms] = m + alpha * gp(Matern32(rho), K = 12) where {
            m [ms] ~ Normal(1.0, 3.0);
            alpha [ms] ~ LogNormal(1.0, 0.5);
            rho [mm] ~ LogNormal(3.0, 0.5);
        }
        field sums(x, patient) [ms] = m + 20.0 * gp(Matern32(Num::from(20.0)), K = 12) where {
            m(patient) [ms] ~ Normal(195.0, 30.0);
        }
        let level(x) [ms] in -4.0..6.0 = bent(-4.0, 6.0, sum(x));
        let own(x) [ms] in 120.0..270.0 = bent(120.0, 270.0, sums(x));
        let product(x) [ms] = 2.0 * own(x) + level(x) * level(x) / own(x);
        effect force on level [ms] = linear(row.force_g) ~ Normal(0.0, 1.0);
        observe direct(x): Number [ms] ~ Normal(product(x), 3.0);
        observe flat(x): Number [ms] ~ Normal(level(x), 1.0);
    }
}
