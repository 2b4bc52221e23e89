//! Priors that also serve as likelihoods of a number: for noise with heavy tails, and for positive
//! numbers.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::Likelihood;
use crate::dist::{
    Cauchy, Dist, Exponential, Gamma, Laplace, LogNormal, Normal, RealLine, StudentT,
};
use crate::num::lanes::LANES;
use crate::num::{LN_SQRT_2PI, Real};

impl<D: Real> Likelihood<D, f64> for Normal<D> {
    const WIDENS: bool = true;
    #[inline]
    fn ln_likelihood(&self, y: &f64) -> D {
        let z = (self.mu - *y) / self.sd;
        z * z * -0.5 - self.sd.ln() - LN_SQRT_2PI
    }
    /// Takes ln of an sd once where all rows have the same.
    #[inline(always)]
    fn ln_likelihoods(rows: [(Self, &f64); LANES]) -> [D; LANES] {
        let first = rows[0].0.sd.re();
        let ln_first = first.ln();
        rows.map(|(Normal { mu, sd }, y)| {
            let re = sd.re();
            let ln = if re.to_bits() == first.to_bits() { ln_first } else { re.ln() };
            let inverse = re.recip();
            let square = inverse * inverse;
            let z = (mu - *y) / sd;
            z * z * -0.5 - sd.chain([ln, inverse, -square, 2.0 * inverse * square]) - LN_SQRT_2PI
        })
    }
    fn ln_widened(&self, y: &f64, variance: D) -> D {
        let square = self.sd * self.sd + variance;
        let z = self.mu - *y;
        z * z / square * -0.5 - square.ln() * 0.5 - LN_SQRT_2PI
    }
    fn location(&self) -> Option<D> {
        Some(self.mu)
    }
    fn simulate(&self, like: &f64, rng: &mut dyn Rng) -> f64 {
        self.simulate_widened(like, 0.0, rng)
    }
    fn simulate_widened(&self, _: &f64, sd: f64, rng: &mut dyn Rng) -> f64 {
        let noise: f64 = rng.sample(StandardNormal);
        self.mu.re() + self.sd.re().hypot(sd) * noise
    }
}

macro_rules! real {
    ($($T:ident),*) => {$(
        impl<D: Real> Likelihood<D, f64> for $T<D> {
            #[inline]
            fn ln_likelihood(&self, y: &f64) -> D {
                self.ln_density(D::from(*y))
            }
            fn simulate(&self, _: &f64, rng: &mut dyn Rng) -> f64 {
                self.sample(rng).unwrap_or(f64::NAN)
            }
        }
    )*};
}

macro_rules! positive {
    ($($T:ident),*) => {$(
        impl<D: Real> Likelihood<D, f64> for $T<D> {
            #[inline]
            fn ln_likelihood(&self, y: &f64) -> D {
                // the prior's kernel is that of u = ln y, Jacobian y included
                self.ln_kernel(D::from(y.ln()), D::from(*y)) + self.ln_norm() - y.ln()
            }
            fn simulate(&self, _: &f64, rng: &mut dyn Rng) -> f64 {
                self.sample(rng).unwrap_or(f64::NAN)
            }
            fn objection(&self, y: &f64) -> Option<&'static str> {
                (*y <= 0.0).then_some(concat!(stringify!($T), " takes positive numbers"))
            }
        }
    )*};
}

real! { StudentT, Cauchy, Laplace }
positive! { LogNormal, Gamma, Exponential }

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{Dual, derivatives, variable};

    #[test]
    fn rows_at_once_have_the_bits_of_each_alone() {
        for sds in [[0.7; LANES], [0.7, 0.7, 1.3, 0.7], [0.3, 0.7, 1.3, 1.3]] {
            let row = |lane: usize| -> (Normal<Dual<2>>, &f64) {
                (Normal(variable(0.1 * lane as f64, 0), variable(sds[lane], 1)), &0.45)
            };
            let at_once = Likelihood::ln_likelihoods([row(0), row(1), row(2), row(3)]);
            for (lane, at_once) in at_once.iter().enumerate() {
                let (normal, y) = row(lane);
                let alone: Dual<2> = normal.ln_likelihood(y);
                assert_eq!(at_once.re.to_bits(), alone.re.to_bits());
                let slopes =
                    [derivatives(at_once), derivatives(&alone)].map(|e| e.map(f64::to_bits));
                assert_eq!(slopes[0], slopes[1]);
            }
        }
    }

    #[test]
    fn densities_integrate_to_one_over_what_is_measured() {
        fn mass(likelihood: &impl Likelihood<f64, f64>, lower: f64, upper: f64) -> f64 {
            let h = (upper - lower) / 400_000.0;
            let at = |i: i32| lower + (f64::from(i) + 0.5) * h;
            (0..400_000).map(|i| likelihood.ln_likelihood(&at(i)).exp() * h).sum()
        }
        assert!((mass(&StudentT(4.0, 1.0, 2.0), -1e3, 1e3) - 1.0).abs() < 1e-6);
        assert!((mass(&Laplace(1.0, 2.0), -60.0, 60.0) - 1.0).abs() < 1e-6);
        assert!((mass(&LogNormal(0.3, 0.5), 0.0, 60.0) - 1.0).abs() < 1e-6);
        assert!((mass(&Gamma(2.0, 0.7), 0.0, 60.0) - 1.0).abs() < 1e-6);
        assert!((mass(&Exponential(0.7), 0.0, 60.0) - 1.0).abs() < 1e-6);
        // Cauchy: P(|x − mu| < scale) = ½
        assert!((mass(&Cauchy(1.0, 2.0), -1.0, 3.0) - 0.5).abs() < 1e-9);
        assert!(Likelihood::<f64, f64>::objection(&LogNormal::<f64>(0.0, 1.0), &0.0).is_some());
    }
}
