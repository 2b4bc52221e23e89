//! The link of a field that stays in its range.
//!
//! ```text
//! value = low + (high − low)/(1 + exp(−4 (x − centre)/(high − low)))     centre = (low + high)/2
//! ```
//! Near the centre the value is `x` itself, with slope 1, so `x` has the value's unit. Towards the ends it
//! bends.

use super::Num;
use super::Real;

/// The open interval that values are bent into.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Within {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Beyond this logit the value is an end of the interval, to rounding.
const FURTHEST: f64 = 36.0;

impl Within {
    fn slope(self) -> f64 {
        4.0 / (self.high - self.low)
    }

    /// The value at `x`.
    #[inline]
    pub fn value(self, x: f64) -> f64 {
        self.bent(x)[0]
    }

    /// The `x` of a value. An end of the interval, or a value beyond it, has the `x` whose value is that end to
    /// rounding.
    pub fn inverse(self, value: f64) -> f64 {
        let Self { low, high } = self;
        let logit = ((value - low).max(0.0) / (high - value).max(0.0)).ln();
        0.5 * (low + high) + logit.clamp(-FURTHEST, FURTHEST) / self.slope()
    }

    /// The value at `x` with two derivatives.
    #[inline]
    fn bent(self, x: f64) -> [f64; 3] {
        let Self { low, high } = self;
        let slope = self.slope();
        let share = 1.0 / (1.0 + (slope * (0.5 * (low + high) - x)).exp());
        let first = 4.0 * share * (1.0 - share);
        [low + (high - low) * share, first, slope * first * (1.0 - 2.0 * share)]
    }
}

/// `x` bent into the interval: what `field f(x) within LOW..HIGH` makes of the field's sum.
#[inline]
pub fn within<T: Real>(low: f64, high: f64, x: Num<T>) -> Num<T> {
    let [value, first, second] = Within { low, high }.bent(x.0.re());
    Num(x.0.chain(value, first, second))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::Hyper;

    const RANGE: Within = Within { low: 1.0, high: 30.0 };

    #[test]
    fn it_is_the_number_itself_at_the_centre_and_the_ends_far_away() {
        for (x, value) in [(15.5, 15.5), (-1e4, 1.0), (1e4, 30.0)] {
            assert!((RANGE.value(x) - value).abs() < 1e-12, "{x}");
        }
        assert!((RANGE.value(15.6) - 15.6).abs() < 1e-4);
    }

    #[test]
    fn derivatives_are_those_of_num_dual() {
        for x in [-20.0, 3.0, 15.5, 29.0, 60.0] {
            let x = Hyper::new(x, 1.0, 1.0, 0.0);
            let logit = (x - 15.5) * (4.0 / 29.0);
            let expected = (-logit + 0.0).exp().inv_plus_one() * 29.0 + 1.0;
            let Num(got) = within(1.0, 30.0, Num(x));
            for (a, b) in [
                (got.re, expected.re),
                (got.eps1, expected.eps1),
                (got.eps1eps2, expected.eps1eps2),
            ] {
                assert!((a - b).abs() < 1e-12, "{a} {b}");
            }
        }
    }

    /// 1/(1 + x)
    trait InvPlusOne {
        fn inv_plus_one(self) -> Self;
    }
    impl InvPlusOne for Hyper {
        fn inv_plus_one(self) -> Self {
            num_dual::DualNum::recip(&(self + 1.0))
        }
    }

    #[test]
    fn the_inverse_finds_the_number_and_takes_the_ends_and_what_is_beyond() {
        for x in [-15.0, 3.0, 15.5, 29.0, 50.0] {
            assert!((RANGE.inverse(RANGE.value(x)) - x).abs() < 1e-9, "{x}");
        }
        for end in [1.0, 30.0] {
            assert!((RANGE.value(RANGE.inverse(end)) - end).abs() < 1e-12, "{end}");
        }
        assert!((RANGE.value(RANGE.inverse(31.0)) - 30.0).abs() < 1e-12);
    }
}
