//! Models without fields, as a newcomer from Stan would write them.
use eplat::prelude::*;

/// AR(K): the first K values are taken as given.
pub(crate) mod autoregression {
    use super::*;
    model! {
        model Autoregression;
        column y;
        param alpha ~ Flat;
        param beta(2) ~ Flat;
        param sigma ~ FlatPositive;
        density series(data) = autoregression(alpha, beta, sigma, data.y);
    }

    fn autoregression<D: Real, const K: usize>(
        alpha: D,
        beta: [D; K],
        sigma: D,
        y: &[f64],
    ) -> Vec<D> {
        let mean = |t: usize| (0..K).fold(alpha, |mean, k| mean + beta[k] * y[t - 1 - k]);
        (K..y.len()).map(|t| Normal(mean(t), sigma).ln_likelihood(&y[t])).collect()
    }
}

/// Thirty coefficients and nothing known of them.
pub(crate) mod thirty {
    use super::*;
    model! {
        model Thirty;
        param alpha ~ Flat;
        param beta(30) ~ Flat;
        param sigma ~ FlatPositive;
        let mean(row) = linear(row.x; beta);
        observe y(row): Number ~ Normal(mean(row) + alpha, sigma);
    }
}

/// A curve known at a few places, as a Gaussian process.
pub(crate) mod curve {
    use super::*;
    model! {
        model Curve;
        column x;
        column y;
        param rho ~ Gamma(25.0, 4.0);
        param alpha ~ HalfNormal(2.0);
        param sigma ~ HalfNormal(1.0);
        density curve(data) = curve(rho, alpha, sigma, data.x, data.y);
    }

    /// `−½ yᵀ C⁻¹ y − ½ ln |C| − n ln √2π`, `C = alpha² e^(−½ (xᵢ − xⱼ)²/rho²) + sigma² I`, by the
    /// Cholesky factor of C: a term per row, each value given those above it.
    fn curve<D: Real>(rho: D, alpha: D, sigma: D, x: &[f64], y: &[f64]) -> Vec<D> {
        let mut l: Vec<Vec<D>> = vec![vec![]; x.len()];
        let (mut z, mut terms) = (vec![], vec![]);
        for i in 0..x.len() {
            for j in 0..i {
                let r = rho.recip() * (x[i] - x[j]);
                let c = alpha * alpha * (r * r * -0.5).exp();
                let factor = (c - dot(&l[i], &l[j])) / l[j][j];
                l[i].push(factor);
            }
            let variance = alpha * alpha + sigma * sigma - dot(&l[i], &l[i]);
            let mean = dot(&l[i], &z);
            terms.push(Normal(mean, variance.sqrt()).ln_likelihood(&y[i]));
            z.push((-mean + y[i]) / variance.sqrt());
            l[i].push(variance.sqrt());
        }
        terms
    }

    /// Of the first numbers of both, as many as the shorter has.
    fn dot<D: Real>(a: &[D], b: &[D]) -> D {
        a.iter().zip(b).fold(D::from(0.0), |sum, (a, b)| sum + *a * *b)
    }
}

/// Shares of three kinds, of which some were counted: one number for the whole table.
pub(crate) mod shares {
    use super::*;
    model! {
        model Shares;
        column n;
        param share(3) ~ Dirichlet([1.0, 2.0, 4.0]);
        density tally(data) = tally(share, data.n);
    }

    fn tally<D: Real>(share: [D; 3], n: &[f64]) -> D {
        share.iter().zip(n).fold(D::from(0.0), |sum, (share, n)| sum + share.ln() * *n)
    }
}

/// Answers on a scale of three, and cut points in increasing order.
pub(crate) mod answers {
    use super::*;
    model! {
        model Answers;
        column x;
        param beta ~ Laplace(0.0, 1.0);
        param cut(2) ~ Ordered(Normal(0.0, 2.0));
        observe answer(row): Count ~ OrderedLogit(beta * row.x, cut);
    }
}

/// Every likelihood of a count, with parameters that are truncated and heavy-tailed.
pub(crate) mod counts {
    use super::*;
    model! {
        model Counts;
        column x;
        column trials;
        param slope ~ Cauchy(0.0, 1.0);
        param level ~ TruncatedNormal(0.5, 1.0, slope, slope * slope + 3.0);
        param phi ~ HalfStudentT(3.0, 2.0);
        let eta(row) = slope * row.x + level;
        observe successes(row): Count ~ BinomialLogit(row.trials, eta(row));
        observe events(row): Count ~ NegBinomialLog(eta(row), phi);
        observe delay(row): Number ~ LogNormal(eta(row), phi);
        observe outlier(row): Number ~ StudentT(phi + 1.0, eta(row), phi);
    }
}

/// Voltages of two catheters, each with a noise of its own, of which none below the floor is told.
pub(crate) mod censored {
    use super::*;
    model! {
        model CensoredVoltage;
        param level [mV] ~ Normal(0.0, 2.0);
        param noise(catheter) [mV] ~ HalfNormal(1.0);
        observe bipolar(row): Number [mV] ~ Censored(Normal(level, noise(row)), 0.1);
    }
}

/// The same with all readings taken as they stand.
pub(crate) mod uncensored {
    use super::*;
    model! {
        model Uncensored;
        param level [mV] ~ Normal(0.0, 2.0);
        param noise(catheter) [mV] ~ HalfNormal(1.0);
        observe bipolar(row): Number [mV] ~ Normal(level, noise(row));
    }
}

/// Two covariates and their product, none of them centred.
pub(crate) mod interaction {
    use super::*;
    model! {
        model Interaction;
        column first;
        column second;
        param b(4) ~ Flat;
        param sigma ~ HalfCauchy(2.5);
        let mean(row) =
            b[0] + b[1] * row.first + b[2] * row.second + b[3] * row.first * row.second;
        observe y(row): Number ~ Normal(mean(row), sigma);
    }
}

/// A trend over calendar years, whose zero is far away.
pub(crate) mod trend {
    use super::*;
    model! {
        model Trend;
        column year;
        param level ~ Normal(9.0, 100.0);
        param slope ~ Normal(0.0, 0.03);
        param sigma ~ HalfNormal(2.0);
        observe temperature(row): Number ~ Normal(level + slope * row.year, sigma);
    }
}

/// Five coefficients of columns that resemble each other.
pub(crate) mod alike {
    use super::*;
    model! {
        model Alike;
        param beta(5) ~ Normal(0.0, 10.0);
        param sigma ~ HalfNormal(10.0);
        let mean(row) = linear(row.x; beta);
        observe y(row): Number ~ Normal(mean(row), sigma);
    }
}
