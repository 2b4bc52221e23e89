//! Particles against exact figures, and the mixture's draws against its density.

use super::anchors::{Guide, sweep};
use super::conditional::Conditional;
use super::groups::Whitening;
use super::meeting::Shared;
use super::mixture::{Mixture, Tails};
use super::particles::Here;
use super::proposal::Proposal;
use super::stand_in::StandIn;
use super::test_sums::{LARGEST_Z, LATENT, PLACES, Sums, exact, layout, lookahead, z};
use super::{Latent, Layout};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::sync::Arc;

/// Ẑ/Z of new particles, and with a draw of the posterior among them; and a draw θ for each of the former.
fn estimates(n_particles: usize, rank: usize) -> (Vec<f64>, Vec<f64>, Vec<Vec<f64>>) {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (layout, exact, mut sums) = (layout(), exact(rank), Sums { rank });
    let lookahead = lookahead(&layout, &mut rng);
    let mut whitening = Whitening::new(&layout);
    sums.set_outer(&[], &mut whitening.designs);
    let here = Here::new(&layout, &lookahead, &mut whitening).unwrap();
    let ratio = |ln: f64| (ln - exact.ln_evidence).exp();
    let (mut new, mut present, mut draws) = (vec![], vec![], vec![]);
    let (mut coefficients, mut theta) = (vec![0.0; LATENT], vec![0.0; LATENT]);
    for _ in 0..20_000 {
        new.push(ratio(here.draw(&mut sums, n_particles, &mut coefficients, &mut rng)));
        here.whitening.latent_at(&coefficients, &mut theta);
        draws.push(theta.clone());
        let standard = DVector::from_fn(LATENT, |_, _| rng.sample(StandardNormal));
        let drawn = &exact.mean + &exact.factor * standard;
        present.push(ratio(here.at(&mut sums, n_particles, drawn.as_slice(), &mut rng)));
    }
    (new, present, draws)
}

/// With x = Ẑ/Z, the mean of x is 1 where all particles are new. Where one of them is a draw of the posterior, x is
/// distributed as there with the weight x: of any f, here of a bounded one, the mean of f(x) is that of x f(x) there.
#[test]
fn estimates_are_unbiased_and_those_at_a_state_are_distributed_as_they_should_be() {
    let f = |x: &f64| 1.0 / (1.0 + x);
    for (n_particles, rank) in [(1, PLACES), (4, PLACES), (16, PLACES), (4, 2), (16, 1)] {
        let (new, present, _) = estimates(n_particles, rank);
        assert!(z(&new).abs() < LARGEST_Z, "{n_particles} particles, rank {rank}: {}", z(&new));
        let difference = |right: &dyn Fn(&f64) -> f64| -> f64 {
            // both means at once
            let pairs = present.iter().zip(&new);
            z(&pairs.map(|(at, new)| 1.0 + f(at) - right(new)).collect::<Vec<_>>())
        };
        let own = difference(&|x| x * f(x));
        assert!(own.abs() < LARGEST_Z, "{n_particles} particles, rank {rank}: {own}");
        assert!(difference(&f).abs() > LARGEST_Z);
    }
}

/// Draws weighted by the estimates are draws of the posterior: E[Ẑ (θ − mean)] = 0 and E[Ẑ (θ − mean)²] = Z variance.
#[test]
fn coefficients_weighted_by_their_estimates_are_those_of_the_posterior() {
    let exact = exact(PLACES);
    let (new, _, draws) = estimates(2, PLACES);
    let variance = (&exact.factor * exact.factor.transpose()).diagonal();
    let largest = |weights: &[f64]| {
        let z_of = |i: usize| {
            let d = |theta: &Vec<f64>| (theta[i] - exact.mean[i]) / variance[i].sqrt();
            let pairs = || weights.iter().zip(&draws);
            let first: Vec<f64> = pairs().map(|(w, theta)| 1.0 + w * d(theta)).collect();
            let second: Vec<f64> = pairs().map(|(w, theta)| w * d(theta).powi(2)).collect();
            z(&first).abs().max(z(&second).abs())
        };
        (0..LATENT).map(z_of).fold(0.0, f64::max)
    };
    assert!(largest(&new) < LARGEST_Z, "{}", largest(&new));
    let without_weights = vec![1.0; draws.len()];
    assert!(largest(&without_weights) > LARGEST_Z);
}

/// A stand-in that knows nothing and one that is far off both become one of which few particles know the likelihood.
#[test]
fn sweeps_find_the_lookahead() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let (layout, mut sums) = (layout(), Sums { rank: PLACES });
    let mut off = lookahead(&layout, &mut rng);
    for place in 0..PLACES {
        off.groups[0].set(place, &(DMatrix::identity(2, 2) * 4.0), &DVector::from_element(2, 3.0));
    }
    let mut whitening = Whitening::new(&layout);
    let mut z = vec![0.0; LATENT];
    for mut stand_in in [StandIn::new(&layout), off] {
        let mut variances = vec![];
        for _ in 0..=3 {
            sums.set_outer(&[], &mut whitening.designs);
            let lookahead = stand_in.times(0.5);
            let here = Here::new(&layout, &lookahead, &mut whitening).unwrap();
            let lns: Vec<f64> =
                (0..400).map(|_| here.draw(&mut sums, 4, &mut z, &mut rng)).collect();
            let mean = lns.iter().sum::<f64>() / 400.0;
            variances.push(lns.iter().map(|ln| (ln - mean).powi(2)).sum::<f64>() / 400.0);
            whitening.prepare_basis(&stand_in).unwrap();
            sweep(&layout, &mut sums, &whitening, &mut stand_in, &mut rng);
        }
        assert!(variances[3] < 0.3 * variances[0], "{variances:?}");
    }
}

/// A chain's state, and how to estimate its density.
fn state(layout: &Layout, free: f64) -> (Conditional<'_>, Guide) {
    let stand_in = lookahead(layout, &mut ChaCha8Rng::seed_from_u64(7));
    let guide = Guide { lookahead: stand_in.times(0.5), n_particles: 32 };
    let proposal = Proposal::new(&[]);
    let shared = Arc::new(Shared { stand_in, proposal, leaps: None, swaps: vec![] });
    let latent = Box::new(Sums { rank: PLACES });
    (Conditional::new(latent, layout, shared, &[free]).unwrap(), guide)
}

/// Between two moves of hyperparameters those of the coefficients move other unknowns, too.
#[test]
fn an_estimate_has_the_prior_where_the_free_unknowns_are_now() {
    let layout = Layout { outer: vec![LATENT], ..layout() };
    let estimate = |at_first: f64, then: f64| {
        let (mut conditional, guide) = state(&layout, at_first);
        let mut position = conditional.position(&[0.1; LATENT]);
        position[LATENT] = then;
        conditional.take(&position);
        conditional.estimate(&position, &guide, &mut ChaCha8Rng::seed_from_u64(8))
    };
    assert!((estimate(0.0, 2.0) - estimate(2.0, 2.0)).abs() < 1e-12);
    assert!((estimate(2.0, 0.0) - estimate(2.0, 2.0) - 2.0).abs() < 1e-12);
}

/// The measurements do not tell of the free unknown, so leaps alone draw it from its prior, the standard normal
/// distribution, beyond −1 where they are proposed.
#[test]
fn leaps_move_the_free_unknowns_as_their_density_says() {
    let layout = Layout { outer: vec![LATENT], ..layout() };
    let shares = |forget: f64| {
        let (mut conditional, guide) = state(&layout, 3.0);
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let mut position = conditional.position(&[0.1; LATENT]);
        // triangular about 3
        let ln_q = |x: f64| (4.0 - (x - 3.0).abs()).ln();
        let n = 40_000;
        let mut within = 0;
        let mut present = conditional.estimate(&position, &guide, &mut rng);
        for _ in 0..n {
            let x = [3.0 + 4.0 * (rng.random::<f64>() - rng.random::<f64>())];
            let ln_ratio = forget * (ln_q(position[LATENT]) - ln_q(x[0]));
            let state = (&mut position[..], &mut present);
            conditional.leap((&x, &guide), ln_ratio, state, &mut rng);
            conditional.take(&position);
            within += i32::from((0.0..1.0).contains(&position[LATENT]));
        }
        f64::from(within) / f64::from(n)
    };
    // (Φ(1) − Φ(0))/(1 − Φ(−1)); four standard errors at 2,000 effective draws
    let exact = 0.341_34 / 0.841_34;
    let (right, twin) = (shares(1.0), shares(0.0));
    assert!((right - exact).abs() < 0.044, "{right} for {exact}");
    assert!((twin - exact).abs() > 0.044, "a forgotten ratio goes unseen: {twin}");
}

/// Of draws, the mean of p/q is 1 for any density p.
#[test]
fn a_mixture_draws_from_its_density() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let points: Vec<Vec<f64>> = (0..300)
        .map(|i| {
            let centre = if i % 3 == 0 { 4.0 } else { 0.0 };
            (0..3).map(|_| centre + rng.sample::<f64, _>(StandardNormal)).collect()
        })
        .collect();
    let weights: Vec<f64> = (0..300).map(|i| f64::from(1 + i % 2)).collect();
    let tails = vec![Tails::of(vec![-20.0, -10.0, 0.0, 5.0, 10.0]); 3];
    let fit = |far| {
        Mixture::fit(&points, &weights, (far, &tails), &mut ChaCha8Rng::seed_from_u64(4)).unwrap()
    };
    let (own, other) = (fit(0.3), fit(0.0));
    // normal about a place that the points have not shown, but the tails do
    let ln_p = |x: &[f64]| {
        let d = [x[0] - 9.0, x[1], x[2] - 1.0];
        -0.5 * d.iter().map(|d| d * d).sum::<f64>() - 1.5 * std::f64::consts::TAU.ln()
    };
    let (mut right, mut wrong) = (vec![], vec![]);
    let mut x = [0.0; 3];
    for _ in 0..100_000 {
        own.draw(&mut rng, &mut x);
        right.push((ln_p(&x) - own.ln_density(&x)).exp());
        wrong.push((ln_p(&x) - other.ln_density(&x)).exp());
    }
    assert!(z(&right).abs() < LARGEST_Z, "{}", z(&right));
    assert!(z(&wrong).abs() > LARGEST_Z, "{}", z(&wrong));
}
