//! Priors of parameters, each with the transform that takes its support to the real line.
//!
//! A prior is written `Normal(0.0, 10.0)` in a model file: a function of the same name as its type,
//! whose arguments are numbers or earlier parameters.

use rand::{Rng, RngExt};
use rand_distr::{Exp1, Open01, StandardNormal};

use crate::num::{LN_SQRT_2PI, Real};

/// Where a prior has mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Support {
    /// All real numbers.
    Real,
    /// The positive half-line.
    Positive,
    /// An open interval; an end may be infinite.
    Interval(f64, f64),
    /// An interval whose ends depend on other parameters.
    Between,
    /// Vectors of positive numbers whose sum is 1.
    Simplex,
    /// Vectors of increasing numbers.
    Ordered,
}

/// A prior: its support's transform and its density in the unconstrained coordinate `u`.
///
/// With `x = constrain(u)` the log density of `u` is `ln p(x) + ln |dx/du| = ln_kernel + ln_norm`.
/// The two parts are separate because `ln_norm` is a constant while the prior's own parameters are.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a prior",
    label = "expected a prior such as Normal(0.0, 1.0), HalfNormal(5.0), InvGamma(1.0, 5.0), Flat; a vector `param p(3)` also takes Dirichlet(1.0) and Ordered(Normal(0.0, 1.0))"
)]
pub trait Dist<D: Real> {
    /// The support at the prior's current parameters.
    fn support(&self) -> Support {
        Support::Real
    }
    /// `x` from the unconstrained `u`.
    fn constrain(&self, u: D) -> D {
        u
    }
    /// `u` from `x` inside the support.
    fn unconstrain(&self, x: f64) -> f64 {
        x
    }
    /// `ln p(x) + ln |dx/du|` without the terms that depend on the prior's parameters alone.
    fn ln_kernel(&self, u: D, x: D) -> D;
    /// What [`Dist::ln_kernel`] leaves out.
    fn ln_norm(&self) -> D;
    /// A typical value, from which the search for a starting point sets out.
    fn centre(&self) -> f64;
    /// A draw; `None` where there is no sampler: an improper prior, or parameters out of range.
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let _ = rng;
        None
    }
    /// The prior as one of a coefficient in a Gaussian block, if it is normal or flat.
    fn gaussian(&self) -> Option<Gaussian> {
        None
    }
    /// Whether the density is constant (an improper prior).
    fn is_flat(&self) -> bool {
        self.gaussian().is_some_and(|prior| prior.precision == 0.0)
    }
}

/// `x = location + scale w` with w normal, of mean 0 and this precision; 0 if it is flat.
#[derive(Clone, Copy, Debug)]
pub struct Gaussian {
    /// The mean, in the unit of x.
    pub location: f64,
    /// The standard deviation; 1 if it is flat.
    pub scale: f64,
    /// 1, or 0 if it is flat.
    pub precision: f64,
}

/// Transform of the positive half-line: `x = eᵘ`.
macro_rules! positive {
    () => {
        fn support(&self) -> Support {
            Support::Positive
        }
        #[inline]
        fn constrain(&self, u: D) -> D {
            u.exp()
        }
        fn unconstrain(&self, x: f64) -> f64 {
            x.ln()
        }
    };
}

/// A struct with its parameters and a function of the same name that takes numbers or parameters.
macro_rules! family {
    ($($(#[$doc:meta])* $T:ident ( $($a:ident : $what:literal),* );)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $T<D> { $(#[doc = $what] pub $a: D),* }

        $(#[$doc])*
        #[allow(non_snake_case)]
        #[inline]
        pub fn $T<D: Real>($($a: impl crate::num::Argument<D>),*) -> $T<D> {
            $T { $($a: crate::num::Argument::number($a)),* }
        }
    )*};
}

mod bounded;
mod normal_cdf;
mod sequence;
mod tails;
pub use bounded::{FlatBetween, FlatPositive, TruncatedNormal};
pub(crate) use normal_cdf::{ln_normal_below, ln_normal_between};
pub use sequence::{Concentration, Dirichlet, Ordered, RealLine, Sequence, Step};
pub use tails::{Cauchy, HalfStudentT, Laplace};

family! {
    /// Normal distribution: `−z²/2 − ln sd − ½ ln 2π`, `z = (x − mu)/sd`.
    Normal(mu: "mean", sd: "standard deviation");
    /// Normal distribution folded at zero: density `2 Normal(x; 0, sd)` for `x > 0`.
    HalfNormal(sd: "standard deviation of the unfolded normal");
    /// Cauchy distribution folded at zero: density `2 / (π scale (1 + (x/scale)²))` for `x > 0`.
    HalfCauchy(scale: "median");
    /// Gamma distribution: density `scale`-free `rateᵃ xᵃ⁻¹ e^(−rate x) / Γ(a)`, `a` = shape.
    Gamma(shape: "shape", rate: "rate, the inverse of the scale");
    /// Inverse gamma distribution: density `bᵃ x^(−a−1) e^(−b/x) / Γ(a)`, `a` = shape, `b` = scale.
    InvGamma(shape: "shape", scale: "scale");
    /// Uniform distribution on `(lower, upper)`.
    Uniform(lower: "lower end", upper: "upper end");
    /// Student's t with `nu` degrees of freedom, location `mu` and scale `sd`.
    StudentT(nu: "degrees of freedom", mu: "location", sd: "scale");
    /// Beta distribution on (0, 1): density `x^(a−1) (1−x)^(b−1) / B(a, b)`.
    Beta(a: "first shape", b: "second shape");
    /// Exponential distribution: density `rate e^(−rate x)`.
    Exponential(rate: "rate, the inverse of the mean");
    /// Log-normal distribution: `ln x ~ Normal(mu, sd)`.
    LogNormal(mu: "mean of ln x", sd: "standard deviation of ln x");
}

/// The improper constant density on the real line.
#[derive(Clone, Copy, Debug)]
pub struct Flat;

impl<D: Real> Dist<D> for Flat {
    fn ln_kernel(&self, _: D, _: D) -> D {
        D::from(0.0)
    }
    fn ln_norm(&self) -> D {
        D::from(0.0)
    }
    fn centre(&self) -> f64 {
        0.0
    }
    fn gaussian(&self) -> Option<Gaussian> {
        Some(Gaussian { location: 0.0, scale: 1.0, precision: 0.0 })
    }
}

impl<D: Real> Dist<D> for Normal<D> {
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        let z = (u - self.mu) / self.sd;
        z * z * -0.5
    }
    #[inline]
    fn ln_norm(&self) -> D {
        -self.sd.ln() - LN_SQRT_2PI
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        Some(self.mu.re() + self.sd.re() * rng.sample::<f64, _>(StandardNormal))
    }
    fn gaussian(&self) -> Option<Gaussian> {
        Some(Gaussian { location: self.mu.re(), scale: self.sd.re(), precision: 1.0 })
    }
    fn centre(&self) -> f64 {
        self.mu.re()
    }
}

impl<D: Real> Dist<D> for HalfNormal<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, x: D) -> D {
        let z = x / self.sd;
        z * z * -0.5 + u
    }
    #[inline]
    fn ln_norm(&self) -> D {
        -self.sd.ln() - LN_SQRT_2PI + std::f64::consts::LN_2
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        Some(self.sd.re() * rng.sample::<f64, _>(StandardNormal).abs())
    }
    fn centre(&self) -> f64 {
        self.sd.re()
    }
}

impl<D: Real> Dist<D> for HalfCauchy<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, x: D) -> D {
        let z = x / self.scale;
        u - (z * z).ln_1p()
    }
    #[inline]
    fn ln_norm(&self) -> D {
        -self.scale.ln() + std::f64::consts::FRAC_2_PI.ln()
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let p: f64 = rng.sample(Open01);
        Some(self.scale.re() * (std::f64::consts::FRAC_PI_2 * p).tan())
    }
    fn centre(&self) -> f64 {
        self.scale.re()
    }
}

impl<D: Real> Dist<D> for Gamma<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, x: D) -> D {
        self.shape * u - self.rate * x
    }
    fn ln_norm(&self) -> D {
        self.shape * self.rate.ln() - ln_gamma(self.shape)
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let unit = rand_distr::Gamma::new(self.shape.re(), 1.0).ok()?;
        Some(rng.sample(unit) / self.rate.re())
    }
    fn centre(&self) -> f64 {
        (self.shape / self.rate).re()
    }
}

impl<D: Real> Dist<D> for InvGamma<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, x: D) -> D {
        -(self.shape * u) - self.scale / x
    }
    fn ln_norm(&self) -> D {
        self.shape * self.scale.ln() - ln_gamma(self.shape)
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let unit = rand_distr::Gamma::new(self.shape.re(), 1.0).ok()?;
        Some(self.scale.re() / rng.sample(unit))
    }
    fn centre(&self) -> f64 {
        (self.scale / self.shape).re()
    }
}

impl<D: Real> Dist<D> for Exponential<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, x: D) -> D {
        u - self.rate * x
    }
    fn ln_norm(&self) -> D {
        self.rate.ln()
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        Some(rng.sample::<f64, _>(Exp1) / self.rate.re())
    }
    fn centre(&self) -> f64 {
        self.rate.recip().re()
    }
}

impl<D: Real> Dist<D> for LogNormal<D> {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        let z = (u - self.mu) / self.sd;
        z * z * -0.5
    }
    fn ln_norm(&self) -> D {
        -self.sd.ln() - LN_SQRT_2PI
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        Some((self.mu.re() + self.sd.re() * rng.sample::<f64, _>(StandardNormal)).exp())
    }
    fn centre(&self) -> f64 {
        self.mu.re().exp()
    }
}

impl<D: Real> Dist<D> for StudentT<D> {
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        let z = (u - self.mu) / self.sd;
        (self.nu + 1.0) * -0.5 * (z * z / self.nu).ln_1p()
    }
    fn ln_norm(&self) -> D {
        let half = self.nu * 0.5;
        ln_gamma(half + 0.5)
            - ln_gamma(half)
            - (self.nu * std::f64::consts::PI).ln() * 0.5
            - self.sd.ln()
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let unit = rand_distr::StudentT::new(self.nu.re()).ok()?;
        Some(self.mu.re() + self.sd.re() * rng.sample(unit))
    }
    fn centre(&self) -> f64 {
        self.mu.re()
    }
}

impl<D: Real> Dist<D> for Uniform<D> {
    fn support(&self) -> Support {
        Support::Interval(self.lower.re(), self.upper.re())
    }
    #[inline]
    fn constrain(&self, u: D) -> D {
        self.lower + (self.upper - self.lower) * logistic(u)
    }
    fn unconstrain(&self, x: f64) -> f64 {
        ((x - self.lower.re()) / (self.upper.re() - x)).ln()
    }
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        ln_logistic(u) + ln_logistic(-u) // the width of the density and of the Jacobian cancel
    }
    fn ln_norm(&self) -> D {
        D::from(0.0)
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let p: f64 = rng.sample(Open01);
        Some(self.lower.re() + (self.upper.re() - self.lower.re()) * p)
    }
    fn centre(&self) -> f64 {
        0.5 * (self.lower.re() + self.upper.re())
    }
}

impl<D: Real> Dist<D> for Beta<D> {
    fn support(&self) -> Support {
        Support::Interval(0.0, 1.0)
    }
    #[inline]
    fn constrain(&self, u: D) -> D {
        logistic(u)
    }
    fn unconstrain(&self, x: f64) -> f64 {
        (x / (1.0 - x)).ln()
    }
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        self.a * ln_logistic(u) + self.b * ln_logistic(-u)
    }
    fn ln_norm(&self) -> D {
        ln_gamma(self.a + self.b) - ln_gamma(self.a) - ln_gamma(self.b)
    }
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        let beta = rand_distr::Beta::new(self.a.re(), self.b.re()).ok()?;
        Some(rng.sample(beta))
    }
    fn centre(&self) -> f64 {
        (self.a / (self.a + self.b)).re()
    }
}

/// `1/(1 + e^(−u))` without overflow.
#[inline]
pub fn logistic<D: Real>(u: D) -> D {
    if u.re() >= 0.0 {
        ((-u).exp() + 1.0).recip()
    } else {
        let e = u.exp();
        e / (e + 1.0)
    }
}

/// `ln logistic(u) = −ln(1 + e^(−u))` without overflow.
#[inline]
pub fn ln_logistic<D: Real>(u: D) -> D {
    if u.re() >= 0.0 { -(-u).exp().ln_1p() } else { u - u.exp().ln_1p() }
}

/// `ln Γ(a)` for `a > 0`, by Stirling's series after a shift to `a ≥ 12`; absolute error below 1e-14.
pub fn ln_gamma<D: Real>(a: D) -> D {
    let (mut z, mut shift) = (a, D::from(1.0));
    while z.re() < 12.0 {
        shift *= z;
        z += 1.0;
    }
    let r = z.recip();
    let r2 = r * r;
    let series =
        r2 * (r2 * (r2 * (r2 * (1.0 / 1188.0) - 1.0 / 1680.0) + 1.0 / 1260.0) - 1.0 / 360.0);
    (z - 0.5) * z.ln() - z + LN_SQRT_2PI + r * (series + 1.0 / 12.0) - shift.ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{Dual, derivatives, variable};

    /// ∫ p(constrain(u)) |dx/du| du = 1, and the derivative in `u` against a difference.
    pub(super) fn check<A: Dist<f64>, B: Dist<Dual<1>>>(name: &str, plain: &A, dual: &B) {
        let h = 1e-3;
        let ln_p = |u: f64| plain.ln_kernel(u, plain.constrain(u)) + plain.ln_norm();
        let mass: f64 = (-60_000..60_000).map(|i| ln_p(f64::from(i) * h).exp() * h).sum();
        assert!((mass - 1.0).abs() < 1e-6, "{name}: mass {mass}");
        for u in [-2.1, -0.3, 0.4, 1.7] {
            let x = variable::<1>(u, 0);
            let by_dual = derivatives(&dual.ln_kernel(x, dual.constrain(x)))[0];
            let difference = (ln_p(u + 1e-5) - ln_p(u - 1e-5)) / 2e-5;
            assert!(
                (by_dual - difference).abs() < 1e-7 * (1.0 + difference.abs()),
                "{name} at {u}"
            );
            let back = plain.unconstrain(plain.constrain(u));
            assert!((back - u).abs() < 1e-12, "{name}: {back} against {u}");
        }
        let centre = plain.unconstrain(plain.centre());
        assert!(ln_p(centre).is_finite(), "{name}: centre out of support");
        for power in [1, 2] {
            let of = |k: i32| {
                let point = |i: i32| f64::from(i) * h;
                (-60_000..60_000).map(|i| ln_p(point(i)).exp() * h * point(i).powi(k)).sum::<f64>()
            };
            let (mean, sd) = (of(power), (of(2 * power) - of(power).powi(2)).sqrt());
            let drawn = sampled_moment(plain, power);
            let z = (drawn - mean) / (sd / f64::from(DRAWS).sqrt());
            assert!(z.abs() < 4.5, "{name}: power {power}: sampled {drawn}, expected {mean}");
        }
    }

    const DRAWS: u32 = 20_000;

    /// Mean of a power of `u` over draws of x.
    fn sampled_moment(prior: &impl Dist<f64>, power: i32) -> f64 {
        let mut rng: rand_chacha::ChaCha8Rng = rand::SeedableRng::from_seed([3; 32]);
        let mut u = || prior.unconstrain(prior.sample(&mut rng).unwrap()).powi(power);
        (0..DRAWS).map(|_| u()).sum::<f64>() / f64::from(DRAWS)
    }

    #[test]
    fn an_improper_prior_and_impossible_parameters_have_no_draws() {
        let mut rng: rand_chacha::ChaCha8Rng = rand::SeedableRng::from_seed([3; 32]);
        assert!(Dist::<f64>::sample(&Flat, &mut rng).is_none());
        // half of the draws within one scale of the middle, 4.5 standard errors
        let cauchy = Cauchy::<f64>(1.0, 2.0);
        let near =
            (0..DRAWS).filter(|_| (cauchy.sample(&mut rng).unwrap() - 1.0).abs() < 2.0).count();
        let half = 0.5 * f64::from(DRAWS);
        assert!((near as f64 - half).abs() < 4.5 * (0.5 * half).sqrt(), "{near}");
        assert!(Gamma::<f64>(-1.0, 1.0).sample(&mut rng).is_none());
    }

    macro_rules! families {
        ($($name:ident: $T:ident($($a:literal),*);)*) => {$(
            #[test]
            fn $name() {
                check(stringify!($T), &$T::<f64>($($a),*), &$T::<Dual<1>>($($a),*));
            }
        )*};
    }
    families! {
        normal: Normal(0.7, 1.3);
        half_normal: HalfNormal(2.0);
        half_cauchy: HalfCauchy(1.7);
        gamma: Gamma(2.5, 0.7);
        inv_gamma: InvGamma(3.0, 5.0);
        uniform: Uniform(-2.0, 5.0);
        student_t: StudentT(7.0, 0.3, 1.2);
        beta: Beta(2.0, 3.5);
        exponential: Exponential(0.5);
        log_normal: LogNormal(0.2, 0.6);
        half_student_t: HalfStudentT(7.0, 1.2);
        laplace: Laplace(0.5, 0.8);
    }

    #[test]
    fn density_values_known_in_closed_form() {
        // InvGamma(1, 5) at x = 5: 5 · 5⁻² · e⁻¹; the kernel carries the Jacobian ln x as well.
        let d = InvGamma::<f64>(1.0, 5.0);
        let ln_p = d.ln_kernel(5f64.ln(), 5.0) + d.ln_norm() - 5f64.ln();
        assert!((ln_p - (0.2f64.ln() - 1.0)).abs() < 1e-14);
        // Cauchy: 1/(2π scale) one scale from the middle
        let ln_p = RealLine::ln_density(&Cauchy::<f64>(1.0, 2.0), 3.0);
        assert!((ln_p + (4.0 * std::f64::consts::PI).ln()).abs() < 1e-14);
        // Γ(1/2) = √π, Γ(5) = 24
        assert!((ln_gamma(0.5f64) - std::f64::consts::PI.sqrt().ln()).abs() < 1e-14);
        assert!((ln_gamma(5.0f64) - 24f64.ln()).abs() < 1e-13);
        assert!((ln_gamma(1e-3f64) - libm::lgamma(1e-3)).abs() < 1e-13);
    }
}
