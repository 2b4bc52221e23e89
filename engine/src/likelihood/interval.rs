//! The exact probability of a bracket under normal noise.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::{Bracket, Likelihood};
use crate::dist::{between, carried, ln_normal_between};
use crate::num::lanes::LANES;
use crate::num::{Argument, Real};

/// Log probability that a value measured with noise falls into a bracket, exactly.
///
/// ```text
/// ln [Φ((upper − f)/σ) − Φ((lower − f)/σ)]
/// ```
/// No bias at the edges; open ends are natural; stable in both tails.
#[derive(Clone, Copy, Debug)]
pub struct Interval<D> {
    /// The predicted value.
    pub f: D,
    /// Standard deviation of the noise, same unit.
    pub sigma: D,
}

/// See the type [`struct@Interval`].
#[allow(non_snake_case)]
#[inline]
pub fn Interval<D: Real>(f: impl Argument<D>, sigma: impl Argument<D>) -> Interval<D> {
    Interval { f: f.number(), sigma: sigma.number() }
}

/// Beyond so many standard deviations nothing is left of a probability.
const FAR: f64 = 40.0;

impl<D: Real> Interval<D> {
    /// The bracket's ends in units of σ about f. An open end is where nothing is left beyond it.
    #[inline(always)]
    fn ends(&self, y: &Bracket) -> [D; 2] {
        let z = |end: f64| (-self.f + end) / self.sigma;
        match (y.lower.is_finite(), y.upper.is_finite()) {
            (true, true) => [z(y.lower), z(y.upper)],
            (true, false) => {
                let lower = z(y.lower);
                [lower, D::from(lower.re().max(0.0) + FAR)]
            }
            (false, _) => {
                let upper = z(y.upper);
                [D::from(upper.re().min(0.0) - FAR), upper]
            }
        }
    }
}

impl<D: Real> Likelihood<D, Bracket> for Interval<D> {
    const WIDENS: bool = true;
    #[inline]
    fn ln_likelihood(&self, y: &Bracket) -> D {
        let [a, b] = self.ends(y);
        ln_normal_between(a, b)
    }
    #[inline(always)]
    fn ln_likelihoods(rows: [(Self, &Bracket); LANES]) -> [D; LANES] {
        let mut ends = [[D::from(0.0); 2]; LANES];
        let [mut a, mut b, mut value, mut of_a, mut of_b] = [[0.0; LANES]; 5];
        for lane in 0..LANES {
            ends[lane] = rows[lane].0.ends(rows[lane].1);
            (a[lane], b[lane]) = (ends[lane][0].re(), ends[lane][1].re());
        }
        for lane in 0..LANES {
            [value[lane], of_a[lane], of_b[lane]] = between(a[lane], b[lane]);
        }
        let mut out = [D::from(0.0); LANES];
        for lane in 0..LANES {
            let [a, b] = ends[lane];
            out[lane] = carried([value[lane], of_a[lane], of_b[lane]], a, b);
        }
        out
    }
    fn ln_widened(&self, y: &Bracket, variance: D) -> D {
        let sigma = (self.sigma * self.sigma + variance).sqrt();
        Interval { f: self.f, sigma }.ln_likelihood(y)
    }
    fn location(&self) -> Option<D> {
        Some(self.f)
    }
    fn simulate(&self, like: &Bracket, rng: &mut dyn Rng) -> Bracket {
        self.simulate_widened(like, 0.0, rng)
    }
    fn simulate_widened(&self, like: &Bracket, sd: f64, rng: &mut dyn Rng) -> Bracket {
        let noise: f64 = rng.sample(StandardNormal);
        like.containing(self.f.re() + self.sigma.re().hypot(sd) * noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{Dual, Hyper, Third, derivatives, variable};

    fn bracket(lower: f64, upper: f64) -> Bracket {
        Bracket::new(lower, upper).unwrap()
    }

    #[test]
    fn interval_is_exact_in_both_tails_and_with_open_ends() {
        let y = bracket(200.0, 210.0);
        let left = Interval::<f64>(100.0, 2.0).ln_likelihood(&y);
        let right = Interval::<f64>(310.0, 2.0).ln_likelihood(&y);
        assert!((left - right).abs() < 1e-9 * left.abs() && left.is_finite(), "{left} {right}");
        let (closed, below, above) = (
            Interval::<f64>(205.0, 3.0).ln_likelihood(&y).exp(),
            Interval::<f64>(205.0, 3.0).ln_likelihood(&bracket(f64::NEG_INFINITY, 200.0)).exp(),
            Interval::<f64>(205.0, 3.0).ln_likelihood(&bracket(210.0, f64::INFINITY)).exp(),
        );
        assert!((closed + below + above - 1.0).abs() < 1e-14);
    }

    #[test]
    fn interval_derivatives_match_differences() {
        for (lower, upper) in
            [(200.0, 210.0), (f64::NEG_INFINITY, 200.0), (210.0, f64::INFINITY), (150.0, 160.0)]
        {
            let y = bracket(lower, upper);
            let at = |f: f64, s: f64| Interval::<f64>(f, s).ln_likelihood(&y);
            let (f, s, e) = (207.0, 3.0, 1e-3);
            let d = Interval::<Dual<2>>(variable(f, 0), variable(s, 1)).ln_likelihood(&y);
            let by_f = (at(f + e, s) - at(f - e, s)) / (2.0 * e);
            let by_s = (at(f, s + e) - at(f, s - e)) / (2.0 * e);
            let [df, ds] = derivatives(&d);
            assert!((df - by_f).abs() < 1e-5 * (1.0 + by_f.abs()), "{y:?} {df} {by_f}");
            assert!((ds - by_s).abs() < 1e-5 * (1.0 + by_s.abs()), "{y:?} {ds} {by_s}");
            let mixed = (at(f + e, s + e) - at(f + e, s - e) - at(f - e, s + e) + at(f - e, s - e))
                / (4.0 * e * e);
            let h = Interval::<Hyper>(Hyper::new(f, 1.0, 0.0, 0.0), Hyper::new(s, 0.0, 1.0, 0.0));
            let h = h.ln_likelihood(&y).eps1eps2;
            assert!((h - mixed).abs() < 1e-4 * (1.0 + mixed.abs()), "{y:?} {h} {mixed}");
            let third = |e: f64| {
                let f = Third::new(f + 0.8 * e, 1.0, 0.5, 0.8, 0.0, 0.0, 0.0, 0.0);
                let s = Third::new(s - 0.6 * e, 0.2, 1.0, -0.6, 0.0, 0.0, 0.0, 0.0);
                Interval::<Third>(f, s).ln_likelihood(&y)
            };
            let by_second = (third(e).eps1eps2 - third(-e).eps1eps2) / (2.0 * e);
            let exact = third(0.0).eps1eps2eps3;
            assert!((exact - by_second).abs() < 1e-5 * (1.0 + by_second.abs()), "{y:?} {exact}");
        }
    }
}
