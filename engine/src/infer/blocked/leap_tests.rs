//! Particles against exact figures, and the mixture's draws against its density.

use super::anchors::{Guide, sweep};
use super::conditional::Conditional;
use super::groups::Whitening;
use super::left_out::with_particles;
use super::meeting::Shared;
use super::mixture::{Mixture, Tails};
use super::particles::Here;
use super::proposal::Proposal;
use super::stand_in::{Sample, StandIn, Trust};
use super::{BlockLayout, Design, Group, Latent, LatentGaussian, Layout, Shape};
use crate::infer::density::{Evaluator, LogDensity};
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
/// Each is the sum of two rows, which have these shares of the log likelihood.
const SHARES: [f64; 2] = [0.75, 0.25];
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
    fn ln_of_rows(&mut self, at: [usize; 2], theta: &[f64]) -> Vec<Vec<f64>> {
        let mut both = vec![0.0; theta.len() / 2];
        self.ln_likelihoods(at, theta, &mut both);
        SHARES.map(|share| both.iter().map(|ln| share * ln).collect()).to_vec()
    }
    fn slope(&mut self, theta: &[f64], theta_bar: &mut [f64]) -> f64 {
        for place in 0..PLACES {
            let slope = (Y[place] - theta[place] - theta[PLACES + place]) / SD.powi(2);
            theta_bar[place] = slope;
            theta_bar[PLACES + place] = slope;
        }
        f64::NAN
    }
    fn coefficients(&mut self, position: &[f64], coefficients: &mut [f64]) {
        coefficients.copy_from_slice(position);
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
    exact_with(rank, [SD; PLACES])
}

/// Where the measurements have these errors.
fn exact_with(rank: usize, sd: [f64; PLACES]) -> Exact {
    let y = DVector::from_row_slice(&Y);
    let noise = DMatrix::from_diagonal(&DVector::from_row_slice(&sd.map(|sd| sd * sd)));
    let sum = Cholesky::new(covariance(0, rank) + covariance(1, rank) + noise).unwrap();
    let ln_ratio: f64 = sum.l().diagonal().iter().zip(sd).map(|(l, sd)| (sd / l).ln()).sum();
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

/// Of draws of the posterior the mean of Z₋ᵢ/Z is exact, and so is the mean of the values at the place with these
/// weights, whichever row is left out. Plain weights 1/Lᵢ have heavy tails here.
#[test]
fn rows_are_predicted_from_the_others() {
    for (n_particles, rank) in [(2, PLACES), (64, PLACES), (16, 2), (16, 1)] {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let with = exact(rank);
        let factors = [0, 1].map(|field| factor(field, if field == 0 { rank } else { PLACES }));
        let draw = |_| {
            let standard = DVector::from_fn(LATENT, |_, _| rng.sample(StandardNormal));
            let theta = &with.mean + &with.factor * standard;
            let of = |(field, l): (usize, &DMatrix<f64>)| {
                whitened(l, &theta.as_slice()[field * PLACES..][..PLACES])
            };
            factors.iter().enumerate().flat_map(of).collect()
        };
        let draws: Vec<Vec<f64>> = (0..4000).map(draw).collect();
        let places: Vec<[usize; 2]> = (0..PLACES).map(|place| [0, place]).collect();
        let density = SumsAlone { layout: layout(), rank };
        let told = with_particles(&density, &draws, &places, n_particles, 5);
        for place in 0..PLACES {
            for (row, share) in SHARES.iter().enumerate() {
                let mut sd = [SD; PLACES];
                sd[place] /= (1.0 - share).sqrt();
                let without = exact_with(rank, sd);
                let ratio = without.ln_evidence - with.ln_evidence;
                let at = || told.iter().map(|places| &places[place][row]);
                let weights: Vec<f64> = at().map(|row| (-row.ln_density - ratio).exp()).collect();
                assert!(
                    z(&weights).abs() < LARGEST_Z,
                    "{n_particles} particles, rank {rank}, place {place}, row {row}: {}",
                    z(&weights)
                );
                let plain: Vec<f64> = at().map(|row| (-row.ln_density).exp()).collect();
                assert!(z(&plain).abs() > LARGEST_Z, "the ratio is not 1");
                for field in 0..2 {
                    let mean = without.mean[field * PLACES + place];
                    let moment: Vec<f64> = at()
                        .zip(&weights)
                        .map(|(row, w)| 1.0 + w * (row.theta[field] - mean))
                        .collect();
                    assert!(
                        z(&moment).abs() < LARGEST_Z,
                        "{n_particles} particles, rank {rank}, place {place}, row {row}: {}",
                        z(&moment)
                    );
                }
            }
        }
    }
}

/// w with L w = θ.
fn whitened(l: &DMatrix<f64>, theta: &[f64]) -> Vec<f64> {
    let mut w: Vec<f64> = vec![];
    for i in 0..PLACES {
        let left = theta[i] - (0..i).map(|j| l[(i, j)] * w[j]).sum::<f64>();
        w.push(if l[(i, i)] > 1e-9 { left / l[(i, i)] } else { 0.0 });
    }
    w
}

/// [`Sums`] without other unknowns.
struct SumsAlone {
    layout: Layout,
    rank: usize,
}

impl LogDensity for SumsAlone {
    fn dim(&self) -> usize {
        LATENT
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        unreachable!("not asked for")
    }
}

impl LatentGaussian for SumsAlone {
    fn layout(&self) -> &Layout {
        &self.layout
    }
    fn latent(&self) -> Box<dyn Latent + '_> {
        Box::new(Sums { rank: self.rank })
    }
    fn prior_outer(&self, _: usize, _: &mut ChaCha8Rng) -> Option<Vec<Vec<f64>>> {
        unreachable!("not asked for")
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
