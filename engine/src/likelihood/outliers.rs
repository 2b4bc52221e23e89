//! Measurements some of which are further off than their likelihood says.

use rand::{Rng, RngExt};

use super::{Likelihood, Observation, each, widened::NOT_WIDENED};
use crate::num::Real;
use crate::num::lanes::LANES;

/// A likelihood under which a share of the measurements has a further normal error.
///
/// ```text
/// p(y) = (1 − share) p(y | inner) + share p(y | inner, widened by sd)
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Outliers<L> {
    /// The likelihood of the others: one that can be widened.
    pub inner: L,
    /// Share of outlying measurements, from 0 to below 1.
    pub share: f64,
    /// Standard deviation of their further error, in the unit of the measurement.
    pub sd: f64,
}

/// See the type [`struct@Outliers`].
#[allow(non_snake_case)]
#[inline]
pub fn Outliers<L>(inner: L, share: f64, sd: f64) -> Outliers<L> {
    Outliers { inner, share, sd }
}

impl<L> Outliers<L> {
    /// The mixture of the two log likelihoods.
    fn mixed<D: Real>(&self, plain: D, wide: D) -> D {
        let (plain, wide) = (plain + (-self.share).ln_1p(), wide + self.share.ln());
        let (low, high) = if plain.re() < wide.re() { (plain, wide) } else { (wide, plain) };
        high + (low - high).exp().ln_1p()
    }
}

impl<D: Real, Y: Observation, L: Likelihood<D, Y>> Likelihood<D, Y> for Outliers<L> {
    const WIDENS: bool = L::WIDENS;
    fn ln_likelihood(&self, y: &Y) -> D {
        let plain = self.inner.ln_likelihood(y);
        if self.share > 0.0 {
            self.mixed(plain, self.inner.ln_widened(y, D::from(self.sd * self.sd)))
        } else {
            plain
        }
    }
    #[inline(always)]
    fn ln_likelihoods(rows: [(Self, &Y); LANES]) -> [D; LANES] {
        if rows.iter().all(|(own, _)| own.share == 0.0) {
            return L::ln_likelihoods(each(rows, |(own, y)| (own.inner, y)));
        }
        each(rows, |(own, y)| own.ln_likelihood(y))
    }
    #[inline(always)]
    fn ln_widened_rows(rows: [(Self, &Y, D); LANES]) -> [D; LANES] {
        if rows.iter().all(|(own, ..)| own.share == 0.0) {
            return L::ln_widened_rows(each(rows, |(own, y, variance)| (own.inner, y, variance)));
        }
        each(rows, |(own, y, variance)| own.ln_widened(y, variance))
    }
    fn ln_widened(&self, y: &Y, variance: D) -> D {
        let plain = self.inner.ln_widened(y, variance);
        if self.share > 0.0 {
            self.mixed(plain, self.inner.ln_widened(y, variance + self.sd * self.sd))
        } else {
            plain
        }
    }
    fn location(&self) -> Option<D> {
        self.inner.location()
    }
    fn simulate(&self, like: &Y, rng: &mut dyn Rng) -> Y {
        if self.share > 0.0 && rng.random::<f64>() < self.share {
            self.inner.simulate_widened(like, self.sd, rng)
        } else {
            self.inner.simulate(like, rng)
        }
    }
    fn simulate_widened(&self, like: &Y, sd: f64, rng: &mut dyn Rng) -> Y {
        let is_outlying = self.share > 0.0 && rng.random::<f64>() < self.share;
        self.inner.simulate_widened(like, if is_outlying { sd.hypot(self.sd) } else { sd }, rng)
    }
    fn objection(&self, y: &Y) -> Option<&'static str> {
        if !(0.0..1.0).contains(&self.share) || !(self.sd > 0.0 || self.share == 0.0) {
            return Some("Outliers takes a share from 0 to below 1 and a positive sd");
        }
        if self.share > 0.0 && !L::WIDENS {
            return Some(NOT_WIDENED);
        }
        self.inner.objection(y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dist::Normal;
    use crate::likelihood::{Bracket, Interval, TopHat};
    use crate::num::{derivatives, variable};

    #[test]
    fn of_a_normal_it_is_the_mixture_of_two() {
        let y = 14.0;
        let (near, far) = (Normal::<f64>(10.0, 1.0), Normal::<f64>(10.0, 26.0f64.sqrt()));
        let mixture = 0.9 * near.ln_likelihood(&y).exp() + 0.1 * far.ln_likelihood(&y).exp();
        let got = Outliers(near, 0.1, 5.0).ln_likelihood(&y);
        assert!((got - mixture.ln()).abs() < 1e-12, "{got} {}", mixture.ln());
    }

    #[test]
    fn of_a_bracket_its_probabilities_add_up_to_one_and_its_derivative_is_that_of_differences() {
        let brackets = (0..400).map(|i| 10.0 * f64::from(i) - 1800.0);
        let mass: f64 = brackets
            .map(|lower| {
                let y = Bracket::new(lower, lower + 10.0).unwrap();
                Outliers(Interval::<f64>(203.0, 2.0), 0.2, 40.0).ln_likelihood(&y).exp()
            })
            .sum();
        assert!((mass - 1.0).abs() < 1e-9, "{mass}");
        let y = Bracket::new(200.0, 210.0).unwrap();
        for f in [150.0, 195.0, 204.0, 260.0] {
            let at = |f: f64| Outliers(TopHat(f), 0.1, 40.0).ln_likelihood(&y);
            let d = Outliers(TopHat(variable::<1>(f, 0)), 0.1, 40.0).ln_likelihood(&y);
            let difference = (at(f + 1e-4) - at(f - 1e-4)) / 2e-4;
            assert!((derivatives(&d)[0] - difference).abs() < 1e-6, "{f}");
        }
    }

    #[test]
    fn its_share_of_simulated_measurements_is_far_off() {
        let mut rng: rand_chacha::ChaCha8Rng = rand::SeedableRng::from_seed([1; 32]);
        let likelihood = Outliers(Normal::<f64>(0.0, 1.0), 0.25, 1000.0);
        let far = |_: &i32| likelihood.simulate(&0.0, &mut rng).abs() > 10.0;
        let n = (0..4000).filter(far).count() as f64;
        // 99.2 % of the outlying are beyond 10; standard error 27
        assert!((n - 992.0).abs() < 5.0 * 27.0, "{n}");
    }

    #[test]
    fn a_share_beyond_one_is_refused() {
        let y = Bracket::new(200.0, 210.0).unwrap();
        let why =
            |share| Likelihood::<f64, _>::objection(&Outliers(TopHat(205.0), share, 40.0), &y);
        assert!(why(1.5).is_some() && why(0.1).is_none());
    }
}
