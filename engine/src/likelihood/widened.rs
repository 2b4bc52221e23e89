//! Measurements compared with a prediction that is itself uncertain.

use rand::Rng;

use super::{Bracket, Likelihood, Observation, TopHat};
use crate::num::lanes::exp;
use crate::num::{Argument, LN_SQRT_2PI, Partials, Real};

/// A likelihood whose predicted value has a further normal error, such as that of an emulator.
///
/// ```text
/// of TopHat(f) the variance s² becomes s² + sd²;   of Interval(f, σ) and Normal(f, σ), σ² becomes σ² + sd²
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Widened<D, L> {
    /// The likelihood if the prediction were exact: `TopHat`, `Interval` or `Normal`.
    pub inner: L,
    /// Standard deviation of the prediction, in the unit of the measurement.
    pub sd: D,
}

/// See the type [`struct@Widened`].
#[allow(non_snake_case)]
#[inline]
pub fn Widened<D: Real, L>(inner: L, sd: impl Argument<D>) -> Widened<D, L> {
    Widened { inner, sd: sd.number() }
}

/// Why a likelihood that cannot be widened is refused.
pub(crate) const NOT_WIDENED: &str =
    "only a likelihood with a normal error can be widened: TopHat, Interval or Normal";

impl<D: Real, Y: Observation, L: Likelihood<D, Y>> Likelihood<D, Y> for Widened<D, L> {
    const WIDENS: bool = L::WIDENS;

    fn ln_likelihood(&self, y: &Y) -> D {
        self.inner.ln_widened(y, self.sd * self.sd)
    }
    fn ln_widened(&self, y: &Y, variance: D) -> D {
        self.inner.ln_widened(y, self.sd * self.sd + variance)
    }
    fn location(&self) -> Option<D> {
        self.inner.location()
    }
    fn simulate(&self, like: &Y, rng: &mut dyn Rng) -> Y {
        self.inner.simulate_widened(like, self.sd.re(), rng)
    }
    fn simulate_widened(&self, like: &Y, sd: f64, rng: &mut dyn Rng) -> Y {
        self.inner.simulate_widened(like, self.sd.re().hypot(sd), rng)
    }
    fn objection(&self, y: &Y) -> Option<&'static str> {
        if L::WIDENS { self.inner.objection(y) } else { Some(NOT_WIDENED) }
    }
}

/// ln p of a widened [`TopHat`], with its derivatives in f and in the further variance v up to `ORDER`. Higher ones are left at
/// zero: most calls ask for the first alone.
///
/// ```text
/// p = (1/N) Σᵢ Normal(f; cᵢ, V),   V = s² + v;   with x = (f − cᵢ)/√V and Hₖ the mean of Heₖ(x) under the terms:
/// ∂ᵏp/∂fᵏ = (−1)ᵏ Hₖ p/V^(k/2),   ∂p/∂v = ½ ∂²p/∂f²
/// ```
/// Let z be the x of the nearest centre and d = s/√V. The m-th centre beside it has the weight
/// e^(±mzd − m²d²/2), relative to the nearest. The weights follow from each other outwards by a
/// recurrence, which takes two exponentials in all.
fn wide_terms<const ORDER: u32>(f: f64, y: &Bracket, further: f64) -> (f64, Partials) {
    let s = y.inverse_s.recip();
    let variance = s * s + further;
    let sd = variance.sqrt();
    let nearest = ((f - y.lower) * y.inverse_s).clamp(0.0, y.last).floor();
    let (z, d) = ((f - (y.lower + (nearest + 0.5) * s)) / sd, s / sd);
    let (step, gauss) = (exp(z * d), exp(-0.5 * d * d));
    let (mut sum, mut hermite) = (0.0, [0.0; 6]);
    let mut add = |weight: f64, x: f64| {
        let square = x * x;
        sum += weight;
        if ORDER > 0 {
            hermite[0] += weight * x;
            hermite[1] += weight * (square - 1.0);
        }
        if ORDER > 1 {
            hermite[2] += weight * x * (square - 3.0);
            hermite[3] += weight * (square * (square - 6.0) + 3.0);
        }
        if ORDER > 2 {
            hermite[4] += weight * x * (square * (square - 10.0) + 15.0);
            hermite[5] += weight * (square * (square * (square - 15.0) + 45.0) - 15.0);
        }
    };
    add(1.0, z);
    for (n, step, d) in [(y.last - nearest, step, d), (nearest, step.recip(), -d)] {
        let (mut weight, mut ratio) = (1.0, step * gauss);
        for m in 1..=n as u32 {
            weight *= ratio;
            ratio *= gauss * gauss;
            add(weight, z - f64::from(m) * d);
        }
    }
    // derivatives of p in f, of order 1 to 6, divided by p
    let mut scale = 1.0;
    let [f1, f2, f3, f4, f5, f6] = hermite.map(|h| {
        scale /= -sd;
        h / sum * scale
    });
    let ln_norm = -(y.last + 1.0).ln() - LN_SQRT_2PI - sd.ln();
    let relative = Partials {
        first: [f1, 0.5 * f2],
        second: [f2, 0.5 * f3, 0.25 * f4],
        third: [f3, 0.5 * f4, 0.25 * f5, 0.125 * f6],
    };
    (sum.ln() - 0.5 * z * z + ln_norm, relative.ln())
}

impl<D: Real> TopHat<D> {
    /// ln p at numbers that carry derivatives.
    pub(super) fn ln_wide(&self, y: &Bracket, variance: D) -> D {
        let terms = match D::ORDER {
            0 => wide_terms::<0>,
            1 => wide_terms::<1>,
            2 => wide_terms::<2>,
            _ => wide_terms::<3>,
        };
        let (value, partials) = terms(self.0.re(), y, variance.re());
        partials.at(value, self.0, variance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dist::{Normal, StudentT};
    use crate::likelihood::Interval;
    use crate::num::{Dual, Hyper, Third, derivatives, variable};

    fn bracket(lower: f64, upper: f64) -> Bracket {
        Bracket::new(lower, upper).unwrap()
    }

    #[test]
    fn of_a_top_hat_it_is_the_papers_sum_with_a_larger_variance() {
        let y = bracket(200.0, 210.0);
        for (f, sd) in [(203.2, 0.5), (195.0, 3.0), (230.0, 4.0)] {
            let variance: f64 = 1.0 + sd * sd;
            let term = |i: i32| {
                let z = f - (200.5 + f64::from(i));
                (-0.5 * z * z / variance).exp() / (std::f64::consts::TAU * variance).sqrt()
            };
            let expected = (0.1 * (0..10).map(term).sum::<f64>()).ln();
            let got: f64 = Widened(TopHat(f), sd).ln_likelihood(&y);
            assert!((got - expected).abs() < 1e-12 * expected.abs(), "{got} {expected}");
        }
        let exact: f64 = TopHat(203.2).ln_likelihood(&y);
        let none: f64 = Widened(TopHat(203.2), 0.0).ln_likelihood(&y);
        assert!((exact - none).abs() < 1e-12);
    }

    #[test]
    fn derivatives_in_value_and_sd_match_differences() {
        let y = bracket(200.0, 210.0);
        let e = 1e-3;
        for (f, sd) in [(203.2, 0.5), (195.0, 3.0), (230.0, 4.0)] {
            let at = |f: f64, sd: f64| Widened(TopHat(f), sd).ln_likelihood(&y);
            let d: Dual<2> =
                Widened(TopHat(variable(f, 0)), variable::<2>(sd, 1)).ln_likelihood(&y);
            let by_f = (at(f + e, sd) - at(f - e, sd)) / (2.0 * e);
            let by_sd = (at(f, sd + e) - at(f, sd - e)) / (2.0 * e);
            let [df, ds] = derivatives(&d);
            assert!((df - by_f).abs() < 1e-6 && (ds - by_sd).abs() < 1e-6, "{d:?} {by_f} {by_sd}");
            // mixed directions reach every second derivative
            let shifts = [[1.0, 0.0], [0.0, 1.0], [0.7, -0.4]];
            for ([a, b], [c, d]) in shifts.iter().zip([[1.0, 0.0], [0.0, 1.0], [0.2, 0.9]]) {
                let point = |i: f64, j: f64| at(f + e * (i * a + j * c), sd + e * (i * b + j * d));
                let mixed = (point(1.0, 1.0) - point(1.0, -1.0) - point(-1.0, 1.0)
                    + point(-1.0, -1.0))
                    / (4.0 * e * e);
                let h = Widened(TopHat(Hyper::new(f, *a, c, 0.0)), Hyper::new(sd, *b, d, 0.0));
                let h = h.ln_likelihood(&y).eps1eps2;
                assert!((h - mixed).abs() < 1e-4 * (1.0 + mixed.abs()), "{f} {sd}: {h} {mixed}");
                let third = |e: f64| {
                    let point = |x: f64, i: usize| {
                        let seed = [[*a, *b][i], [c, d][i], [0.6, -1.1][i]];
                        Third::new(x, seed[0], seed[1], seed[2], 0.0, 0.0, 0.0, 0.0)
                    };
                    let (f, sd) = (point(f + 0.6 * e, 0), point(sd - 1.1 * e, 1));
                    Widened(TopHat(f), sd).ln_likelihood(&y)
                };
                let by_second = (third(e).eps1eps2 - third(-e).eps1eps2) / (2.0 * e);
                let exact = third(0.0).eps1eps2eps3;
                assert!((exact - by_second).abs() < 1e-4 * (1.0 + by_second.abs()), "{f} {sd}");
            }
        }
    }

    #[test]
    fn of_an_interval_and_a_normal_variances_add_up() {
        let y = bracket(200.0, 210.0);
        let got: f64 = Widened(Interval(204.0, 3.0), 4.0).ln_likelihood(&y);
        let expected: f64 = Interval(204.0, 5.0).ln_likelihood(&y);
        assert!((got - expected).abs() < 1e-14);
        let got: f64 = Widened(Normal(204.0, 3.0), 4.0).ln_likelihood(&200.0);
        let expected: f64 = Normal(204.0, 5.0).ln_likelihood(&200.0);
        assert!((got - expected).abs() < 1e-14);
    }

    #[test]
    fn simulated_measurements_have_the_spread() {
        let mut rng: rand_chacha::ChaCha8Rng = rand::SeedableRng::from_seed([2; 32]);
        let likelihood = Widened(Normal(0.0, 3.0), 4.0);
        let n = 4000;
        let square = |_: i32| Likelihood::<f64, f64>::simulate(&likelihood, &0.0, &mut rng).powi(2);
        let variance = (0..n).map(square).sum::<f64>() / f64::from(n);
        // standard error of a variance 25: 25 √(2/n) = 0.56
        assert!((variance - 25.0).abs() < 4.5 * 0.56, "{variance}");
    }

    #[test]
    fn what_cannot_be_widened_is_refused() {
        let why = Widened::<f64, _>(StudentT::<f64>(4.0, 0.0, 1.0), 2.0).objection(&0.0);
        assert_eq!(why, Some(NOT_WIDENED));
        assert_eq!(Widened::<f64, _>(Normal::<f64>(0.0, 1.0), 2.0).objection(&0.0), None);
    }
}
