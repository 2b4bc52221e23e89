//! Priors between bounds that may depend on parameters, and priors without a normaliser.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::{Dist, Support, ln_logistic, ln_normal_below, ln_normal_between, logistic};
use crate::num::{LN_SQRT_2PI, Real};

/// The improper constant density on the positive half-line: a Stan parameter with `<lower=0>` and no
/// prior.
#[derive(Clone, Copy, Debug)]
pub struct FlatPositive;

impl<D: Real> Dist<D> for FlatPositive {
    positive!();
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        u
    }
    fn ln_norm(&self) -> D {
        D::from(0.0)
    }
    fn centre(&self) -> f64 {
        1.0
    }
}

family! {
    /// The constant density 1 on `(lower, upper)`, either of which may be infinite: what a Stan
    /// parameter with bounds and no prior has. It is not normalised. So bounds that depend on
    /// parameters cut a region out of a flat density, and do not give narrow intervals a higher
    /// density. [`Uniform`](super::Uniform) has the density 1/(upper − lower) instead.
    FlatBetween(lower: "lower end", upper: "upper end");
    /// Normal distribution cut off outside `(lower, upper)`, either of which may be infinite: density
    /// `Normal(x; mu, sd) / (Φ((upper − mu)/sd) − Φ((lower − mu)/sd))`.
    TruncatedNormal(mu: "mean before the cut", sd: "standard deviation before the cut", lower: "lower end", upper: "upper end");
}

/// Transform of an interval with none, one or two finite ends: `a + (b − a) logistic(u)`, `a + eᵘ`,
/// `b − eᵘ` or `u`.
#[derive(Clone, Copy, Debug)]
struct Bounds<D> {
    lower: D,
    upper: D,
}

impl<D: Real> Bounds<D> {
    fn are_finite(&self) -> (bool, bool) {
        (self.lower.re() > f64::NEG_INFINITY, self.upper.re() < f64::INFINITY)
    }

    fn support(&self) -> Support {
        match self.are_finite() {
            (false, false) => Support::Real,
            _ => Support::Interval(self.lower.re(), self.upper.re()),
        }
    }

    #[inline]
    fn constrain(&self, u: D) -> D {
        match self.are_finite() {
            (true, true) => self.lower + (self.upper - self.lower) * logistic(u),
            (true, false) => self.lower + u.exp(),
            (false, true) => self.upper - u.exp(),
            (false, false) => u,
        }
    }

    fn unconstrain(&self, x: f64) -> f64 {
        let (a, b) = (self.lower.re(), self.upper.re());
        match self.are_finite() {
            (true, true) => ((x - a) / (b - x)).ln(),
            (true, false) => (x - a).ln(),
            (false, true) => (b - x).ln(),
            (false, false) => x,
        }
    }

    /// `ln |dx/du|` without [`Bounds::ln_width`].
    #[inline]
    fn ln_jacobian(&self, u: D) -> D {
        match self.are_finite() {
            (true, true) => ln_logistic(u) + ln_logistic(-u),
            (false, false) => D::from(0.0),
            _ => u,
        }
    }

    fn ln_width(&self) -> D {
        if self.are_finite() == (true, true) {
            (self.upper - self.lower).ln()
        } else {
            D::from(0.0)
        }
    }

    /// A point inside the bounds. If only one end is finite, it is `step` away from that.
    fn inside(&self, step: f64) -> f64 {
        let (a, b) = (self.lower.re(), self.upper.re());
        match self.are_finite() {
            (true, true) => 0.5 * (a + b),
            (true, false) => a + step,
            (false, true) => b - step,
            (false, false) => 0.0,
        }
    }
}

/// The methods of a prior that follow from its [`Bounds`].
macro_rules! bounded {
    () => {
        fn support(&self) -> Support {
            self.bounds().support()
        }
        #[inline]
        fn constrain(&self, u: D) -> D {
            self.bounds().constrain(u)
        }
        fn unconstrain(&self, x: f64) -> f64 {
            self.bounds().unconstrain(x)
        }
    };
}

impl<D: Real> FlatBetween<D> {
    fn bounds(&self) -> Bounds<D> {
        Bounds { lower: self.lower, upper: self.upper }
    }
}

impl<D: Real> Dist<D> for FlatBetween<D> {
    bounded!();
    #[inline]
    fn ln_kernel(&self, u: D, _: D) -> D {
        self.bounds().ln_jacobian(u)
    }
    fn ln_norm(&self) -> D {
        self.bounds().ln_width()
    }
    fn centre(&self) -> f64 {
        self.bounds().inside(1.0)
    }
}

impl<D: Real> TruncatedNormal<D> {
    fn bounds(&self) -> Bounds<D> {
        Bounds { lower: self.lower, upper: self.upper }
    }

    /// ln of the mass that is not cut off.
    fn ln_mass(&self) -> D {
        let z = |end: D| (end - self.mu) / self.sd;
        match self.bounds().are_finite() {
            (true, true) => ln_normal_between(z(self.lower), z(self.upper)),
            (true, false) => ln_normal_below(-z(self.lower)),
            (false, true) => ln_normal_below(z(self.upper)),
            (false, false) => D::from(0.0),
        }
    }
}

impl<D: Real> Dist<D> for TruncatedNormal<D> {
    bounded!();
    #[inline]
    fn ln_kernel(&self, u: D, x: D) -> D {
        let z = (x - self.mu) / self.sd;
        z * z * -0.5 + self.bounds().ln_jacobian(u)
    }
    fn ln_norm(&self) -> D {
        self.bounds().ln_width() - self.ln_mass() - self.sd.ln() - LN_SQRT_2PI
    }
    fn centre(&self) -> f64 {
        let mu = self.mu.re();
        let is_inside = self.lower.re() < mu && mu < self.upper.re();
        if is_inside { mu } else { self.bounds().inside(self.sd.re()) }
    }
    /// A draw by rejection; `None` if the bounds leave next to no probability.
    fn sample(&self, rng: &mut dyn Rng) -> Option<f64> {
        const TRIES: usize = 100_000;
        let draw = |_| self.mu.re() + self.sd.re() * rng.sample::<f64, _>(StandardNormal);
        (0..TRIES).map(draw).find(|x| self.lower.re() < *x && *x < self.upper.re())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::check;
    use super::*;
    use crate::num::{Dual, derivatives, variable};

    /// The same with derivatives.
    fn truncated(mu: f64, sd: f64, lower: f64, upper: f64) {
        let name = format!("TruncatedNormal({mu}, {sd}, {lower}, {upper})");
        let plain = TruncatedNormal::<f64>(mu, sd, lower, upper);
        check(&name, &plain, &TruncatedNormal::<Dual<1>>(mu, sd, lower, upper));
    }

    #[test]
    fn a_normal_cut_anywhere_keeps_its_mass() {
        truncated(0.4, 1.3, f64::NEG_INFINITY, f64::INFINITY);
        truncated(1.0, 0.5, 0.0, f64::INFINITY);
        truncated(-2.0, 1.0, 0.0, f64::INFINITY); // mostly cut off
        truncated(0.3, 2.0, f64::NEG_INFINITY, 1.0);
        truncated(0.3, 2.0, -1.0, 1.5);
    }

    /// ∫∫ over alpha in (0, 1) and beta in (0, 1 − alpha) of `f`, by the unknowns' density.
    fn triangle(f: impl Fn(f64, f64) -> f64) -> f64 {
        let (h, half) = (0.05, 400);
        let mut sum = 0.0;
        for i in -half..half {
            for j in -half..half {
                let u = [h * f64::from(i), h * f64::from(j)];
                let first = FlatBetween::<f64>(0.0, 1.0);
                let alpha = first.constrain(u[0]);
                let second = FlatBetween::<f64>(0.0, 1.0 - alpha);
                let beta = second.constrain(u[1]);
                let ln_p = first.ln_kernel(u[0], alpha)
                    + first.ln_norm()
                    + second.ln_kernel(u[1], beta)
                    + second.ln_norm();
                sum += f(alpha, beta) * ln_p.exp() * h * h;
            }
        }
        sum
    }

    #[test]
    fn bounds_that_depend_on_a_parameter_cut_out_a_flat_triangle() {
        // area 1/2, mean of each 1/3; Uniform(0, 1 − alpha) would give mean alpha 1/2
        assert!((triangle(|_, _| 1.0) - 0.5).abs() < 1e-6);
        assert!((triangle(|alpha, _| alpha) - 0.5 / 3.0).abs() < 1e-6);
        assert!((triangle(|_, beta| beta) - 0.5 / 3.0).abs() < 1e-6);
    }

    #[test]
    fn derivatives_in_the_bounds_match_differences() {
        let u = 0.4;
        let ln_p = |a: f64, b: f64| {
            let prior = TruncatedNormal::<f64>(0.2, 1.5, a, b);
            prior.ln_kernel(u, prior.constrain(u)) + prior.ln_norm()
        };
        let (a, b, e) = (-1.0, 2.0, 1e-5);
        let prior = TruncatedNormal::<Dual<2>>(0.2, 1.5, variable::<2>(a, 0), variable::<2>(b, 1));
        let u = Dual::from(u);
        let [da, db] = derivatives(&(prior.ln_kernel(u, prior.constrain(u)) + prior.ln_norm()));
        assert!((da - (ln_p(a + e, b) - ln_p(a - e, b)) / (2.0 * e)).abs() < 1e-8);
        assert!((db - (ln_p(a, b + e) - ln_p(a, b - e)) / (2.0 * e)).abs() < 1e-8);
    }

    #[test]
    fn flat_densities_are_one_and_have_no_draws() {
        let mut rng: rand_chacha::ChaCha8Rng = rand::SeedableRng::from_seed([3; 32]);
        assert!(Dist::<f64>::sample(&FlatPositive, &mut rng).is_none());
        for (lower, upper, x) in
            [(2.0, 5.0, 3.1), (2.0, f64::INFINITY, 7.0), (f64::NEG_INFINITY, 2.0, -4.0)]
        {
            let prior = FlatBetween::<f64>(lower, upper);
            assert!(prior.sample(&mut rng).is_none());
            let u = prior.unconstrain(x);
            let slope = (prior.constrain(u + 1e-6) - prior.constrain(u - 1e-6)) / 2e-6;
            let ln_p = prior.ln_kernel(u, x) + prior.ln_norm() - slope.abs().ln();
            assert!(ln_p.abs() < 1e-8, "{lower} {upper}: {ln_p}");
            assert!(prior.unconstrain(prior.centre()).is_finite());
        }
    }
}
