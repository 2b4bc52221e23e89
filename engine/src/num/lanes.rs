//! Elementary functions of several numbers at once, in plain arithmetic that the compiler turns into
//! vector instructions. Without fused operations or a library's tables they give the same bits on
//! every machine, however wide its registers.

/// How many rows of measurements are evaluated at once: a register of AVX2.
pub const LANES: usize = 4;

/// ln 2 in two parts; the first has 21 trailing zeros, so that its multiples by an exponent are exact.
const LN_2: [f64; 2] = [0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10];

/// Adding it rounds a number below 2⁵¹ to a whole one, which then stands in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0; // 1.5 · 2⁵²

/// `x.clamp(low, high)` without its check of `low` and `high`, which keeps a loop scalar.
#[inline(always)]
#[must_use]
pub fn within(x: f64, low: f64, high: f64) -> f64 {
    let x = if x < low { low } else { x };
    if x > high { high } else { x }
}

/// `Σ c_i x^(N−1−i)` by Horner's scheme, even and odd powers apart: two short chains of operations.
#[inline(always)]
pub(crate) fn polynomial<const N: usize>(x: f64, c: &[f64; N]) -> f64 {
    let square = x * x;
    let [mut odd, mut even] = [c[0], c[1]];
    for i in (2..N).step_by(2) {
        odd = odd * square + c[i];
        even = even * square + c[i + 1];
    }
    odd * x + even
}

/// 1/n! for n = 13 … 2
const EXP: [f64; 12] = [
    1.605_904_383_682_161_5e-10,
    2.087_675_698_786_81e-9,
    2.505_210_838_544_172e-8,
    2.755_731_922_398_589_4e-7,
    2.755_731_922_398_589e-6,
    2.480_158_730_158_73e-5,
    1.984_126_984_126_984e-4,
    1.388_888_888_888_889e-3,
    8.333_333_333_333_333e-3,
    4.166_666_666_666_666_4e-2,
    1.666_666_666_666_666_6e-1,
    0.5,
];

/// `eˣ`, relative error below 3e-16; saturates beyond |x| = 708.
///
/// `x = n ln 2 + r` with |r| ≤ ½ ln 2, and the Taylor series of eʳ.
#[inline(always)]
#[must_use]
pub fn exp(x: f64) -> f64 {
    let clamped = within(x, -708.0, 708.0);
    let shifted = clamped * std::f64::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = clamped - n * LN_2[0] - n * LN_2[1];
    let series = polynomial(r, &EXP);
    let power = f64::from_bits((shifted.to_bits() << 52).wrapping_add(1023 << 52));
    (series * (r * r) + r + 1.0) * power
}

/// 1/n for n = 21, 19 … 3
const LN: [f64; 10] =
    [1. / 21., 1. / 19., 1. / 17., 1. / 15., 1. / 13., 1. / 11., 1. / 9., 1. / 7., 0.2, 1. / 3.];

/// `ln x` of positive normal numbers, error below 3e-16 of the larger of 1 and |ln x|.
///
/// `x = 2ⁿ m` with √½ ≤ m < √2, and `ln m = 2 artanh s`, `s = (m − 1)/(m + 1)`.
#[inline(always)]
#[must_use]
pub fn ln(x: f64) -> f64 {
    /// The bits of √½, and what takes them to those of 1.
    const LOWEST: u64 = 0x3fe6_a09e_667f_3bcd;
    const TO_ONE: u64 = (1023 << 52) - LOWEST;
    let bits = x.to_bits().wrapping_add(TO_ONE);
    let m = f64::from_bits((bits & ((1 << 52) - 1)) + LOWEST);
    // the exponent's bits, through the low bits of 1.5 · 2⁵², as a number
    let n = f64::from_bits((bits >> 52) | ROUND.to_bits()) - (ROUND + 1023.0);
    let s = (m - 1.0) / (m + 1.0);
    let square = s * s;
    let series = polynomial(square, &LN);
    n * LN_2[0] + (n * LN_2[1] + 2.0 * (s + s * square * series))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The standard library's functions are the oracle: half a unit in the last place, 1.1e-16.
    #[test]
    fn exp_and_ln_agree_with_the_standard_library() {
        for i in -70_000..=70_000 {
            let x = 0.01 * f64::from(i) + 1e-7 * f64::from(i % 13);
            let got = exp(x);
            assert!((got / x.exp() - 1.0).abs() < 4e-16, "exp {x}: {got}");
            let back = ln(got);
            assert!((back - got.ln()).abs() < 4e-16 * back.abs().max(1.0), "ln {got}: {back}");
        }
        for i in 1..100_000 {
            let x = 1.0 + 1.6e-5 * f64::from(i);
            assert!((ln(x) - x.ln()).abs() < 2.5e-16, "ln {x}");
        }
    }

    #[test]
    fn exp_saturates_and_one_is_exact() {
        let [tiny, one, huge, nan] = [-1e9, 0.0, f64::INFINITY, f64::NAN].map(exp);
        assert!(tiny > 0.0 && tiny < 1e-307 && huge > 1e307 && huge.is_finite() && nan.is_nan());
        assert_eq!(one.to_bits(), 1f64.to_bits());
        assert_eq!(ln(1.0).to_bits(), 0f64.to_bits());
    }
}
