//! Measurements compared with a prediction that is itself uncertain.

use pulp::{Arch, NullaryFnOnce};
use rand::Rng;

use super::{Bracket, Likelihood, Observation, each};
use crate::num::lanes::{LANES, exp, ln, within};
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
    #[inline(always)]
    fn ln_likelihoods(rows: [(Self, &Y); LANES]) -> [D; LANES] {
        L::ln_widened_rows(each(rows, |(own, y)| (own.inner, y, own.sd * own.sd)))
    }
    fn ln_widened(&self, y: &Y, variance: D) -> D {
        self.inner.ln_widened(y, self.sd * self.sd + variance)
    }
    #[inline(always)]
    fn ln_widened_rows(rows: [(Self, &Y, D); LANES]) -> [D; LANES] {
        let further = |(own, y, variance): (Self, _, D)| (own.inner, y, own.sd * own.sd + variance);
        L::ln_widened_rows(each(rows, further))
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

/// ln p of widened [`TopHat`](super::TopHat)s at the numbers `f`, each with the `variance` of its further error.
pub(super) fn ln_wide<D: Real, const L: usize>(
    f: [D; L],
    y: [Bracket; L],
    variance: [D; L],
) -> [D; L] {
    let mut of = Wide { f: [0.0; L], y, further: [0.0; L] };
    for lane in 0..L {
        (of.f[lane], of.further[lane]) = (f[lane].re(), variance[lane].re());
    }
    let terms = match D::ORDER {
        0 => of.terms::<0>(),
        1 => of.terms::<1>(),
        2 => of.terms::<2>(),
        _ => of.terms::<3>(),
    };
    let mut out = f;
    for (lane, (value, partials)) in terms.into_iter().enumerate() {
        out[lane] = partials.at(value, f[lane], variance[lane]);
    }
    out
}

/// Widened [`TopHat`](super::TopHat)s: values, brackets, and variances of further errors.
struct Wide<const L: usize> {
    f: [f64; L],
    y: [Bracket; L],
    further: [f64; L],
}

impl<const L: usize> Wide<L> {
    /// Compiled here, with vector registers where there are several, and not again with every model.
    #[inline(never)]
    fn terms<const ORDER: u32>(&self) -> [(f64, Partials); L] {
        if L == 1 {
            self.terms_inlined::<ORDER>()
        } else {
            Arch::new().dispatch(InLanes::<L, ORDER>(self))
        }
    }

    /// ln p of each, with its derivatives in f and in the further variance v up to `ORDER`. Higher ones are left at
    /// zero: most calls ask for the first alone.
    ///
    /// ```text
    /// p = (1/N) Σᵢ Normal(f; cᵢ, V),   V = s² + v;   with x = (f − cᵢ)/√V and Hₖ the mean of Heₖ(x) under the terms:
    /// ∂ᵏp/∂fᵏ = (−1)ᵏ Hₖ p/V^(k/2),   ∂p/∂v = ½ ∂²p/∂f²
    /// ```
    /// Let z be the x of the nearest centre and d = s/√V. The m-th centre beside it has the weight
    /// e^(±mzd − m²d²/2), relative to the nearest. The weights follow from each other outwards by a
    /// recurrence, which takes two exponentials in all.
    #[inline(always)]
    fn terms_inlined<const ORDER: u32>(&self) -> [(f64, Partials); L] {
        let Self { f, y, further } = self;
        let [mut sd, mut z, mut d, mut twice, mut sum] = [[0.0; L]; 5];
        // centres above the nearest and below it, the ratio of the next weight to the last one, and the last
        let [mut n, mut ratio, mut weight] = [[[0.0; L]; 2], [[0.0; L]; 2], [[1.0; L]; 2]];
        let mut hermite = [[0.0; L]; 6];
        let mut add = |lane: usize, weight: f64, x: f64| {
            let square = x * x;
            sum[lane] += weight;
            if ORDER > 0 {
                hermite[0][lane] += weight * x;
                hermite[1][lane] += weight * (square - 1.0);
            }
            if ORDER > 1 {
                hermite[2][lane] += weight * x * (square - 3.0);
                hermite[3][lane] += weight * (square * (square - 6.0) + 3.0);
            }
            if ORDER > 2 {
                hermite[4][lane] += weight * x * (square * (square - 10.0) + 15.0);
                hermite[5][lane] += weight * (square * (square * (square - 15.0) + 45.0) - 15.0);
            }
        };
        for lane in 0..L {
            let s = y[lane].inverse_s.recip();
            sd[lane] = (s * s + further[lane]).sqrt();
            let place = within((f[lane] - y[lane].lower) * y[lane].inverse_s, 0.0, y[lane].last);
            let nearest = place.floor();
            z[lane] = (f[lane] - (y[lane].lower + (nearest + 0.5) * s)) / sd[lane];
            d[lane] = s / sd[lane];
            let (step, gauss) = (exp(z[lane] * d[lane]), exp(-0.5 * d[lane] * d[lane]));
            twice[lane] = gauss * gauss;
            (n[0][lane], n[1][lane]) = (y[lane].last - nearest, nearest);
            (ratio[0][lane], ratio[1][lane]) = (step * gauss, step.recip() * gauss);
            add(lane, 1.0, z[lane]);
        }
        let most = n.as_flattened().iter().fold(0.0, |most: f64, n| most.max(*n));
        for m in 1..=most as u32 {
            let m = f64::from(m);
            for (side, sign) in [1.0, -1.0].into_iter().enumerate() {
                if L == 1 && m > n[side][0] {
                    continue;
                }
                for lane in 0..L {
                    weight[side][lane] *= ratio[side][lane];
                    ratio[side][lane] *= twice[lane];
                    let own = if m <= n[side][lane] { weight[side][lane] } else { 0.0 };
                    add(lane, own, z[lane] - sign * m * d[lane]);
                }
            }
        }
        let [mut value, mut scale] = [[0.0; L], [1.0; L]];
        for lane in 0..L {
            let ln_norm = -ln(y[lane].last + 1.0) - LN_SQRT_2PI - ln(sd[lane]);
            value[lane] = ln(sum[lane]) - 0.5 * z[lane] * z[lane] + ln_norm;
        }
        // derivatives of p in f, of order 1 to 6, divided by p
        for hermite in &mut hermite {
            for lane in 0..L {
                scale[lane] /= -sd[lane];
                hermite[lane] *= scale[lane] / sum[lane];
            }
        }
        let nothing = Partials { first: [0.0; 2], second: [0.0; 3], third: [0.0; 4] };
        let mut out = [(0.0, nothing); L];
        for lane in 0..L {
            let [f1, f2, f3, f4, f5, f6] = &hermite;
            let [f1, f2, f3] = [f1[lane], f2[lane], f3[lane]];
            let [f4, f5, f6] = [f4[lane], f5[lane], f6[lane]];
            let relative = Partials {
                first: [f1, 0.5 * f2],
                second: [f2, 0.5 * f3, 0.25 * f4],
                third: [f3, 0.5 * f4, 0.25 * f5, 0.125 * f6],
            };
            out[lane] = (value[lane], relative.ln());
        }
        out
    }
}

/// [`Wide::terms_inlined`] with the machine's vector registers.
struct InLanes<'a, const L: usize, const ORDER: u32>(&'a Wide<L>);

impl<const L: usize, const ORDER: u32> NullaryFnOnce for InLanes<'_, L, ORDER> {
    type Output = [(f64, Partials); L];
    #[inline(always)]
    fn call(self) -> Self::Output {
        self.0.terms_inlined::<ORDER>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dist::{Normal, StudentT};
    use crate::likelihood::{Interval, Outliers, TopHat};
    use crate::num::{Dual, Hyper, Num, Third, derivatives, variable};

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
    fn several_at_once_are_the_same_bits_as_one_by_one() {
        let y = [(200.0, 210.0), (180.0, 220.0), (100.0, 101.0), (3.0, 5.5)];
        let y = y.map(|(lower, upper)| bracket(lower, upper));
        for shift in [-400.0, -20.0, -3.0, 0.7, 4.2, 31.0, 900.0] {
            for sd in [0.0, 0.3, 2.5, 40.0] {
                let row = |i: usize| {
                    let (f, sd) =
                        (variable::<2>(y[i].lower + shift, 0), variable(sd + i as f64, 1));
                    Outliers(Widened(Widened(TopHat(Num(f)), 0.5), Num(sd)), 0.0, 0.0)
                };
                let own = |i: usize| (row(i), &y[i]);
                let at_once = Likelihood::ln_likelihoods([own(0), own(1), own(2), own(3)]);
                let further = Num(Dual::from(2.0));
                let wider = [0, 1, 2, 3].map(|i| (row(i), &y[i], further));
                let wider = Likelihood::ln_widened_rows(wider);
                for (i, y) in y.iter().enumerate() {
                    let one = [row(i).ln_likelihood(y), row(i).ln_widened(y, further)];
                    let of = [at_once[i], wider[i]];
                    for (of, one) in of.into_iter().zip(one) {
                        let bits = |x: Num<Dual<2>>| {
                            let [a, b] = derivatives(&x.0);
                            [x.0.re, a, b].map(f64::to_bits)
                        };
                        assert!(one.0.re.is_finite(), "{shift} {sd} {i}");
                        assert_eq!(bits(of), bits(one), "{shift} {sd} {i}: {of:?} {one:?}");
                    }
                }
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
