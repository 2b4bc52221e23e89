//! Logarithms of normal probabilities, exact in both tails.

use crate::num::{LN_SQRT_2PI, Partials, Real};

/// `ln Φ(z)` and its first three derivatives by the ratio `φ/Φ`.
#[inline]
pub(crate) fn ln_normal_below<D: Real>(z: D) -> D {
    let x = z.re();
    let value = ln_cdf(x);
    let ratio = (-0.5 * x * x - LN_SQRT_2PI - value).exp();
    let bend = -ratio * (x + ratio);
    z.chain([value, ratio, bend, -bend * (x + ratio) - ratio * (1.0 + bend)])
}

/// `ln (Φ(b) − Φ(a))`, a < b, as a function of two numbers with derivatives.
#[inline]
pub(crate) fn ln_normal_between<D: Real>(a: D, b: D) -> D {
    let (x, y) = (a.re(), b.re());
    // in the upper tail both probabilities are 1 − tiny: mirror, where they are tiny
    let (low, high) = if x > 0.0 { (-y, -x) } else { (x, y) };
    let ln_high = ln_cdf(high);
    // Φ(low) < e^(−low²/2), low < 0: beside Φ(high) it may be nothing, which is cheaper to see than to compute
    let value = if low < 0.0 && -0.5 * low * low < ln_high - NOTHING {
        ln_high
    } else {
        ln_high + (-(ln_cdf(low) - ln_high).exp()).ln_1p()
    };
    let density = |t: f64| (-0.5 * t * t - LN_SQRT_2PI - value).exp();
    let (da, db) = (-density(x), density(y));
    let relative = Partials {
        first: [da, db],
        second: [-x * da, 0.0, -y * db],
        third: [(x * x - 1.0) * da, 0.0, 0.0, (y * y - 1.0) * db],
    };
    relative.ln().at(value, a, b)
}

/// e to minus this is lost beside 1.
const NOTHING: f64 = 40.0;

/// `ln Φ(x)`, relative error below 1e-14 everywhere.
fn ln_cdf(x: f64) -> f64 {
    if x > -10.0 {
        return (0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2)).ln();
    }
    // Φ(x) = φ(x) / (t + 1/(t + 2/(t + 3/(t + …)))), t = −x
    // twelve levels leave 2e-17 of it where t = 10, and less beyond
    let t = -x;
    let fraction = (1..=12).rev().fold(t, |tail, n| t + f64::from(n) / tail);
    -0.5 * x * x - LN_SQRT_2PI - fraction.ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lower_tail_agrees_with_scipy() {
        // scipy.stats.norm.logcdf
        assert!((ln_cdf(-40.0) + 804.608_442_013_753_9).abs() < 1e-9);
        // the two sides of where the continued fraction begins
        assert!((ln_cdf(-10.0) + 53.231_285_150_512_48).abs() < 1e-12 * 53.0);
        assert!((ln_cdf(-9.999_999) + 53.231_275_052_419_75).abs() < 1e-10);
        assert!((ln_cdf(-12.0) + 75.410_673_001_568_8).abs() < 1e-12 * 75.0);
        assert!((ln_cdf(-5.0) + 15.064_998_393_988_725).abs() < 1e-12);
    }
}
