//! Vectors whose numbers depend on each other: the priors that ship, and one of the user's own.
use eplat::prelude::*;

/// A random walk: each number is normal about the one before, the first about zero.
#[derive(Debug)]
pub(crate) struct Walk<D> {
    step: D,
}

/// Takes a number or a parameter.
#[allow(non_snake_case)]
pub(crate) fn Walk<D: Real>(step: impl Argument<D>) -> Walk<D> {
    Walk { step: step.number() }
}

impl<D: Real> Sequence<D> for Walk<D> {
    fn support(&self) -> Support {
        Support::Real
    }
    fn step(&self, _: usize, _: usize, u: D, carry: &mut [D]) -> Step<D> {
        let z = (u - carry[0]) / self.step;
        carry[0] = u;
        Step { x: u, ln_kernel: z * z * -0.5 }
    }
    fn unconstrain(&self, _: usize, _: usize, x: f64, _: &[f64]) -> f64 {
        x
    }
    fn ln_norm(&self, n: usize) -> D {
        (self.step.ln() + 0.5 * std::f64::consts::TAU.ln()) * -(n as f64)
    }
    fn sample(&self, n: usize, rng: &mut dyn Rng) -> Option<Vec<f64>> {
        let mut x = 0.0;
        let mut step = |_| {
            x += self.step.re() * rng.sample::<f64, _>(rand_distr::StandardNormal);
            x
        };
        Some((0..n).map(&mut step).collect())
    }
}

/// Each prior alone.
pub(crate) mod alone {
    use super::*;
    model! {
        model Alone;
        param pair(2) ~ MultivariateNormal([0.5, -1.0], [[4.0, -1.2], [-1.2, 1.5]]);
        param l(3) ~ LkjCholesky(1.0);
        param shift(4) [ms] ~ SumToZero(2.0);
        param walk(3) ~ Walk(0.7);
    }
}

/// Every parameter of a prior is itself unknown, and a field has a kernel that is a sum and a product.
pub(crate) mod nested {
    use super::*;
    model! {
        model Nested;
        column dose;
        param eta ~ Gamma(3.0, 2.0);
        param sd(3) ~ HalfNormal(2.0);
        param l(3) ~ LkjCholesky(eta);
        param level ~ Normal(0.0, 5.0);
        param own(3) ~ MultivariateNormal(level, correlation_cholesky(l).scaled(sd));
        param two(2) ~ MultivariateNormal([level, level * 2.0], [[sd[0] + 1.0, sd[1] * 0.2], [sd[1] * 0.2, sd[2] + 0.7]]);
        param shift(4) ~ SumToZero(sd[0]);
        param walk(5) ~ Walk(sd[1]);
        field base(x) [ms] = m + alpha * gp(Rbf(rho) * Matern32(short) + Matern52(short), K = 12) where {
            m     [ms] ~ Normal(20.0, 5.0);
            alpha [ms] ~ HalfNormal(5.0);
            rho   [mm] ~ InvGamma(5.0, 200.0);
            short [mm] ~ InvGamma(5.0, 100.0);
        }
        let slope(row) = own[0] * row.dose + own[1] * two[1] + own[2] + shift[0] * shift[3] + walk[4] * walk[1] + two[0];
        observe y(x): Number ~ Normal(base(x) + slope(x), sd[2] + 0.5);
    }
}

/// Priors that are refused.
pub(crate) mod wrong {
    use super::*;
    pub(crate) mod singular {
        use super::*;
        model! { model Singular; param pair(2) ~ MultivariateNormal(0.0, [[1.0, 2.0], [2.0, 1.0]]); }
    }
    pub(crate) mod triangle {
        use super::*;
        model! { model Triangle; param l(4) ~ LkjCholesky(2.0); }
    }
}
