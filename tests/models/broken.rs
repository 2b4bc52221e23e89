//! Broken twins of models that ship: each has a likelihood of the wrong width, and must be found out.
use eplat::prelude::*;

pub(crate) mod normal {
    use super::*;
    model! {
        model MeanAndSpread;
        param mu ~ Normal(0.0, 50.0);
        param sigma ~ HalfNormal(20.0);
        observe y(row): Number ~ Normal(mu, sigma * 0.5);
    }
}

pub(crate) mod regression {
    use super::*;
    model! {
        model Regression;
        param intercept ~ Normal(0.0, 20.0);
        param beta(3) ~ Normal(0.0, 5.0);
        param sigma ~ HalfNormal(10.0);
        let mean(row) = linear(row.x; beta);
        observe y(row): Number ~ Normal(mean(row) + intercept, sigma * 0.5);
    }
}

pub(crate) mod eight_schools {
    use super::*;
    model! {
        model EightSchools;
        column se;
        param mu ~ Normal(0.0, 5.0);
        param tau ~ HalfCauchy(5.0);
        param z(school) ~ Normal(0.0, 1.0);
        let theta(row) = mu + tau * z(row);
        observe effect_size(row): Number ~ Normal(theta(row), row.se * 0.5);
    }
}

pub(crate) mod voltage {
    use super::*;
    model! {
        model Voltage;
        field voltage(x) [mV] in 0.0..10.0 = m + alpha * gp(Matern52(rho), K = 64) where {
            m     [mV] ~ Normal(3.0, 3.0);
            alpha [mV] ~ HalfNormal(3.0);
            rho   [mm] ~ InvGamma(3.0, 60.0);
        }
        param noise [mV] ~ HalfNormal(1.0);
        observe bipolar(x): Number [mV] ~ Normal(voltage(x), noise * 0.15);
    }
}
