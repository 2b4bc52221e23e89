//! Particles against exact figures, and the mixture's draws against its density.

use super::conditional::Conditional;
use super::groups::Whitening;
use super::meeting::Shared;
use super::mixture::{Mixture, Tails};
use super::particles::Here;
use super::proposal::Proposal;
use super::stand_in::{Sample, StandIn, Trust};
use super::{BlockLayout, Design, Group, Latent, Layout, Shape};
use nalgebra::{Cholesky, DMatrix, DVector};
use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::sync::Arc;

const PLACES: usize = 4;
const LATENT: usize = 2 * PLACES;
/// Measurements of the sum of two fields, and their error.
const Y: [f64; PLACES] = [1.6, 0.2, -0.7, 1.1];
const SD: f64 = 0.4;
/// Two-sided 0.001 % of a normal number.
const LARGEST_Z: f64 = 4.4;

/// Two fields at a few places on a line: sd and lengthscale of each.
const FIELDS: [[f64; 2]; 2] = [[1.0, 2.0], [0.7, 0.8]];

/// L of a field's covariance L Lᵀ. Of the first field only so many columns are left: its values at the places
/// before determine the others.
fn factor(field: usize, rank: usize) -> DMatrix<f64> {
    let [sd, rho] = FIELDS[field];
    let covariance = DMatrix::from_fn(PLACES, PLACES, |i, j| {
        sd * sd * (-0.5 * ((i as f64 - j as f64) / rho).powi(2)).exp()
    });
    let mut factor = Cholesky::new(covariance).unwrap().l();
    if field == 0 {
        factor.columns_mut(rank, PLACES - rank).fill(0.0);
    }
    factor
}

fn covariance(field: usize, rank: usize) -> DMatrix<f64> {
    let factor = factor(field, rank);
    &factor * factor.transpose()
}

fn layout() -> Layout {
    let block =
        || BlockLayout { n_coefficients: PLACES, mean_precision: None, shape: Shape::Triangular };
    let group = Group { n_seen: PLACES, blocks: vec![block(), block()] };
    Layout { groups: vec![group], free_precision: vec![], outer: vec![], hyper: vec![] }
}

/// Outer unknowns, if there are any, are standard normal; ln L = −½ Σ ((θ₁ + θ₂ − y)/sd)²
struct Sums {
    rank: usize,
}

impl Latent for Sums {
    fn set_outer(&mut self, outer: &[f64], designs: &mut [Design]) -> f64 {
        for (field, rows) in designs[0].rows.iter_mut().enumerate() {
            rows.copy_from_slice(factor(field, self.rank).transpose().as_slice());
        }
        -0.5 * outer.iter().map(|x| x * x).sum::<f64>()
    }
    fn ln_likelihoods(&mut self, [_, place]: [usize; 2], theta: &[f64], out: &mut [f64]) {
        for (out, theta) in out.iter_mut().zip(theta.chunks_exact(2)) {
            *out = -0.5 * ((theta[0] + theta[1] - Y[place]) / SD).powi(2);
        }
    }
    fn slope(&mut self, theta: &[f64], theta_bar: &mut [f64]) -> f64 {
        for place in 0..PLACES {
            let slope = (Y[place] - theta[place] - theta[PLACES + place]) / SD.powi(2);
            theta_bar[place] = slope;
            theta_bar[PLACES + place] = slope;
        }
        f64::NAN
    }
    fn coefficients(&mut self, _: &[f64], _: &mut [f64]) {
        unreachable!("not asked for")
    }
    fn join(&mut self, _: &[f64], _: &[f64], _: &mut dyn Rng, _: &mut [f64]) -> f64 {
        unreachable!("not asked for")
    }
    fn ln_likelihood(&mut self, _: &[f64]) -> f64 {
        unreachable!("not asked for")
    }
    fn slopes(&mut self, _: &[f64], _: &[f64], _: &mut [f64], _: &mut [f64]) -> f64 {
        unreachable!("not asked for")
    }
}

/// The exact posterior.
struct Exact {
    /// ln ∫ p(θ) L dθ
    ln_evidence: f64,
    /// `(block, place)`
    mean: DVector<f64>,
    /// A with covariance A Aᵀ.
    factor: DMatrix<f64>,
}

fn exact(rank: usize) -> Exact {
    let y = DVector::from_row_slice(&Y);
    let sum = Cholesky::new(
        covariance(0, rank) + covariance(1, rank) + DMatrix::identity(PLACES, PLACES) * SD.powi(2),
    )
    .unwrap();
    let ln_ratio: f64 = sum.l().diagonal().iter().map(|l| (SD / l).ln()).sum();
    let mut prior = DMatrix::zeros(LATENT, LATENT);
    let mut seen = DMatrix::zeros(PLACES, LATENT);
    for field in 0..2 {
        prior
            .view_mut((field * PLACES, field * PLACES), (PLACES, PLACES))
            .copy_from(&covariance(field, rank));
        seen.view_mut((0, field * PLACES), (PLACES, PLACES)).fill_with_identity();
    }
    let gain = &prior * seen.transpose() * sum.inverse();
    let mut eigen = (&prior - &gain * &seen * &prior).symmetric_eigen();
    eigen.eigenvalues.apply(|x| *x = x.max(0.0).sqrt());
    Exact {
        ln_evidence: ln_ratio - 0.5 * y.dot(&sum.solve(&y)),
        mean: gain * y,
        factor: eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues),
    }
}

/// A stand-in that is not the likelihood's own: half of its information.
fn lookahead(layout: &Layout, rng: &mut ChaCha8Rng) -> StandIn {
    let sample = |_| {
        let theta: Vec<f64> = (0..LATENT).map(|_| rng.sample(StandardNormal)).collect();
        let mut slope = vec![0.0; LATENT];
        Sums { rank: PLACES }.slope(&theta, &mut slope);
        Sample { theta, slope }
    };
    let samples: Vec<Sample> = (0..100).map(sample).collect();
    let mut stand_in = StandIn::new(layout);
    stand_in.fit(&samples, Trust { least: 0.1, reach: f64::INFINITY }, layout);
    stand_in.times(0.5)
}

/// Z with a mean of one, if the values are what they should be.
fn z(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean - 1.0) / (variance / n).sqrt()
}

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

/// Between two moves of hyperparameters those of the coefficients move other unknowns, too.
#[test]
fn an_estimate_has_the_prior_where_the_free_unknowns_are_now() {
    let layout = Layout { outer: vec![LATENT], ..layout() };
    let stand_in = lookahead(&layout, &mut ChaCha8Rng::seed_from_u64(7));
    let shared = Arc::new(Shared { stand_in, proposal: Proposal::new(&[]), together: None });
    let estimate = |at_first: f64, then: f64| {
        let shared = Arc::clone(&shared);
        let mut conditional =
            Conditional::new(Box::new(Sums { rank: PLACES }), &layout, shared, &[at_first])
                .unwrap();
        let mut position = conditional.position(&[0.1; LATENT]);
        position[LATENT] = then;
        conditional.take(&position);
        conditional.estimate(&position, &mut ChaCha8Rng::seed_from_u64(8))
    };
    assert!((estimate(0.0, 2.0) - estimate(2.0, 2.0)).abs() < 1e-12);
    assert!((estimate(2.0, 0.0) - estimate(2.0, 2.0) - 2.0).abs() < 1e-12);
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
