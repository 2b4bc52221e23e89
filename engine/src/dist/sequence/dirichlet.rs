//! Proportions.

use rand::{Rng, RngExt};

use super::{OneOrEach, Sequence, Step, of_each};
use crate::dist::{Support, ln_gamma, ln_logistic, logistic};
use crate::num::Real;

/// Dirichlet distribution of proportions: density `Γ(Σ aᵢ)/Π Γ(aᵢ) Π xᵢ^(aᵢ−1)`, `a` = concentrations;
/// uniform where all are 1.
///
/// The numbers are made by breaking a stick: `xᵢ = (1 − Σ_{j<i} xⱼ) zᵢ` with `zᵢ = logistic(uᵢ −
/// ln(n − 1 − i))`. So `u = 0` is the middle of the simplex.
#[derive(Clone, Copy, Debug)]
pub struct Dirichlet<D, const N: usize> {
    /// One concentration for all proportions (N = 1), or one for each.
    pub concentration: [D; N],
}

/// `Dirichlet(2.0)`, `Dirichlet([1.0, 2.0, 5.0])`; numbers or earlier parameters.
#[allow(non_snake_case)]
pub fn Dirichlet<D: Real, const N: usize, M>(
    concentration: impl OneOrEach<D, N, M>,
) -> Dirichlet<D, N> {
    Dirichlet { concentration: concentration.each() }
}

impl<D: Real, const N: usize> Dirichlet<D, N> {
    fn at(&self, i: usize) -> D {
        of_each(&self.concentration, i)
    }

    /// Σ of the concentrations from number `i` of `n` on.
    fn from(&self, i: usize, n: usize) -> D {
        (i..n).fold(D::from(0.0), |sum, i| sum + self.at(i))
    }
}

/// How far `u` is shifted, so that `u = 0` breaks off an equal share.
fn equal_share(i: usize, n: usize) -> f64 {
    ((n - 1 - i) as f64).ln()
}

impl<D: Real, const N: usize> Sequence<D> for Dirichlet<D, N> {
    fn support(&self) -> Support {
        Support::Simplex
    }
    fn n_unknowns(&self, n: usize) -> usize {
        n - 1
    }
    fn begin(&self) -> f64 {
        1.0
    }
    fn length(&self, n: usize) -> usize {
        if N > 1 { N } else { n.max(2) }
    }
    /// `zᵢ ~ Beta(aᵢ, Σ_{j>i} aⱼ)`, independent of the numbers before.
    fn step(&self, i: usize, n: usize, u: D, carry: &mut [D]) -> Step<D> {
        let u = u - equal_share(i, n);
        let ln_kernel = ln_logistic(u) * self.at(i) + ln_logistic(-u) * self.from(i + 1, n);
        let x = carry[0] * logistic(u);
        carry[0] *= logistic(-u);
        Step { x, ln_kernel }
    }
    fn unconstrain(&self, i: usize, n: usize, x: f64, carry: &[f64]) -> f64 {
        (x / (carry[0] - x)).ln() + equal_share(i, n)
    }
    fn ln_norm(&self, n: usize) -> D {
        (0..n).fold(ln_gamma(self.from(0, n)), |sum, i| sum - ln_gamma(self.at(i)))
    }
    fn sample(&self, n: usize, rng: &mut dyn Rng) -> Option<Vec<f64>> {
        let share = |i| Some(rng.sample(rand_distr::Gamma::new(self.at(i).re(), 1.0).ok()?));
        let shares: Vec<f64> = (0..n).map(share).collect::<Option<_>>()?;
        let total: f64 = shares.iter().sum();
        Some(shares.iter().map(|x| x / total).collect())
    }
}
