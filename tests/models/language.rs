//! One small model per feature of the language, for the tests.
use eplat::prelude::*;

/// Eight schools, centred: a prior that depends on parameters.
pub(crate) mod centred {
    use super::*;
    model! {
        model EightSchoolsCentred;
        column se;
        param mu ~ Normal(0.0, 5.0);
        param tau ~ HalfNormal(5.0);
        param theta(school) ~ Normal(mu, tau);
        observe effect_size(row): Number ~ Normal(theta(row), row.se);
    }
}

/// A linear predictor is one number per row, however many coefficients it has.
pub(crate) mod logistic {
    use super::*;
    model! {
        model Logistic;
        param intercept ~ StudentT(4.0, 0.0, 5.0);
        param sd ~ Exponential(1.0);
        param beta(30) ~ Normal(0.0, sd);
        let eta(row) = linear(row.x; beta);
        observe event(row): Count ~ BernoulliLogit(eta(row) + intercept);
    }
}

/// Two terms in one field, a labelled vector, three kinds of rows, effects on a field and on `let`s.
pub(crate) mod mixed {
    use super::*;
    model! {
        model Mixed;
        param noise [ms] ~ Gamma(2.0, 0.5);
        param share ~ Beta(2.0, 3.0);
        param bound [ms] ~ Uniform(1.0, 5.0);
        observe warm_up(row): Number [ms] ~ Normal(noise * row.force_g, 3.0);
        column force_g;
        column dose [g];
        param scale(3) ~ Normal(1.0, 0.5);
        field erp(x) [ms] in 150.0..300.0 = m + alpha * gp(Rbf(rho), K = 24) + beta * gp(Matern32(ell), K = 16) where {
            tau   [ms] ~ HalfNormal(20.0);
            m     [ms] ~ Normal(200.0, tau);
            alpha [ms] ~ InvGamma(2.0, 5.0);
            rho   [mm] ~ InvGamma(2.0, 40.0);
            beta  [ms] ~ HalfNormal(noise);
            ell   [mm] ~ LogNormal(3.0, 0.5);
        }
        field slow(x) [ms] in -5.0..5.0 = m + a * gp(Matern52(ell), K = 10) where {
            m   [ms] ~ Flat;
            a   [ms] ~ HalfNormal(2.0);
            ell [mm] ~ InvGamma(2.0, 60.0);
        }
        param spread [ms] ~ HalfNormal(10.0);
        param b(catheter) [ms] ~ Normal(0.0, spread);
        let base(x) [ms] = erp(x) + b(x) * scale[0] + slow(x);
        let shifted(x) [ms] = base(x) + exp(noise / 5) * x.dose * share;
        let log_rate(x) = shifted(x) / 100.0 + scale[1] * scale[2];
        effect force on base, shifted [ms] = linear(row.force_g) ~ Normal(0.0, 10.0);
        effect pace on log_rate = linear(row.force_g) ~ Normal(0.0, 1.0);
        effect dosage on erp [ms] = linear(row.dose) ~ Normal(0.0, 5.0);
        observe s1s2(x): Bracket [ms] ~ TopHat(shifted(x));
        observe open(x): Bracket [ms] ~ Interval(shifted(x), bound);
        observe direct(x): Number [ms] ~ Normal(base(x), noise);
        observe beats(x): Count ~ PoissonLog(log_rate(x));
        density gentle = penalty(noise, spread);
    }

    fn penalty<D: Real>(a: D, b: D) -> D {
        (a - b).powi(2) * -0.01
    }
}

/// Vectors whose numbers constrain each other, with a prior that depends on parameters; and vectors
/// of positive and of bounded numbers.
pub(crate) mod vectors {
    use super::*;
    model! {
        model Vectors;
        column dose;
        param concentration ~ Gamma(3.0, 2.0);
        param spread ~ HalfNormal(2.0);
        param share(4) ~ Dirichlet(concentration);
        param cut(3) [ms] ~ Ordered(Normal(0.0, spread));
        param noise(2) ~ HalfNormal(spread);
        param bounded(3) ~ Uniform(-1.0, 2.0);
        let slope(row) = share[0] * row.dose + share[1] * cut[1] + share[3] * cut[2] - cut[0] * bounded[1];
        observe y(row): Number ~ Normal(slope(row) + bounded[0] * bounded[2], noise[0] + noise[1]);
    }
}

/// The same priors on their own.
pub(crate) mod vector_priors {
    use super::*;
    model! {
        model VectorPriors;
        param share(4) ~ Dirichlet(2.0);
        param cut(3) ~ Ordered(Normal(0.0, 2.0));
        param noise(2) ~ HalfNormal(3.0);
        param bounded(2) ~ Uniform(-1.0, 2.0);
    }
}
