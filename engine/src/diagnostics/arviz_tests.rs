//! Every figure against `ArviZ` 1.3.0 (`arviz_stats` 1.3.3) on chains that a linear congruential
//! generator makes on both sides: x ← φ x + (u₁ + u₂ + u₃ − 1.5), draw xᵖ + shift · chain.

use super::*;

struct Case {
    name: &'static str,
    seed: u64,
    chains: usize,
    draws: usize,
    phi: f64,
    shift: f64,
    power: i32,
    /// R̂, bulk, tail and mean ESS, MCSE of mean, sd, 5 % quantile and median, mean, sd, quantiles
    /// at 5, 50, 95 %, E-BFMI of the first chain.
    figures: [f64; 14],
}

const CASES: [Case; 6] = [
    Case {
        name: "white noise",
        seed: 1,
        chains: 4,
        draws: 1000,
        phi: 0.0,
        shift: 0.0,
        power: 1,
        figures: [
            0.999_774_779_311_340_7,
            4_095.350_017_958_197_4,
            3_892.304_342_633_351,
            4_092.355_337_654_637,
            0.007_798_367_063_162_276,
            0.005_006_147_958_214_582,
            0.014_696_432_462_988_906,
            0.014_112_473_863_419_073,
            0.001_169_429_610_919_737_1,
            0.498_873_392_509_235_6,
            -0.837_276_010_779_835_8,
            0.006_259_978_083_160_922,
            0.813_845_777_083_017,
            2.020_102_411_961_799,
        ],
    },
    Case {
        name: "slow, odd length",
        seed: 2,
        chains: 3,
        draws: 501,
        phi: 0.95,
        shift: 0.0,
        power: 1,
        figures: [
            1.075_201_956_503_558_4,
            57.204_950_262_269_165,
            160.213_836_466_701_4,
            57.046_873_971_944_32,
            0.185_792_659_869_846_4,
            0.075_697_697_860_272_86,
            0.214_218_563_307_963_18,
            0.180_236_042_593_406_86,
            0.026_777_190_640_770_766,
            1.403_280_459_794_291_4,
            -2.272_073_909_033_554_4,
            -0.018_907_821_483_988_84,
            2.372_042_318_830_437_6,
            0.108_102_334_371_289_69,
        ],
    },
    Case {
        name: "antithetic",
        seed: 3,
        chains: 4,
        draws: 400,
        phi: -0.6,
        shift: 0.0,
        power: 1,
        figures: [
            1.001_810_499_387_122_4,
            5_126.591_972_249_479,
            1_420.784_756_953_518,
            5_126.591_972_249_479,
            0.008_428_728_077_264_995,
            0.013_531_604_525_699_703,
            0.024_010_686_275_086_07,
            0.013_229_175_022_351_922,
            0.003_208_599_415_300_774_6,
            0.603_498_812_210_502_6,
            -0.977_284_704_456_883_2,
            0.005_427_372_359_706_684,
            1.012_274_319_247_765,
            3.181_589_682_756_462,
        ],
    },
    Case {
        name: "shifted chains",
        seed: 4,
        chains: 4,
        draws: 250,
        phi: 0.3,
        shift: 0.4,
        power: 1,
        figures: [
            1.357_661_324_797_017_7,
            9.475_804_190_344_737,
            78.716_866_911_619_55,
            9.403_810_388_244_72,
            0.227_652_269_249_325_1,
            0.031_688_103_377_267_796,
            0.145_498_582_074_525_82,
            0.252_930_269_286_023_9,
            0.604_253_749_515_393,
            0.698_110_090_899_168_8,
            -0.592_158_896_721_513_7,
            0.590_432_096_033_610_2,
            1.759_787_006_627_031_6,
            1.326_543_359_036_832,
        ],
    },
    Case {
        name: "heavy tails, short",
        seed: 5,
        chains: 2,
        draws: 50,
        phi: 0.5,
        shift: 0.0,
        power: 3,
        figures: [
            1.050_839_746_260_265_4,
            32.832_543_408_767_954,
            57.699_069_782_309_905,
            46.398_135_204_213_84,
            0.063_892_274_356_595_63,
            0.098_580_151_582_383_97,
            0.428_187_550_415_377_54,
            0.000_593_182_514_725_462,
            -0.104_752_071_240_781_74,
            0.435_209_744_617_859_83,
            -0.769_751_467_884_682_1,
            -9.542_308_473_627_519e-06,
            0.334_112_923_032_783_34,
            1.579_482_972_414_913_3,
        ],
    },
    Case {
        name: "nearly a random walk",
        seed: 6,
        chains: 4,
        draws: 300,
        phi: 0.999,
        shift: 0.0,
        power: 1,
        figures: [
            1.138_710_610_403_003_1,
            19.172_602_271_264_857,
            26.351_213_468_498_18,
            19.118_963_146_180_17,
            0.828_632_501_022_710_6,
            0.482_025_362_230_952_66,
            1.608_159_608_651_892_6,
            1.214_484_867_776_196_4,
            4.553_586_128_222_086,
            3.623_215_215_116_932,
            -2.021_016_130_872_139_3,
            4.597_944_245_174_216,
            9.988_374_136_143_017,
            0.031_215_301_026_096_06,
        ],
    },
];

/// Knuth's MMIX generator; the upper 53 bits as a number in [0, 1).
fn uniform(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

fn autoregressive(case: &Case) -> Vec<Vec<f64>> {
    let mut state = case.seed;
    let chain = |i: usize| {
        let mut x = 0.0;
        let draw = |_| {
            x = case.phi * x + (0..3).map(|_| uniform(&mut state)).sum::<f64>() - 1.5;
            x.powi(case.power) + case.shift * i as f64
        };
        (0..case.draws).map(draw).collect()
    };
    (0..case.chains).map(chain).collect()
}

fn slices(chains: &[Vec<f64>]) -> Vec<&[f64]> {
    chains.iter().map(Vec::as_slice).collect()
}

#[test]
fn every_figure_agrees_with_arviz() {
    for case in &CASES {
        let chains = autoregressive(case);
        let chains = slices(&chains);
        let summary = summarise(&chains);
        let got = [
            summary.r_hat,
            summary.ess_bulk,
            summary.ess_tail,
            ess_mean(&chains),
            summary.mcse,
            mcse_sd(&chains),
            mcse_quantile(&chains, 0.05),
            mcse_quantile(&chains, 0.5),
            summary.mean,
            summary.sd,
            summary.q5,
            summary.q50,
            summary.q95,
            e_bfmi(chains[0]),
        ];
        for (k, (got, want)) in got.iter().zip(&case.figures).enumerate() {
            assert!((got / want - 1.0).abs() < 1e-8, "{} figure {k}: {got} {want}", case.name);
        }
    }
}

#[test]
fn degenerate_chains_give_nan_and_no_panic() {
    let constant = [1.5; 40];
    let summary = summarise(&[&constant, &constant]);
    assert!(summary.r_hat.is_nan() && summary.ess_bulk.is_nan() && summary.ess_tail.is_nan());
    assert!(summary.mcse.is_nan() && summary.sd.abs() < 1e-15);
    assert!((summary.mean - 1.5).abs() < 1e-15 && (summary.q5 - 1.5).abs() < 1e-15);

    let mut with_nan = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
    with_nan[3] = f64::NAN;
    let ok = [0.0, 1.0, 0.5, 0.2, 0.1, 0.9];
    for chains in [
        vec![&with_nan[..], &ok[..]],
        vec![&ok[..3]],
        vec![&ok[..], &ok[..5]],
        vec![&[][..]],
        vec![],
    ] {
        let summary = summarise(&chains);
        assert!(summary.r_hat.is_nan() && summary.ess_bulk.is_nan() && summary.ess_tail.is_nan());
        assert!(summary.mcse.is_nan() && summary.q50.is_nan());
        assert!(mcse_sd(&chains).is_nan() && mcse_quantile(&chains, 0.5).is_nan());
    }
    assert!(r_hat(&[&ok]).is_nan(), "one chain cannot be compared");
    assert!(summarise(&[&ok]).ess_bulk.is_finite());
}

#[test]
fn two_chains_stuck_apart_have_an_infinite_r_hat_and_are_not_nan_elsewhere() {
    let summary = summarise(&[&[0.0; 20], &[1.0; 20]]);
    assert!(summary.r_hat > 100.0);
    assert!(summary.ess_bulk < 10.0, "{summary:?}");
}

#[test]
fn quantiles_of_values_in_any_order_are_those_of_sorted_ones() {
    let asked = [0.0, 0.05, 0.5, 0.5, 0.95, 1.0];
    for n in 0..60_u32 {
        // ties, and both signs
        let values: Vec<f64> = (0..n).map(|i| f64::from(i * 37 % 23) - 9.5).collect();
        let mut sorted = values.clone();
        sorted.sort_by(f64::total_cmp);
        let [of_sorted, of_any] =
            [asked.map(|p| quantile(&sorted, p)), quantiles(&mut values.clone(), asked)];
        assert_eq!(of_sorted.map(f64::to_bits), of_any.map(f64::to_bits), "{n} values");
    }
}

#[test]
fn quantiles_interpolate_between_order_statistics() {
    let sorted = [1.0, 2.0, 4.0, 8.0];
    for (probability, want) in [(0.0, 1.0), (0.5, 3.0), (0.9, 6.8), (1.0, 8.0)] {
        assert!((quantile(&sorted, probability) - want).abs() < 1e-14);
    }
    assert!(quantile(&[], 0.5).is_nan() && quantile(&sorted, 1.5).is_nan());
}

#[test]
#[ignore = "timing, 1 s: cargo test --release --lib diagnostics -- --ignored --nocapture"]
fn a_hundred_quantities_take_a_fraction_of_a_second() {
    for phi in [0.0, 0.9, 0.99] {
        let name = "timing";
        let (seed, chains, draws) = (7, 4, 1000);
        let case =
            Case { name, seed, chains, draws, phi, shift: 0.0, power: 1, figures: [0.0; 14] };
        let chains = autoregressive(&case);
        let chains = slices(&chains);
        let begun = std::time::Instant::now();
        let sum: f64 = (0..100).map(|_| summarise(&chains).ess_bulk).sum();
        println!("phi {phi}: {:.3} s (ESS {:.0})", begun.elapsed().as_secs_f64(), sum / 100.0);
    }
}
