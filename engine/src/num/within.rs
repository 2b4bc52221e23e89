//! The link of a field that stays in its range.
//!
//! ```text
//! value = low + s ln((1 + e^((x − low)/s)) / (1 + e^((x − high)/s))),     s = (high − low)/20
//! ```
//! Inside the range the value is `x` itself, so `x` has the value's unit. Near an end, within some s of it, the
//! value bends and approaches the end.

use super::lanes::{exp, ln};
use super::{Num, Real};

/// The open interval that values are bent into.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Within {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// So many s is the interval wide.
const SOFTNESS: f64 = 20.0;
/// So many s beyond an end the value is that end, to rounding.
const FURTHEST: f64 = 36.0;

impl Within {
    fn scale(self) -> f64 {
        (self.high - self.low) / SOFTNESS
    }

    /// The value at `x`.
    #[inline]
    pub fn value(self, x: f64) -> f64 {
        self.bent(x)[0]
    }

    /// The `x` of a value. An end of the interval, or a value beyond it, has the `x` whose value is that end to
    /// rounding.
    pub fn inverse(self, value: f64) -> f64 {
        // e^((x − low)/s) = (e^t − 1)/(1 − e^(t − 20)) with t = (value − low)/s
        let t = ((value - self.low) / self.scale()).clamp(0.0, SOFTNESS);
        let x = t + (-(-t).exp_m1()).ln() - (-(t - SOFTNESS).exp_m1()).ln();
        self.low + self.scale() * x.clamp(-FURTHEST, SOFTNESS + FURTHEST)
    }

    /// The value at `x` with three derivatives.
    #[inline(always)]
    fn bent(self, x: f64) -> [f64; 4] {
        let s = self.scale();
        let [low, high] = softplus([(x - self.low) / s, (x - self.high) / s]);
        let mut of_both = [0.0; 4];
        for k in 0..4 {
            of_both[k] = low[k] - high[k];
        }
        let [value, first, second, third] = of_both;
        [(self.low + s * value).min(self.high), first, second / s, third / (s * s)]
    }
}

/// ln(1 + eᵗ) and its three derivatives, at two places. What is lost of a small eᵗ is lost in the value in any case.
#[inline(always)]
fn softplus(t: [f64; 2]) -> [[f64; 4]; 2] {
    let mut out = [[0.0; 4]; 2];
    for (t, out) in t.into_iter().zip(&mut out) {
        let e = exp(-t.abs());
        let inverse = 1.0 / (1.0 + e);
        let share = if t > 0.0 { inverse } else { e * inverse };
        let second = e * inverse * inverse;
        *out = [t.max(0.0) + ln(1.0 + e), share, second, second * (1.0 - 2.0 * share)];
    }
    out
}

/// `x` bent into the interval: what `field f(x) within LOW..HIGH` makes of the field's sum.
#[inline(always)]
pub fn within<T: Real>(low: f64, high: f64, x: Num<T>) -> Num<T> {
    Num(x.0.chain(Within { low, high }.bent(x.0.re())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::Third;
    use num_dual::DualNum as _;

    const RANGE: Within = Within { low: 1.0, high: 30.0 };

    #[test]
    fn it_is_the_number_itself_inside_and_the_ends_far_away() {
        for (x, value) in [(15.5, 15.5), (-1e4, 1.0), (1e4, 30.0)] {
            assert!((RANGE.value(x) - value).abs() < 1e-12, "{x}");
        }
        for x in [6.0, 10.0, 25.0] {
            assert!((RANGE.value(x) - x).abs() < 0.05, "{x}");
        }
    }

    #[test]
    fn derivatives_are_those_of_num_dual() {
        for x in [-5.0, 1.5, 3.0, 15.5, 29.0, 33.0] {
            let x = Third::from_re(x).derivative1().derivative2().derivative3();
            let s = 29.0 / 20.0;
            let softplus = |end: f64| (((x - end) / s).exp() + 1.0).ln();
            let expected = (softplus(1.0) - softplus(30.0)) * s + 1.0;
            let Num(got) = within(1.0, 30.0, Num(x));
            for (a, b) in [
                (got.re, expected.re),
                (got.eps1, expected.eps1),
                (got.eps1eps2, expected.eps1eps2),
                (got.eps1eps2eps3, expected.eps1eps2eps3),
            ] {
                assert!((a - b).abs() < 1e-10, "{a} {b}");
            }
        }
    }

    #[test]
    fn the_inverse_finds_the_number_and_takes_the_ends_and_what_is_beyond() {
        for x in [-5.0, 1.5, 3.0, 15.5, 29.0, 36.0] {
            assert!((RANGE.inverse(RANGE.value(x)) - x).abs() < 1e-6, "{x}");
        }
        for (value, end) in [(1.0, 1.0), (30.0, 30.0), (0.0, 1.0), (31.0, 30.0)] {
            assert!((RANGE.value(RANGE.inverse(value)) - end).abs() < 1e-9, "{value}");
        }
    }
}
