//! Priors of vectors whose numbers constrain each other: proportions, and numbers in order.
//!
//! Such a vector is made number after number: each from an unknown of its own and from one scalar
//! that the numbers before it leave behind.

use rand::{Rng, RngExt};

use super::{Cauchy, Dist, Laplace, Normal, StudentT, Support, ln_gamma, ln_logistic, logistic};
use crate::num::{Argument, Real};

/// One number of a vector, from its unknown `u` and from what the numbers before it left.
#[derive(Clone, Copy, Debug)]
pub struct Step<D> {
    /// The number.
    pub x: D,
    /// What it leaves for the next.
    pub carry: D,
    /// Its part of the log density of the unknowns, without [`Sequence::ln_norm`].
    pub ln_kernel: D,
}

/// A prior of a whole vector of `n` numbers, with the transform that makes it number by number.
///
/// ```text
/// ln p(u) = ln p(x) + ln |det dx/du| = Σᵢ ln_kernel(i) + ln_norm(n)
/// ```
/// Where there are fewer unknowns than numbers, the last number is what the others leave.
pub trait Sequence<D: Real> {
    /// Where the vector lies.
    fn support(&self) -> Support;
    /// How many unknowns `n` numbers have.
    fn n_unknowns(&self, n: usize) -> usize {
        n
    }
    /// How many numbers it is a prior of, if it says.
    fn length(&self) -> Option<usize> {
        None
    }
    /// What the first number finds.
    fn begin(&self) -> f64 {
        0.0
    }
    /// Number `i` of `n`.
    fn step(&self, i: usize, n: usize, u: D, carry: D) -> Step<D>;
    /// The unknown behind number `i` of `n`, if it is `x`.
    fn unconstrain(&self, i: usize, n: usize, x: f64, carry: f64) -> f64;
    /// What [`Step::ln_kernel`] leaves out.
    fn ln_norm(&self, n: usize) -> D;
    /// A typical unknown behind number `i`.
    fn initial(&self, i: usize) -> f64;
    /// `n` numbers drawn; `None` as in [`Dist::sample`].
    fn sample(&self, n: usize, rng: &mut dyn Rng) -> Option<Vec<f64>>;
}

/// Dirichlet distribution of proportions: density `Γ(Σ aᵢ)/Π Γ(aᵢ) Π xᵢ^(aᵢ−1)`, `a` = concentrations;
/// uniform where all are 1.
///
/// Made by breaking a stick: `xᵢ = (1 − Σ_{j<i} xⱼ) zᵢ` with `zᵢ = logistic(uᵢ − ln(n − 1 − i))`,
/// so that `u = 0` is the middle of the simplex.
#[derive(Clone, Copy, Debug)]
pub struct Dirichlet<D, const N: usize> {
    /// One concentration for all proportions (N = 1), or one for each.
    pub concentration: [D; N],
}

/// `Dirichlet(2.0)`, `Dirichlet([1.0, 2.0, 5.0])`; numbers or earlier parameters.
#[allow(non_snake_case)]
pub fn Dirichlet<D: Real, const N: usize, M>(
    concentration: impl Concentration<D, N, M>,
) -> Dirichlet<D, N> {
    Dirichlet { concentration: concentration.each() }
}

/// What [`fn@Dirichlet`] takes. `M` tells one number from several apart.
pub trait Concentration<D, const N: usize, M> {
    /// As N numbers.
    fn each(self) -> [D; N];
}

impl<D, T: Argument<D>> Concentration<D, 1, ()> for T {
    fn each(self) -> [D; 1] {
        [self.number()]
    }
}

impl<D, T: Argument<D>, const N: usize> Concentration<D, N, [(); N]> for [T; N] {
    fn each(self) -> [D; N] {
        self.map(Argument::number)
    }
}

impl<D: Real, const N: usize> Dirichlet<D, N> {
    fn at(&self, i: usize) -> D {
        self.concentration[if N == 1 { 0 } else { i }]
    }

    /// Σ of the concentrations from number `i` of `n` on.
    fn from(&self, i: usize, n: usize) -> D {
        (i..n).fold(D::from(0.0), |sum, i| sum + self.at(i))
    }
}

/// How far `u` is shifted so that 0 breaks off an equal share.
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
    fn length(&self) -> Option<usize> {
        (N > 1).then_some(N)
    }
    /// `zᵢ ~ Beta(aᵢ, Σ_{j>i} aⱼ)`, independent of the numbers before.
    fn step(&self, i: usize, n: usize, u: D, carry: D) -> Step<D> {
        let u = u - equal_share(i, n);
        let ln_kernel = ln_logistic(u) * self.at(i) + ln_logistic(-u) * self.from(i + 1, n);
        Step { x: carry * logistic(u), carry: carry * logistic(-u), ln_kernel }
    }
    fn unconstrain(&self, i: usize, n: usize, x: f64, carry: f64) -> f64 {
        (x / (carry - x)).ln() + equal_share(i, n)
    }
    fn ln_norm(&self, n: usize) -> D {
        (0..n).fold(ln_gamma(self.from(0, n)), |sum, i| sum - ln_gamma(self.at(i)))
    }
    fn initial(&self, _: usize) -> f64 {
        0.0
    }
    fn sample(&self, n: usize, rng: &mut dyn Rng) -> Option<Vec<f64>> {
        let share = |i| Some(rng.sample(rand_distr::Gamma::new(self.at(i).re(), 1.0).ok()?));
        let shares: Vec<f64> = (0..n).map(share).collect::<Option<_>>()?;
        let total: f64 = shares.iter().sum();
        Some(shares.iter().map(|x| x / total).collect())
    }
}

/// A prior with mass on the whole real line, which [`Ordered`] takes.
#[diagnostic::on_unimplemented(
    message = "`Ordered` takes a prior on the real line, not `{Self}`",
    label = "expected Normal(mu, sd), StudentT(nu, mu, sd), Cauchy(mu, scale) or Laplace(mu, scale)"
)]
pub trait RealLine<D: Real>: Dist<D> {
    /// `ln p(x)`, for log densities written by hand.
    #[inline]
    fn ln_density(&self, x: D) -> D {
        self.ln_kernel(x, x) + self.ln_norm()
    }
}

impl<D: Real> RealLine<D> for Normal<D> {}
impl<D: Real> RealLine<D> for StudentT<D> {}
impl<D: Real> RealLine<D> for Cauchy<D> {}
impl<D: Real> RealLine<D> for Laplace<D> {}

/// Numbers with one prior, in increasing order: density `n! Π p(xᵢ)` where `x₀ < x₁ < …`.
///
/// `x₀ = u₀`, `xᵢ = xᵢ₋₁ + e^(uᵢ)`.
#[derive(Clone, Copy, Debug)]
pub struct Ordered<T>(
    /// The prior of each number.
    pub T,
);

impl<D: Real, T: RealLine<D>> Sequence<D> for Ordered<T> {
    fn support(&self) -> Support {
        Support::Ordered
    }
    fn step(&self, i: usize, _: usize, u: D, carry: D) -> Step<D> {
        let (x, ln_jacobian) = if i == 0 { (u, D::from(0.0)) } else { (carry + u.exp(), u) };
        Step { x, carry: x, ln_kernel: self.0.ln_kernel(x, x) + ln_jacobian }
    }
    fn unconstrain(&self, i: usize, _: usize, x: f64, carry: f64) -> f64 {
        if i == 0 { x } else { (x - carry).ln() }
    }
    fn ln_norm(&self, n: usize) -> D {
        self.0.ln_norm() * n as f64 + ln_gamma(n as f64 + 1.0)
    }
    fn initial(&self, i: usize) -> f64 {
        if i == 0 { self.0.centre() } else { 0.0 }
    }
    fn sample(&self, n: usize, rng: &mut dyn Rng) -> Option<Vec<f64>> {
        let mut x: Vec<f64> = (0..n).map(|_| self.0.sample(rng)).collect::<Option<_>>()?;
        x.sort_by(f64::total_cmp);
        Some(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{Dual, derivatives, variable};

    /// One concentration for all.
    fn one(concentration: f64) -> Dirichlet<f64, 1> {
        Dirichlet(concentration)
    }

    /// The numbers and the log density of their unknowns.
    fn run(prior: &impl Sequence<f64>, n: usize, u: &[f64]) -> (Vec<f64>, f64) {
        let (mut carry, mut x, mut ln_p) = (prior.begin(), vec![], prior.ln_norm(n));
        for (i, u) in u.iter().enumerate() {
            let step = prior.step(i, n, *u, carry);
            (carry, ln_p) = (step.carry, ln_p + step.ln_kernel);
            x.push(step.x);
        }
        x.resize(n, carry);
        (x, ln_p)
    }

    /// The integral over two unknowns of the density times `f`.
    fn integral(prior: &impl Sequence<f64>, n: usize, f: impl Fn(&[f64]) -> f64) -> f64 {
        let (h, half) = (0.05, 500);
        let mut sum = 0.0;
        for i in -half..half {
            for j in -half..half {
                let (x, ln_p) = run(prior, n, &[h * f64::from(i), h * f64::from(j)]);
                sum += f(&x) * ln_p.exp() * h * h;
            }
        }
        sum
    }

    #[test]
    fn proportions_have_the_dirichlets_mass_and_moments() {
        let prior = one(2.5);
        assert!((integral(&prior, 3, |_| 1.0) - 1.0).abs() < 1e-8);
        // E xᵢ = 1/n, Var xᵢ = (n − 1)/(n² (na + 1)), Cov = −1/(n² (na + 1))
        for i in 0..3 {
            assert!((integral(&prior, 3, |x| x[i]) - 1.0 / 3.0).abs() < 1e-8, "{i}");
            let square = integral(&prior, 3, |x| x[i] * x[i]) - 1.0 / 9.0;
            assert!((square - 2.0 / (9.0 * 8.5)).abs() < 1e-8, "{i}: {square}");
        }
        let product = integral(&prior, 3, |x| x[0] * x[2]) - 1.0 / 9.0;
        assert!((product + 1.0 / (9.0 * 8.5)).abs() < 1e-8, "{product}");
    }

    #[test]
    fn proportions_may_each_have_a_concentration() {
        // E xᵢ = aᵢ/a, Var xᵢ = E xᵢ (1 − E xᵢ)/(a + 1), a = Σ aᵢ
        let a = [2.0, 4.5, 1.5];
        let prior: Dirichlet<f64, 3> = Dirichlet(a);
        assert!((integral(&prior, 3, |_| 1.0) - 1.0).abs() < 1e-8);
        for i in 0..3 {
            let mean = a[i] / 8.0;
            assert!((integral(&prior, 3, |x| x[i]) - mean).abs() < 1e-8, "{i}");
            let variance = integral(&prior, 3, |x| x[i] * x[i]) - mean * mean;
            assert!((variance - mean * (1.0 - mean) / 9.0).abs() < 1e-8, "{i}: {variance}");
        }
    }

    #[test]
    fn ordered_numbers_have_the_moments_of_order_statistics() {
        // E min, E max of two standard normals = ∓1/√π; each of a half-and-half mixture has variance 1
        let prior = Ordered(Normal::<f64>(0.0, 1.0));
        let minimum = integral(&prior, 2, |x| x[0]);
        let maximum = integral(&prior, 2, |x| x[1]);
        let expected = std::f64::consts::PI.sqrt().recip();
        assert!((integral(&prior, 2, |_| 1.0) - 1.0).abs() < 1e-8);
        assert!((minimum + expected).abs() < 1e-8 && (maximum - expected).abs() < 1e-8);
        assert!((integral(&prior, 2, |x| x[0] * x[0]) - 1.0).abs() < 1e-8);
        // a broken twin: the Jacobian x₁ − x₀ = e^(u₁) left out
        let twin = integral(&prior, 2, |x| 1.0 / (x[1] - x[0]).max(1e-300));
        assert!((twin - 1.0).abs() > 0.1, "{twin}");
    }

    #[test]
    fn unknowns_come_back_from_the_numbers() {
        fn check(prior: &impl Sequence<f64>, u: &[f64], n: usize) {
            let (x, _) = run(prior, n, u);
            let mut carry = prior.begin();
            for (i, u) in u.iter().enumerate() {
                let back = prior.unconstrain(i, n, x[i], carry);
                assert!((back - u).abs() < 1e-12, "{i}: {back} against {u}");
                carry = prior.step(i, n, *u, carry).carry;
            }
        }
        check(&one(0.7), &[0.3, -1.2, 2.0], 4);
        check(&Ordered(StudentT::<f64>(4.0, 1.0, 2.0)), &[0.3, -1.2, 2.0, 0.1], 4);
        let (x, _) = run(&one(0.7), 4, &[0.0; 3]);
        assert!(x.iter().all(|x| (x - 0.25).abs() < 1e-15), "{x:?}");
    }

    #[test]
    fn derivatives_in_the_concentration_match_differences() {
        let ln_p = |a: f64| run(&one(a), 3, &[0.4, -0.9]).1;
        let prior = Dirichlet { concentration: [variable::<1>(1.3, 0)] };
        let mut dual = prior.ln_norm(3);
        let mut carry = Dual::from(1.0);
        for (i, u) in [0.4, -0.9].into_iter().enumerate() {
            let step = prior.step(i, 3, Dual::from(u), carry);
            (dual, carry) = (dual + step.ln_kernel, step.carry);
        }
        let difference = (ln_p(1.3 + 1e-5) - ln_p(1.3 - 1e-5)) / 2e-5;
        assert!((derivatives(&dual)[0] - difference).abs() < 1e-8);
    }
}
