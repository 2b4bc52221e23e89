//! The two special functions that the diagnostics need: normal and beta quantiles.

use libm::lgamma;

/// Φ⁻¹(p) for 0 < p < 1, to about 1e-16 relative.
///
/// # Source
/// Wichura 1988, algorithm AS 241 (PPND16).
pub fn normal_quantile(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180_625 - q * q;
        return q * ratio(r, &CENTRE);
    }
    let tail = if q < 0.0 { p } else { 1.0 - p };
    let r = (-tail.ln()).sqrt();
    let x = if r <= 5.0 { ratio(r - 1.6, &SHOULDER) } else { ratio(r - 5.0, &TAIL) };
    x.copysign(q)
}

/// Numerator and denominator coefficients, from the constant up.
type Rational = [[f64; 8]; 2];

fn ratio(r: f64, [numerator, denominator]: &Rational) -> f64 {
    let horner = |c: &[f64; 8]| c.iter().rev().fold(0.0, |sum, c| sum * r + c);
    horner(numerator) / horner(denominator)
}

#[allow(clippy::excessive_precision, reason = "as published")]
const CENTRE: Rational = [
    [
        3.387_132_872_796_366_608,
        133.141_667_891_784_377_45,
        1_971.590_950_306_551_442_7,
        13_731.693_765_509_461_125,
        45_921.953_931_549_871_457,
        67_265.770_927_008_700_853,
        33_430.575_583_588_128_105,
        2_509.080_928_730_122_672_7,
    ],
    [
        1.0,
        42.313_330_701_600_911_252,
        687.187_007_492_057_908_3,
        5_394.196_021_424_751_107_7,
        21_213.794_301_586_595_867,
        39_307.895_800_092_710_61,
        28_729.085_735_721_942_674,
        5_226.495_278_852_854_561,
    ],
];
#[allow(clippy::excessive_precision, reason = "as published")]
const SHOULDER: Rational = [
    [
        1.423_437_110_749_683_577_34,
        4.630_337_846_156_545_295_9,
        5.769_497_221_460_691_405_5,
        3.647_848_324_763_204_605_04,
        1.270_458_252_452_368_382_58,
        0.241_780_725_177_450_611_77,
        0.022_723_844_989_269_184_583_3,
        7.745_450_142_783_414_076_4e-4,
    ],
    [
        1.0,
        2.053_191_626_637_758_821_87,
        1.676_384_830_183_803_849_4,
        0.689_767_334_985_100_004_55,
        0.148_103_976_427_480_074_59,
        0.015_198_666_563_616_457_196_6,
        5.475_938_084_995_344_946e-4,
        1.050_750_071_644_416_843_24e-9,
    ],
];
#[allow(clippy::excessive_precision, reason = "as published")]
const TAIL: Rational = [
    [
        6.657_904_643_501_103_777_2,
        5.463_784_911_164_114_369_9,
        1.784_826_539_917_291_335_8,
        0.296_560_571_828_504_891_23,
        0.026_532_189_526_576_123_093,
        1.242_660_947_388_078_438_6e-3,
        2.711_555_568_743_487_578_15e-5,
        2.010_334_399_292_288_132_65e-7,
    ],
    [
        1.0,
        0.599_832_206_555_887_937_69,
        0.136_929_880_922_735_805_31,
        0.014_875_361_290_850_614_852_5,
        7.868_691_311_456_132_591e-4,
        1.846_318_317_510_054_681_8e-5,
        1.421_511_758_316_445_888_7e-7,
        2.044_263_103_389_939_785_64e-15,
    ],
];

/// The x at which the distribution function of Beta(a, b) is p, for a, b ≥ 1; by bisection.
pub(super) fn beta_quantile(p: f64, a: f64, b: f64) -> f64 {
    if !(a.is_finite() && b.is_finite()) {
        return f64::NAN;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if beta_distribution(middle, a, b) < p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Probability that Beta(a, b) lies above x.
pub fn beta_above(x: f64, a: f64, b: f64) -> f64 {
    1.0 - beta_distribution(x, a, b)
}

/// Distribution function of Beta(a, b), by its continued fraction on the side where that converges.
fn beta_distribution(x: f64, a: f64, b: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return x.clamp(0.0, 1.0);
    }
    let ln_front = lgamma(a + b) - lgamma(a) - lgamma(b) + a * x.ln() + b * (-x).ln_1p();
    if x < (a + 1.0) / (a + b + 2.0) {
        ln_front.exp() * beta_fraction(x, a, b) / a
    } else {
        1.0 - ln_front.exp() * beta_fraction(1.0 - x, b, a) / b
    }
}

/// The continued fraction DLMF 8.17.22, by Lentz's method; a few √max(a, b) terms.
fn beta_fraction(x: f64, a: f64, b: f64) -> f64 {
    const MAX_TERMS: u32 = 10_000;
    let keep_off_zero = |y: f64| if y.abs() < 1e-300 { 1e-300 } else { y };
    let mut c = 1.0;
    let mut d = 1.0 / keep_off_zero(1.0 - (a + b) * x / (a + 1.0));
    let mut fraction = d;
    for m in 1..=MAX_TERMS {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        let before = fraction;
        for coefficient in [even, odd] {
            d = 1.0 / keep_off_zero(1.0 + coefficient * d);
            c = keep_off_zero(1.0 + coefficient / c);
            fraction *= c * d;
        }
        if (fraction - before).abs() <= 1e-15 * fraction.abs() {
            break;
        }
    }
    fraction
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_quantiles_agree_with_scipy() {
        for (p, x) in NORMAL {
            assert!((normal_quantile(p) / x - 1.0).abs() < 1e-14, "{p}: {}", normal_quantile(p));
        }
        assert!(normal_quantile(0.5).abs() < 1e-300);
    }

    #[test]
    fn beta_quantiles_agree_with_scipy() {
        for (p, a, b, x) in BETA {
            assert!((beta_quantile(p, a, b) / x - 1.0).abs() < 1e-10, "{p} {a} {b}");
        }
        assert!(beta_quantile(0.5, f64::NAN, 1.0).is_nan());
    }

    /// scipy 1.18.1, `stats.norm.ppf`.
    const NORMAL: [(f64, f64); 6] = [
        (1e-20, -9.262_340_089_798_409),
        (0.000_15, -3.615_300_006_924_662),
        (0.03, -1.880_793_608_151_251),
        (0.2, -0.841_621_233_572_914_2),
        (0.7, 0.524_400_512_708_040_7),
        (0.999_9, 3.719_016_485_455_709),
    ];

    /// scipy 1.18.1, `stats.beta.ppf`.
    const BETA: [(f64, f64, f64, f64); 4] = [
        (0.158_655_3, 21.3, 381.7, 0.041_783_867_971_008_55),
        (0.841_344_7, 2001.0, 2001.0, 0.507_903_716_901_447_5),
        (0.3, 1.0, 5.5, 0.062_791_956_407_631_92),
        (0.9, 950.0, 51.0, 0.957_742_109_983_057_4),
    ];
}
