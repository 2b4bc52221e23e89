//! Readings below which an instrument tells no more: voltages in its noise.

use rand::Rng;

use super::Likelihood;
use crate::dist::{LogNormal, Normal, ln_normal_below};
use crate::num::Real;

/// A likelihood of readings that are only known to lie at or below a floor where they are that low.
///
/// ```text
/// y > floor:  ln p(y | inner)
/// y ≤ floor:  ln P(Y ≤ floor | inner)
/// ```
/// So a reading in the noise counts as "this low or lower", whatever number was written down for it.
#[derive(Clone, Copy, Debug)]
pub struct Censored<L> {
    /// The likelihood of a reading that is not censored: `Normal` or `LogNormal`.
    pub inner: L,
    /// The lowest reading that can be told from noise, in the unit of the measurement.
    pub floor: f64,
}

/// See the type [`struct@Censored`].
#[allow(non_snake_case)]
#[inline]
pub fn Censored<L>(inner: L, floor: f64) -> Censored<L> {
    Censored { inner, floor }
}

/// A likelihood of a number that knows how probable lower numbers are.
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot be censored",
    label = "Censored takes Normal(mean, sd) or LogNormal(mean, sd); Widened and Outliers go around it"
)]
pub trait Cumulative<D: Real>: Likelihood<D, f64> {
    /// Log probability of a number of at most `y`.
    fn ln_below(&self, y: f64) -> D;
    /// The same where the predicted value is spread by a further normal error of this variance, for a likelihood that
    /// can be widened.
    fn ln_below_widened(&self, y: f64, variance: D) -> D {
        let _ = variance;
        self.ln_below(y)
    }
    /// Why there is no number as low as `floor`, if there is none.
    fn floor_objection(floor: f64) -> Option<&'static str> {
        (!floor.is_finite()).then_some("Censored takes a finite floor")
    }
}

impl<D: Real> Cumulative<D> for Normal<D> {
    fn ln_below(&self, y: f64) -> D {
        ln_normal_below((-self.mu + y) / self.sd)
    }
    fn ln_below_widened(&self, y: f64, variance: D) -> D {
        ln_normal_below((-self.mu + y) / (self.sd * self.sd + variance).sqrt())
    }
}

impl<D: Real> Cumulative<D> for LogNormal<D> {
    fn ln_below(&self, y: f64) -> D {
        ln_normal_below((-self.mu + y.ln()) / self.sd)
    }
    fn floor_objection(floor: f64) -> Option<&'static str> {
        (!floor.is_finite() || floor <= 0.0)
            .then_some("Censored(LogNormal(…)) takes a positive floor")
    }
}

impl<L> Censored<L> {
    /// What is written down of a number: itself, or, at or below the floor, what `like` has there, else the floor.
    fn reading(&self, number: f64, like: f64) -> f64 {
        if number > self.floor { number } else { like.min(self.floor) }
    }
}

impl<D: Real, L: Cumulative<D>> Likelihood<D, f64> for Censored<L> {
    const WIDENS: bool = L::WIDENS;
    #[inline]
    fn ln_likelihood(&self, y: &f64) -> D {
        if *y > self.floor { self.inner.ln_likelihood(y) } else { self.inner.ln_below(self.floor) }
    }
    fn ln_widened(&self, y: &f64, variance: D) -> D {
        if *y > self.floor {
            self.inner.ln_widened(y, variance)
        } else {
            self.inner.ln_below_widened(self.floor, variance)
        }
    }
    fn location(&self) -> Option<D> {
        self.inner.location()
    }
    fn simulate(&self, like: &f64, rng: &mut dyn Rng) -> f64 {
        self.reading(self.inner.simulate(like, rng), *like)
    }
    fn simulate_widened(&self, like: &f64, sd: f64, rng: &mut dyn Rng) -> f64 {
        self.reading(self.inner.simulate_widened(like, sd, rng), *like)
    }
    fn objection(&self, y: &f64) -> Option<&'static str> {
        // a reading of zero in the noise is no objection of a likelihood of positive numbers
        L::floor_objection(self.floor).or_else(|| self.inner.objection(&y.max(self.floor)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::likelihood::{Outliers, Widened};
    use crate::num::{Dual, Hyper, Third, derivatives, variable};

    /// scipy.stats.norm.logcdf(0.05, 0.3, 0.1), .logpdf(0.4, 0.3, 0.1); .logcdf(0.05, 0.3, sqrt(0.05));
    /// scipy.stats.norm.logcdf(log(0.05), -1, 0.8)
    #[test]
    fn readings_above_the_floor_have_a_density_and_those_below_a_probability() {
        let censored = Censored(Normal::<f64>(0.3, 0.1), 0.05);
        let ln = |y: f64| Likelihood::<f64, f64>::ln_likelihood(&censored, &y);
        assert!((ln(0.4) - 0.883_646_559_789_372_5).abs() < 1e-12, "{}", ln(0.4));
        assert!((ln(0.05) + 5.081_648_277_278_691).abs() < 1e-12, "{}", ln(0.05));
        // whatever was written down there
        assert_eq!([ln(0.0).to_bits(), ln(-3.0).to_bits()], [ln(0.05).to_bits(); 2]);
        let wide: f64 = Widened(censored, 0.2).ln_likelihood(&0.0);
        assert!((wide + 2.026_649_956_615_255).abs() < 1e-12, "{wide}");
        let positive: f64 = Censored(LogNormal::<f64>(-1.0, 0.8), 0.05).ln_likelihood(&0.0);
        assert!((positive + 5.066_602_861_168_089).abs() < 1e-12, "{positive}");
    }

    #[test]
    fn its_probabilities_add_up_to_one() {
        fn total<L: Cumulative<f64>>(censored: &Censored<L>) -> f64 {
            let h = 1e-5;
            let above = |i: i32| censored.floor + (f64::from(i) + 0.5) * h;
            let density: f64 =
                (0..2_000_000).map(|i| censored.ln_likelihood(&above(i)).exp() * h).sum();
            density + censored.ln_likelihood(&censored.floor).exp()
        }
        let normal = total(&Censored(Normal::<f64>(0.3, 0.5), 0.05));
        let positive = total(&Censored(LogNormal::<f64>(-1.0, 0.5), 0.05));
        assert!(
            (normal - 1.0).abs() < 1e-7 && (positive - 1.0).abs() < 1e-7,
            "{normal} {positive}"
        );
    }

    #[test]
    fn derivatives_up_to_the_third_match_differences() {
        let e = 1e-3;
        for (y, f, s) in [(0.0, 0.3, 0.2), (0.05, -0.4, 0.3), (0.7, 0.3, 0.2), (0.0, 6.0, 0.4)] {
            let at = |f: f64, s: f64| -> f64 { Censored(Normal(f, s), 0.05).ln_likelihood(&y) };
            let d: Dual<2> =
                Censored(Normal(variable(f, 0), variable::<2>(s, 1)), 0.05).ln_likelihood(&y);
            let e = e * s;
            let by_f = (at(f + e, s) - at(f - e, s)) / (2.0 * e);
            let by_s = (at(f, s + e) - at(f, s - e)) / (2.0 * e);
            let [df, ds] = derivatives(&d);
            assert!((df - by_f).abs() < 1e-4 * (1.0 + by_f.abs()), "{y} {f}: {df} {by_f}");
            assert!((ds - by_s).abs() < 1e-4 * (1.0 + by_s.abs()), "{y} {f}: {ds} {by_s}");
            let mixed = (at(f + e, s + e) - at(f + e, s - e) - at(f - e, s + e) + at(f - e, s - e))
                / (4.0 * e * e);
            let (first, second) = (Hyper::new(f, 1.0, 0.0, 0.0), Hyper::new(s, 0.0, 1.0, 0.0));
            let h: Hyper = Censored(Normal(first, second), 0.05).ln_likelihood(&y);
            let h = h.eps1eps2;
            assert!((h - mixed).abs() < 1e-3 * (1.0 + mixed.abs()), "{y} {f}: {h} {mixed}");
            let third = |e: f64| -> Third {
                let f = Third::new(f + 0.8 * e, 1.0, 0.5, 0.8, 0.0, 0.0, 0.0, 0.0);
                let s = Third::new(s - 0.6 * e, 0.2, 1.0, -0.6, 0.0, 0.0, 0.0, 0.0);
                Censored(Normal(f, s), 0.05).ln_likelihood(&y)
            };
            let by_second = (third(e).eps1eps2 - third(-e).eps1eps2) / (2.0 * e);
            let exact = third(0.0).eps1eps2eps3;
            assert!((exact - by_second).abs() < 1e-3 * (1.0 + by_second.abs()), "{y} {f} {exact}");
        }
    }

    #[test]
    fn replicates_are_censored_as_the_readings_are() {
        let mut rng: rand_chacha::ChaCha8Rng = rand::SeedableRng::from_seed([4; 32]);
        let likelihood = Outliers(Censored(Normal::<f64>(0.1, 0.1), 0.1), 0.0, 1.0);
        for (like, low) in [(0.4, 0.1), (0.0, 0.0)] {
            let draw = |_: &i32| Likelihood::<f64, f64>::simulate(&likelihood, &like, &mut rng);
            let drawn: Vec<f64> = (0..4000).collect::<Vec<i32>>().iter().map(draw).collect();
            let n = drawn.iter().filter(|y| y.to_bits() == f64::to_bits(low)).count() as f64;
            // half of them lie below the floor; standard error 32
            assert!((n - 2000.0).abs() < 5.0 * 32.0, "{n}");
            assert!(drawn.iter().all(|y| *y > 0.1 || y.to_bits() == f64::to_bits(low)));
        }
    }

    #[test]
    fn a_floor_that_no_number_reaches_is_refused() {
        let why = |floor: f64| {
            Likelihood::<f64, f64>::objection(&Censored(LogNormal::<f64>(0.0, 1.0), floor), &0.0)
        };
        assert!(why(0.0).is_some() && why(f64::NAN).is_some() && why(0.05).is_none());
        assert!(
            Likelihood::<f64, f64>::objection(&Censored(Normal::<f64>(0.0, 1.0), f64::NAN), &0.0)
                .is_some()
        );
    }
}
