//! Models of which every measurement is normal about a sum of fields and other things.

/// One noise for all: only a factor of the information changes.
pub(crate) mod one_noise {
    use eplat::prelude::*;
    model! {
        model OneNoise;
        param noise ~ HalfNormal(1.0);
        field f(x) = m + alpha * gp(Matern52(rho), K = 12) where {
            m ~ Normal(1.0, 2.0); alpha ~ HalfNormal(2.0); rho ~ InvGamma(3.0, 60.0);
        }
        observe direct(x): Number ~ Normal(f(x), noise);
    }
}

/// The same of which the likelihood takes a larger noise: the twin that must be told from it.
pub(crate) mod twin {
    use eplat::prelude::*;
    model! {
        model Twin;
        param noise ~ HalfNormal(1.0);
        field f(x) = m + alpha * gp(Matern52(rho), K = 12) where {
            m ~ Normal(1.0, 2.0); alpha ~ HalfNormal(2.0); rho ~ InvGamma(3.0, 60.0);
        }
        observe direct(x): Number ~ Normal(f(x), 1.2 * noise);
    }
}

/// Two fields seen together, one with a mean of unknown size and one with a flat one, and a noise of each catheter.
pub(crate) mod two_fields {
    use eplat::prelude::*;
    model! {
        model TwoFields;
        param level ~ Normal(0.0, 1.0);
        param noise(catheter) ~ HalfNormal(1.0);
        field f(x) = m + alpha * gp(Matern52(rho), K = 10) where {
            m ~ Flat; alpha ~ HalfNormal(2.0); rho ~ InvGamma(3.0, 60.0);
        }
        field g(x) = level + size * gp(Rbf(20.0), K = 6) where { size ~ HalfNormal(1.0); }
        observe direct(x): Number ~ Normal(f(x), noise(x));
        observe mixed(x): Number ~ Normal(2.0 - (f(x) - 3.0 * g(x)) / 2.0, noise(x) * 0.5);
    }
}

/// All that may stand beside fields: parameters, a vector whose size is learnt, labels whose mean and spread are learnt,
/// an effect, and `let`s of them.
pub(crate) mod sums {
    use eplat::prelude::*;
    model! {
        model Sums;
        column dose;
        column force;
        param onset ~ Normal(1.0, 0.5);
        param tilt ~ Flat;
        param size  ~ LogNormal(-2.0, 0.3);
        param gain(2) ~ Normal(0.0, size);
        param usual ~ Normal(0.0, 0.3);
        param spread ~ LogNormal(-0.7, 0.5);
        param shift(catheter) ~ Normal(usual, spread);
        param noise ~ HalfNormal(1.0);
        field f(x) = alpha * gp(Matern52(rho), K = 12) where {
            alpha ~ LogNormal(-0.5, 0.5); rho ~ LogNormal(3.0, 0.3);
        }
        let along(row) = linear(row.dose, row.force; gain);
        let level(row) = onset + tilt * row.dose + f(row) + along(row) / 2.0;
        effect grip on level = scaled(row.force, 1.0, 0.5) ~ Normal(0.0, 0.2);
        observe direct(row): Number ~ Normal(level(row) - shift(row), noise);
        observe mixed(row): Number ~ Normal(2.0 * level(row), noise * row.dose);
    }
}

/// The same with another prior of what is integrated out: the twin that must be told from it.
pub(crate) mod sums_twin {
    use eplat::prelude::*;
    model! {
        model SumsTwin;
        column dose;
        column force;
        param onset ~ Normal(1.0, 0.5);
        param tilt ~ Flat;
        param size  ~ LogNormal(-2.0, 0.3);
        param gain(2) ~ Normal(0.0, 2.0 * size);
        param usual ~ Normal(0.0, 0.3);
        param spread ~ LogNormal(-0.7, 0.5);
        param shift(catheter) ~ Normal(usual, spread);
        param noise ~ HalfNormal(1.0);
        field f(x) = alpha * gp(Matern52(rho), K = 12) where {
            alpha ~ LogNormal(-0.5, 0.5); rho ~ LogNormal(3.0, 0.3);
        }
        let along(row) = linear(row.dose, row.force; gain);
        let level(row) = onset + tilt * row.dose + f(row) + along(row) / 2.0;
        effect grip on level = scaled(row.force, 1.0, 0.5) ~ Normal(0.0, 0.2);
        observe direct(row): Number ~ Normal(level(row) - shift(row), noise);
        observe mixed(row): Number ~ Normal(2.0 * level(row), noise * row.dose);
    }
}

/// The product of two fields is not linear in them.
pub(crate) mod product {
    use eplat::prelude::*;
    model! {
        model Product;
        field f(x) = gp(Rbf(20.0), K = 4);
        observe direct(x): Number ~ Normal(f(x) * f(x), 1.0);
    }
}
