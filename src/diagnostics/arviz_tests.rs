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
            0.9997747793113407,
            4095.3500179581974,
            3892.304342633351,
            4092.355337654637,
            0.007798367063162276,
            0.005006147958214582,
            0.014696432462988906,
            0.014112473863419073,
            0.0011694296109197371,
            0.4988733925092356,
            -0.8372760107798358,
            0.006259978083160922,
            0.813845777083017,
            2.020102411961799,
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
            1.0752019565035584,
            57.204950262269165,
            160.2138364667014,
            57.04687397194432,
            0.1857926598698464,
            0.07569769786027286,
            0.21421856330796318,
            0.18023604259340686,
            0.026777190640770766,
            1.4032804597942914,
            -2.2720739090335544,
            -0.01890782148398884,
            2.3720423188304376,
            0.10810233437128969,
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
            1.0018104993871224,
            5126.591972249479,
            1420.784756953518,
            5126.591972249479,
            0.008428728077264995,
            0.013531604525699703,
            0.02401068627508607,
            0.013229175022351922,
            0.0032085994153007746,
            0.6034988122105026,
            -0.9772847044568832,
            0.005427372359706684,
            1.012274319247765,
            3.181589682756462,
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
            1.3576613247970177,
            9.475804190344737,
            78.71686691161955,
            9.40381038824472,
            0.2276522692493251,
            0.031688103377267796,
            0.14549858207452582,
            0.2529302692860239,
            0.604253749515393,
            0.6981100908991688,
            -0.5921588967215137,
            0.5904320960336102,
            1.7597870066270316,
            1.326543359036832,
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
            1.0508397462602654,
            32.832543408767954,
            57.699069782309905,
            46.39813520421384,
            0.06389227435659563,
            0.09858015158238397,
            0.42818755041537754,
            0.000593182514725462,
            -0.10475207124078174,
            0.43520974461785983,
            -0.7697514678846821,
            -9.542308473627519e-06,
            0.33411292303278334,
            1.5794829724149133,
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
            1.1387106104030031,
            19.172602271264857,
            26.35121346849818,
            19.11896314618017,
            0.8286325010227106,
            0.48202536223095266,
            1.6081596086518926,
            1.2144848677761964,
            4.553586128222086,
            3.623215215116932,
            -2.0210161308721393,
            4.597944245174216,
            9.988374136143017,
            0.03121530102609606,
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
