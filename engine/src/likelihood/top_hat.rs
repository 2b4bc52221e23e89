//! The smoothed top-hat of a bracket.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::{Bracket, Likelihood, each, widened};
use crate::num::Real;
use crate::num::lanes::{self, LANES};

/// Log likelihood of a value known only to lie in a bracket: a smoothed top-hat.
///
/// ```text
/// ln (1/N) Σᵢ Normal(f; cᵢ, s),   cᵢ = lower + (i − ½) s,   s = width / N,   N = width / 1 ms
/// ```
/// Finite for every finite `f`, and integrates to 1 over `f`. Needs both ends of the bracket.
///
/// # Source
/// Coveney et al. 2022, Methods, "Bayesian calibration"
#[derive(Clone, Copy, Debug)]
pub struct TopHat<D>(
    /// The predicted value, in the unit of the bracket.
    pub D,
);

/// `e^(−m²/2)` for m = 1 … 8; a ninth neighbour would add 2e-18.
const GAUSS: [f64; 8] = [
    0.606_530_659_712_633_4,
    0.135_335_283_236_612_7,
    0.011_108_996_538_242_306,
    0.000_335_462_627_902_511_85,
    3.726_653_172_078_671e-6,
    1.522_997_974_471_263e-8,
    2.289_734_845_645_553e-11,
    1.266_416_554_909_417_6e-14,
];

impl TopHat<f64> {
    /// Log likelihood and its first three derivatives in `f`.
    ///
    /// Let `z = (f − c_j)/s` at the nearest centre j. Then the terms are `e^(−z²/2) e^(mz − m²/2)`
    /// with `m = i − j`. They follow from each other outwards by a geometric recurrence, which
    /// takes one exponential in all. If m is drawn with these weights, the derivatives in z are `E
    /// m − z`, `Var m − 1` and the third cumulant of m.
    #[inline(always)]
    fn terms(f: f64, y: &Bracket) -> [f64; 4] {
        let x = (f - y.lower) * y.inverse_s - 0.5;
        let j = lanes::within(x.round_ties_even(), 0.0, y.last);
        let z = x - j;
        let step = lanes::exp(lanes::within(z, -40.0, 40.0)); // beyond, neighbours weigh nothing
        let steps = [step, step.recip()];
        let (mut t, n) = ([1.0; 2], [y.last - j, j]);
        let [mut s0, mut s1, mut s2, mut s3] = [1.0, 0.0, 0.0, 0.0];
        for (i, gauss) in GAUSS.iter().enumerate() {
            let m = (i + 1) as f64;
            let mut weight = [0.0; 2];
            for side in 0..2 {
                t[side] *= steps[side];
                weight[side] = if m <= n[side] { t[side] * gauss } else { 0.0 };
            }
            let [above, below] = weight;
            s0 += above + below;
            s1 += m * (above - below);
            s2 += m * m * (above + below);
            s3 += m * m * m * (above - below);
        }
        let (mean, s) = (s1 / s0, y.inverse_s);
        let value = lanes::ln(s0) - 0.5 * z * z + y.ln_norm;
        let square = s2 / s0;
        let third = s3 / s0 - 3.0 * square * mean + 2.0 * mean * mean * mean;
        [value, (mean - z) * s, (square - mean * mean - 1.0) * s * s, third * s * s * s]
    }
}

impl TopHat<f64> {
    /// [`TopHat::terms`], not inlined, so that it is compiled with eplat and not again with every
    /// model.
    #[inline(never)]
    fn terms_of_one(f: f64, y: &Bracket) -> [f64; 4] {
        TopHat::terms(f, y)
    }
}

impl<D: Real> Likelihood<D, Bracket> for TopHat<D> {
    const WIDENS: bool = true;
    fn ln_likelihood(&self, y: &Bracket) -> D {
        self.0.chain(TopHat::terms_of_one(self.0.re(), y))
    }
    #[inline(always)]
    fn ln_likelihoods(rows: [(Self, &Bracket); LANES]) -> [D; LANES] {
        let (mut f, mut y) = ([0.0; LANES], [*rows[0].1; LANES]);
        for lane in 0..LANES {
            (f[lane], y[lane]) = (rows[lane].0.0.re(), *rows[lane].1);
        }
        let [mut value, mut slope, mut curvature, mut third] = [[0.0; LANES]; 4];
        for lane in 0..LANES {
            [value[lane], slope[lane], curvature[lane], third[lane]] =
                TopHat::terms(f[lane], &y[lane]);
        }
        let mut out = [D::from(0.0); LANES];
        for lane in 0..LANES {
            let chained = [value[lane], slope[lane], curvature[lane], third[lane]];
            out[lane] = rows[lane].0.0.chain(chained);
        }
        out
    }
    fn ln_widened(&self, y: &Bracket, variance: D) -> D {
        let [ln] = widened::ln_wide([self.0], [*y], [variance]);
        ln
    }
    #[inline(always)]
    fn ln_widened_rows(rows: [(Self, &Bracket, D); LANES]) -> [D; LANES] {
        let [f, variance] = [each(rows, |(own, ..)| own.0), each(rows, |(.., variance)| variance)];
        widened::ln_wide(f, each(rows, |(_, y, _)| *y), variance)
    }
    fn location(&self) -> Option<D> {
        Some(self.0)
    }
    fn simulate(&self, like: &Bracket, _: &mut dyn Rng) -> Bracket {
        like.containing(self.0.re())
    }
    fn simulate_widened(&self, like: &Bracket, sd: f64, rng: &mut dyn Rng) -> Bracket {
        let error: f64 = rng.sample(StandardNormal);
        like.containing(self.0.re() + sd * error)
    }
    fn objection(&self, y: &Bracket) -> Option<&'static str> {
        y.is_open()
            .then_some("TopHat needs both ends of a bracket; Interval(f, sigma) takes open ones")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{LN_SQRT_2PI, Third, derivatives, variable};

    fn bracket(lower: f64, upper: f64) -> Bracket {
        Bracket::new(lower, upper).unwrap()
    }

    /// The paper's sum, term by term.
    fn top_hat_by_definition(f: f64, y: &Bracket) -> f64 {
        let n = (y.upper - y.lower).round();
        let s = (y.upper - y.lower) / n;
        let term = |i: i32| {
            let z = (f - (y.lower + (f64::from(i) - 0.5) * s)) / s;
            (-0.5 * z * z - s.ln() - LN_SQRT_2PI).exp()
        };
        ((1..=n as i32).map(term).sum::<f64>() / n).ln()
    }

    #[test]
    fn top_hat_equals_the_papers_sum() {
        for (lower, upper) in [(200.0, 210.0), (180.0, 220.0), (100.0, 101.0), (3.0, 5.5)] {
            let y = bracket(lower, upper);
            for i in 0..200 {
                let f = lower - 15.0 + 0.37 * f64::from(i);
                let (got, expected) = (TopHat(f).ln_likelihood(&y), top_hat_by_definition(f, &y));
                if expected > -600.0 {
                    assert!(
                        (got - expected).abs() < 1e-12 * (1.0 + expected.abs()),
                        "{f} in {y:?}: {got} {expected}"
                    );
                }
                assert!(got.is_finite());
            }
        }
    }

    #[test]
    fn top_hat_integrates_to_one_and_derivatives_match_differences() {
        let y = bracket(200.0, 210.0);
        let mass: f64 = (0..40_000)
            .map(|i| TopHat(185.0 + 1e-3 * f64::from(i)).ln_likelihood(&y).exp() * 1e-3)
            .sum();
        assert!((mass - 1.0).abs() < 1e-9, "{mass}");
        for f in [150.0, 199.0, 203.3, 209.99, 213.0, 260.0] {
            let value = |f: f64| TopHat(f).ln_likelihood(&y);
            let d = TopHat(variable::<1>(f, 0)).ln_likelihood(&y);
            let of = |f: f64| {
                let all = Third::from_re(f).derivative1().derivative2().derivative3();
                TopHat(all).ln_likelihood(&y)
            };
            let h = of(f);
            let e = 1e-4;
            let first = (value(f + e) - value(f - e)) / (2.0 * e);
            let second = (value(f + e) - 2.0 * value(f) + value(f - e)) / (e * e);
            assert!((derivatives(&d)[0] - first).abs() < 1e-6 * (1.0 + first.abs()), "{f}");
            assert!((h.eps1eps2 - second).abs() < 1e-4, "{f}: {} {second}", h.eps1eps2);
            let third = (of(f + e).eps1eps2 - of(f - e).eps1eps2) / (2.0 * e);
            assert!((h.eps1eps2eps3 - third).abs() < 1e-6, "{f}: {} {third}", h.eps1eps2eps3);
        }
    }
}
