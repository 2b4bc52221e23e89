//! Which hyperparameters to propose together with all coefficients: adaptive importance sampling of
//! them, by the estimates of [`particles`](super::particles).
//!
//! # Source
//! Cornuet, Marin, Mira & Robert 2012, "Adaptive multiple importance sampling".

use super::groups::Whitening;
use super::latent::LatentGaussian;
use super::mixture::{Mixture, Tails};
use super::particles::Here;
use super::stand_in::StandIn;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

const ROUNDS: usize = 3;
/// Points of a round.
const POINTS: usize = 1000;
const PARTICLES: usize = 16;
/// Share of proposals with one number from where its prior lies, while exploring and when it is done.
const FAR: [f64; 2] = [0.3, 0.1];
/// Draws of the prior, for where it lies.
const PRIOR_DRAWS: usize = 400;

/// A mixture fitted to the hyperparameters given the measurements. It begins with `outer`, draws of the outer
/// unknowns; from these also come the unknowns that are no hyperparameters. `None` where the prior cannot be
/// drawn from, or nothing was found.
pub(super) fn explore(
    density: &dyn LatentGaussian,
    lookahead: &StandIn,
    outer: &[Vec<f64>],
    rng: &mut ChaCha8Rng,
) -> Option<Mixture> {
    let layout = density.layout();
    let hyper = |outer: &Vec<f64>| layout.hyper.iter().map(|i| outer[*i]).collect::<Vec<f64>>();
    let prior = density.prior_outer(PRIOR_DRAWS, rng)?;
    let of_one = |i: &usize| Tails::of(prior.iter().map(|outer| outer[*i]).collect());
    let tails: Vec<Tails> = layout.hyper.iter().map(of_one).collect();
    let mut points: Vec<Vec<f64>> = outer.iter().map(hyper).collect();
    let equal = vec![1.0; points.len()];
    let mut mixture = Mixture::fit(&points, &equal, (FAR[0], &tails), rng)?;
    points.clear();
    let (mut latent, mut whitening) = (density.latent(), Whitening::new(layout));
    let mut z = vec![0.0; layout.n_coefficients()];
    let mut used: Vec<Mixture> = vec![];
    // ln of each point's density, and the sum of the densities of drawing it
    let (mut ln_density, mut drawn): (Vec<f64>, Vec<f64>) = (vec![], vec![]);
    for _ in 0..ROUNDS {
        for _ in 0..POINTS {
            let mut point = vec![0.0; tails.len()];
            mixture.draw(rng, &mut point);
            let mut at = outer[rng.random_range(0..outer.len())].clone();
            layout.hyper.iter().zip(&point).for_each(|(i, h)| at[*i] = *h);
            let ln_prior = latent.set_outer(&at, &mut whitening.designs);
            if !ln_prior.is_finite() {
                continue;
            }
            let Some(here) = Here::new(layout, lookahead, &mut whitening) else { continue };
            let ln = ln_prior + here.draw(&mut *latent, PARTICLES, &mut z, rng);
            if ln.is_finite() {
                drawn.push(used.iter().map(|q| q.ln_density(&point).exp()).sum());
                ln_density.push(ln);
                points.push(point);
            }
        }
        for (point, sum) in points.iter().zip(&mut drawn) {
            *sum += mixture.ln_density(point).exp();
        }
        let ln: Vec<f64> = ln_density.iter().zip(&drawn).map(|(ln, sum)| ln - sum.ln()).collect();
        let most = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = ln.iter().map(|ln| (ln - most).exp()).collect();
        used.push(mixture);
        mixture = Mixture::fit(&points, &weights, (FAR[1], &tails), rng)?;
    }
    Some(mixture)
}
