//! PSIS-LOO against `ArviZ` 1.3.0 (`arviz_stats` 1.3.3) on draws that a linear congruential generator
//! makes on both sides, and against the exact predictive density of a conjugate model.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::*;

/// Tail shapes of the importance weights of the five measurements of every case.
const SHAPES: [f64; 5] = [0.0, 0.2, 0.5, 0.8, 1.2];

struct Case {
    name: &'static str,
    seed: u64,
    n_draws: usize,
    r_eff: f64,
    /// elpd, its standard error, `p_loo`, threshold on k.
    totals: [f64; 4],
    elpd: [f64; 5],
    pareto_k: [f64; 5],
}

const CASES: [Case; 3] = [
    Case {
        name: "long",
        seed: 1,
        n_draws: 2000,
        r_eff: 0.7,
        totals: [-10.23390184738117, 2.3382459278532886, 3.6635679582180947, 0.6970642492453765],
        elpd: [
            -1.0694908309226632,
            -1.2992902518599676,
            -1.6982663648254155,
            -2.5405903994757697,
            -3.626264000297353,
        ],
        pareto_k: [
            -0.3150067706698818,
            0.09947577898146169,
            0.3578896380868052,
            0.6937607093049853,
            1.0968819708141306,
        ],
    },
    Case {
        name: "short, a fifth of the draws in the tail",
        seed: 2,
        n_draws: 120,
        r_eff: 1.0,
        totals: [-10.465879760373868, 2.3367513552911574, 3.814903343277074, 0.519041448694803],
        elpd: [
            -1.1084510850118443,
            -1.3209122666663067,
            -1.7154478646492093,
            -2.7240338830230737,
            -3.597034661023434,
        ],
        pareto_k: [
            -0.02982984033971652,
            0.06456521139934121,
            0.6919375457340495,
            0.8352829182846129,
            1.2392033836521066,
        ],
    },
    Case {
        name: "antithetic",
        seed: 3,
        n_draws: 1000,
        r_eff: 1.6,
        totals: [-10.096377326167357, 2.240760951928683, 3.603997657092787, 0.6666666666666667],
        elpd: [
            -1.042862761383783,
            -1.2961390500662828,
            -1.8038426178369926,
            -2.4020881061523847,
            -3.5514447907279125,
        ],
        pareto_k: [
            -0.2921301622352496,
            0.21806369547673837,
            0.8025744907054432,
            0.7024908059351231,
            1.0226286590418576,
        ],
    },
];

/// Knuth's MMIX generator; the upper 53 bits as a number in [0, 1).
fn uniform(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

/// Log likelihoods (S, 5): weights are Pareto with the given shapes, times a bounded factor.
fn log_likelihood(case: &Case) -> Vec<f64> {
    let mut state = case.seed;
    let mut one = |shape: f64| {
        let heavy = shape * (1.0 - uniform(&mut state)).ln();
        heavy - (uniform(&mut state) + uniform(&mut state))
    };
    (0..case.n_draws).flat_map(|_| SHAPES.map(&mut one)).collect()
}

/// Of `n` measurements from log likelihoods (S, n).
fn loo(log_likelihood: &[f64], n: usize, r_eff: f64) -> Loo {
    let column = |i| log_likelihood.iter().skip(i).step_by(n).copied().collect::<Vec<f64>>();
    let points: Vec<_> = (0..n).map(|i| LooPoint::of(&column(i), r_eff)).collect();
    Loo::of(&points, log_likelihood.len() / n)
}

#[test]
fn every_figure_agrees_with_arviz_also_where_k_is_too_high() {
    for case in &CASES {
        let loo = loo(&log_likelihood(case), SHAPES.len(), case.r_eff);
        let totals = [loo.elpd, loo.se, loo.p_loo, loo.k_threshold];
        let elpd = loo.pointwise.iter().map(|p| p.elpd);
        let pareto_k = loo.pointwise.iter().map(|p| p.pareto_k);
        let got = totals.into_iter().chain(elpd).chain(pareto_k);
        let want = [&case.totals[..], &case.elpd, &case.pareto_k].concat();
        for (k, (got, want)) in got.zip(&want).enumerate() {
            assert!((got / want - 1.0).abs() < 1e-8, "{} figure {k}: {got} {want}", case.name);
        }
    }
}

/// Five measurements of a normal mean with a flat prior, unit noise.
const Y: [f64; 5] = [-0.7, 0.4, 0.1, 1.9, -0.2];

/// Log likelihoods (S, 5) of exact posterior draws of that mean.
fn conjugate(seed: u64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (n, mean) = (Y.len() as f64, Y.iter().sum::<f64>() / Y.len() as f64);
    let draws = (0..2000).map(|_| mean + rng.sample::<f64, _>(StandardNormal) / n.sqrt());
    draws.flat_map(|mu| Y.map(|y| ln_normal(y, mu, 1.0))).collect()
}

fn ln_normal(y: f64, mean: f64, variance: f64) -> f64 {
    -0.5 * ((y - mean).powi(2) / variance + (std::f64::consts::TAU * variance).ln())
}

/// Mean over independent repeats minus `exact`, in its standard errors.
fn z_score(repeats: &[f64], exact: f64) -> f64 {
    let (mean, sd) = mean_and_sd(&[repeats]);
    (mean - exact) / (sd / (repeats.len() as f64).sqrt())
}

#[test]
fn the_exact_predictive_density_of_a_conjugate_model_is_found() {
    let n = Y.len() as f64;
    let exact = |y: &f64| {
        let others = (Y.iter().sum::<f64>() - y) / (n - 1.0);
        ln_normal(*y, others, 1.0 + 1.0 / (n - 1.0))
    };
    let exact: f64 = Y.iter().map(exact).sum();
    let loos: Vec<Loo> = (0..40).map(|seed| loo(&conjugate(seed), Y.len(), 1.0)).collect();
    let left_out: Vec<f64> = loos.iter().map(|l| l.elpd).collect();
    let z = z_score(&left_out, exact);
    // Smoothing has a bias below its spread over repeats; four standard errors leave room for it.
    assert!(z.abs() < 4.0, "z {z}");
    // The broken twin: nothing left out.
    let kept_in: Vec<f64> = loos.iter().map(|l| l.elpd + l.p_loo).collect();
    assert!(z_score(&kept_in, exact) > 20.0);
}

/// A measurement that no draw without it comes near: two sets of draws together tell what neither does alone.
#[test]
fn draws_with_and_without_a_measurement_tell_it_together() {
    let (y, variance): (f64, f64) = (4.5, 0.25);
    let exact = ln_normal(y, 0.0, 1.0 + variance);
    let (mean, sd) = (y / (1.0 + variance), (variance / (1.0 + variance)).sqrt());
    let mut off = [vec![], vec![], vec![]];
    for seed in 0..20 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draws = |mean: f64, sd: f64, n: usize| -> Vec<f64> {
            let each = |_| ln_normal(y, mean + sd * rng.sample::<f64, _>(StandardNormal), variance);
            (0..n).map(each).collect()
        };
        let (with, without) = (draws(mean, sd, 1500), draws(0.0, 1.0, 1000));
        let weighted = LooPoint::of(&with, 1.0).0.elpd;
        let told = [bridged(&with, &without), crate::num::ln_mean_exp(&without), weighted];
        off.iter_mut().zip(told).for_each(|(off, told)| off.push(told - exact));
    }
    let mean = |off: &[f64]| off.iter().sum::<f64>() / off.len() as f64;
    let rms = |off: &[f64]| (off.iter().map(|x| x * x).sum::<f64>() / off.len() as f64).sqrt();
    let [bridged_off, plain, weighted] = &off;
    assert!(rms(bridged_off) < 0.5, "{bridged_off:?}");
    assert!(mean(plain) < -0.5 && mean(weighted) > 1.0, "{plain:?} {weighted:?}");
    // where both overlap it is the mean likelihood
    assert!((bridged(&[-1.0, -1.2], &[-1.0, -1.2, -1.1]) + 1.1).abs() < 0.01);
    assert!(bridged(&[-1.0], &[f64::NEG_INFINITY]) == f64::NEG_INFINITY);
}

#[test]
fn one_measurement_and_broken_ones_are_not_a_number_rather_than_a_wrong_one() {
    let one = loo(&[-1.0; 100], 1, 1.0);
    assert!(one.se.is_nan() && (one.elpd + 1.0).abs() < 1e-12 && one.p_loo.abs() < 1e-12);
    let broken = loo(&[-1.0, f64::NEG_INFINITY].repeat(100), 2, 1.0);
    assert!(broken.pointwise[0].elpd.is_finite() && broken.elpd.is_nan());
    assert!(broken.pointwise[1].pareto_k.is_infinite());
}

#[test]
fn the_efficiency_is_that_of_arviz() {
    assert!((relative_efficiency(&[200.0, 400.0], 4, 100) - 0.75).abs() < 1e-15);
    assert!((relative_efficiency(&[200.0, f64::NAN], 4, 100) - 0.75).abs() < 1e-15);
    assert!((relative_efficiency(&[20.0], 1, 100) - 1.0).abs() < 1e-15);
}
