//! Logarithms of normal probabilities, exact in both tails; without branches, so that several are computed at once.

use crate::num::lanes::{exp, ln, polynomial, within};
use crate::num::{Partials, Real};
use std::f64::consts::FRAC_1_SQRT_2;

/// (2π)^−½
const DENSITY: f64 = 0.398_942_280_401_432_7;

/// `ln Φ(z)` and its first three derivatives by the ratio `φ/Φ`.
#[inline]
pub(crate) fn ln_normal_below<D: Real>(z: D) -> D {
    let x = z.re();
    // Φ(x) = ½ E(−x) e^(−x²/2), x ≤ 0, and 1 minus the same of −x, x > 0
    let end = within(x, f64::NEG_INFINITY, 0.0);
    let weight = exp(0.5 * (end - x) * (end + x));
    let tail = 0.5 * scaled_tail(x.abs()) * weight;
    let scaled = if x > 0.0 { 1.0 - tail } else { tail };
    let value = ln(scaled) - 0.5 * end * end;
    let ratio = DENSITY * weight / scaled;
    let bend = -ratio * (x + ratio);
    z.chain([value, ratio, bend, -bend * (x + ratio) - ratio * (1.0 + bend)])
}

/// `ln (Φ(b) − Φ(a))`, a < b, as a function of two numbers with derivatives.
#[inline]
pub(crate) fn ln_normal_between<D: Real>(a: D, b: D) -> D {
    let (x, y) = (a.re(), b.re());
    carried(between(x, y), a, b)
}

/// `ln p` with p = Φ(b) − Φ(a), a < b, and `φ(a)/p`, `φ(b)/p`.
///
/// ```text
/// b ≤ 0:  p = ½ (E(−b) e^(−b²/2) − E(−a) e^(−a²/2))       E(x) = erfcx(x/√2)
/// b > 0:  p = 1 − ½ E(b) e^(−b²/2) − ½ E(−a) e^(−a²/2)    where |b| ≤ |a|; otherwise mirrored
/// ```
/// If b ≤ 0, e^(−b²/2) is taken out of all, so that nothing underflows.
#[inline(always)]
pub(crate) fn between(a: f64, b: f64) -> [f64; 3] {
    let is_mirrored = a + b > 0.0;
    let (low, high) = if is_mirrored { (-b, -a) } else { (a, b) };
    let end = within(high, f64::NEG_INFINITY, 0.0);
    let weight = |x: f64| exp(0.5 * (end - x) * (end + x));
    let (of_low, of_high) = (weight(low), weight(high));
    let (lower, upper) = (scaled_tail(low.abs()) * of_low, scaled_tail(high.abs()) * of_high);
    let scaled = if high > 0.0 { 1.0 - 0.5 * (upper + lower) } else { 0.5 * (upper - lower) };
    // of an interval that is narrower than rounding nothing would be left
    let scaled = within(scaled, f64::MIN_POSITIVE, 1.0);
    let value = ln(scaled) - 0.5 * end * end;
    let density = DENSITY / scaled;
    let (of_a, of_b) = if is_mirrored { (of_high, of_low) } else { (of_low, of_high) };
    [value, density * of_a, density * of_b]
}

/// The result of [`between`] as a function of two numbers with derivatives.
#[inline(always)]
pub(crate) fn carried<D: Real>([value, of_a, of_b]: [f64; 3], a: D, b: D) -> D {
    let (x, y) = (a.re(), b.re());
    let (da, db) = (-of_a, of_b);
    let relative = Partials {
        first: [da, db],
        second: [-x * da, 0.0, -y * db],
        third: [(x * x - 1.0) * da, 0.0, 0.0, (y * y - 1.0) * db],
    };
    relative.ln().at(value, a, b)
}

/// (1 + 2t) erfcx(t) = (1 + 2t) e^(t²) erfc(t) as a polynomial in (t − 4)/(t + 4), highest power first: its Chebyshev
/// series up to what is lost beside 1, computed with 40 digits.
const SCALED: [f64; 24] = [
    9.331_544_424_872_868e-10,
    1.573_409_926_655_632_2e-9,
    -1.235_912_023_057_646_2e-8,
    -1.637_014_124_048_599_3e-8,
    1.063_712_161_433_159_2e-7,
    7.115_106_988_460_933e-8,
    -8.211_430_378_661_427e-7,
    2.980_145_347_657_409e-7,
    5.706_650_361_268_39e-6,
    -1.122_510_101_088_373_6e-5,
    -2.439_777_414_416_837_3e-5,
    1.506_230_958_801_324_9e-4,
    -1.992_571_357_651_541e-4,
    -7.577_737_063_398_299e-4,
    5.031_970_064_962_648e-3,
    -1.619_773_398_166_162e-2,
    3.716_751_552_696_009e-2,
    -6.633_036_582_028_03e-2,
    9.373_283_499_906_108e-2,
    -1.010_390_660_358_676e-1,
    6.809_705_425_467_034e-2,
    1.537_965_210_261_053_5e-2,
    -1.396_211_168_405_623e-1,
    1.232_995_118_625_552_6,
];

/// erfcx(x/√2), x ≥ 0, relative error below 1e-15.
///
/// # Source
/// The form is that of Shepherd and Laframboise, "Chebyshev approximation of (1 + 2x) exp(x²) erfc x", 1981.
#[inline(always)]
fn scaled_tail(x: f64) -> f64 {
    let t = x * FRAC_1_SQRT_2;
    polynomial((t - 4.0) / (t + 4.0), &SCALED) / (1.0 + 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ln_cdf(x: f64) -> f64 {
        ln_normal_below(x)
    }

    #[test]
    fn the_lower_tail_agrees_with_scipy() {
        // scipy.stats.norm.logcdf
        assert!((ln_cdf(-40.0) + 804.608_442_013_753_9).abs() < 1e-9);
        assert!((ln_cdf(-10.0) + 53.231_285_150_512_48).abs() < 1e-12 * 53.0);
        assert!((ln_cdf(-9.999_999) + 53.231_275_052_419_75).abs() < 1e-10);
        assert!((ln_cdf(-12.0) + 75.410_673_001_568_8).abs() < 1e-12 * 75.0);
        assert!((ln_cdf(-5.0) + 15.064_998_393_988_725).abs() < 1e-12);
    }

    #[test]
    fn probabilities_agree_with_those_of_60_digits() {
        for (a, b, expected) in [
            (-1.0, 2.0, -0.200_166_294_324_462_58),
            (-3.0, -2.5, -5.326_764_724_079_062),
            (-12.0, -11.0, -63.824_943_392_209_645),
            (-40.0, -39.5, -784.720_879_106_624),
            (-300.0, -299.0, -44_707.119_393_291_84),
            (0.1, 0.1001, -10.134_283_906_843_461),
            (5.0, 9.0, -15.064_998_393_989_12),
            (20.0, 23.0, -203.9171553710973),
            (-0.5, 40.0, -0.368_946_415_288_656_4),
            (-7.0, 8.0, -1.280_434_639_944_081_9e-12),
        ] {
            let [value, of_a, of_b] = between(a, b);
            // what a difference of two near numbers leaves
            let narrow = 1e-15 / (b - a).min(1.0);
            let most = 2e-15 * f64::abs(expected).max(1.0) + narrow;
            assert!((value - expected).abs() < most, "{a} {b}: {value}");
            let density = |x: f64| (-0.5 * x * x - expected).exp() * DENSITY;
            for (own, x) in [(of_a, a), (of_b, b)] {
                assert!((own - density(x)).abs() < 1e-11 * (1e-9 + density(x)), "{a} {b}: {own}");
            }
        }
    }

    #[test]
    fn both_forms_agree_with_the_error_function_of_libm() {
        for i in -3700..=3700 {
            let x = 0.01 * f64::from(i) + 1e-3;
            let known = 0.5 * libm::erfc(-x * FRAC_1_SQRT_2);
            let own = ln_cdf(x).exp();
            assert!((own - known).abs() < 1e-13 * (1.0 + x * x) * known, "{x}: {own} {known}");
            let between = between(x - 1.0, x)[0].exp();
            let known = if x > 0.5 {
                0.5 * (libm::erfc((x - 1.0) * FRAC_1_SQRT_2) - libm::erfc(x * FRAC_1_SQRT_2))
            } else {
                known - 0.5 * libm::erfc((1.0 - x) * FRAC_1_SQRT_2)
            };
            assert!((between - known).abs() < 1e-12 * (1.0 + x * x) * known, "{x}: {between}");
        }
    }

    #[test]
    fn far_away_all_is_finite() {
        for (a, b) in [(1e8, 1e8 + 1.0), (-1e12, -1e12 + 1.0), (-1e3, 1e3), (1.0, 1.0 + 1e-17)] {
            assert!(between(a, b).iter().all(|x| x.is_finite()), "{a} {b}: {:?}", between(a, b));
        }
        assert!(ln_cdf(-1e12).is_finite() && ln_cdf(1e12).abs() < 1e-300);
    }
}
