//! How to estimate the likelihood at outer unknowns far from those where the stand-in was fitted. There the stand-in
//! suits the likelihood badly, and an estimate by particles is nearly always too small, but sometimes far too large. A
//! chain at a state whose estimate is far too large stays there.
//!
//! So there are several *anchors*: values of the outer unknowns, spread over all that was found plausible. Each has
//! a lookahead of its own, found by expectation propagation, and as many particles as estimates need there. An
//! estimate at other outer unknowns uses a mean of all anchors, in which near ones count more. It is unbiased
//! whatever the anchors are.
//!
//! The measurements at a place may allow two regions of values, of which each anchor knows one. A lookahead that knew
//! one alone would make estimates in the other far too large. So the lookahead of a place is widened by how far the
//! anchors' means are apart there.
//!
//! # Source
//! Minka 2001, "Expectation propagation for approximate Bayesian inference".

use super::groups::Whitening;
use super::latent::{Latent, LatentGaussian, Layout};
use super::particles::{Here, Memory};
use super::stand_in::{GroupStandIn, StandIn};
use crate::random::Stream;
use nalgebra::{Cholesky, DMatrix, DVector};
use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How many anchors there are.
const N_ANCHORS: usize = 16;
/// Points with less than this share of the largest weight are no anchors.
const NEGLIGIBLE: f64 = 1e-3;
/// Sweeps over all places for a lookahead.
const SWEEPS: usize = 4;
/// Sweeps begin with this share of the stand-in's information. With all of it they would stay in the region of
/// values that the stand-in knows.
const BEGIN: f64 = 0.05;
/// An anchor's lookahead has this share of the information that the sweeps have found.
const LOOKAHEAD: f64 = 0.85;
/// A sweep integrates over the values of a place with so many points for each value.
const POINTS: usize = 32;
/// The points have so many times the sd of the present approximation.
const WIDER: f64 = 1.4;
/// Least information of a place, in units of that of the present approximation.
const LEAST: f64 = 0.02;
/// Where the points are worth fewer equally weighted ones than this, for each value, the integral says nothing.
const WORTH: f64 = 4.0;
/// How much of the way from the present approximation to the likelihood a sweep goes: the first of these at which the
/// integral says something.
const SHARES: [f64; 5] = [1.0, 0.5, 0.2, 0.05, 0.01];
/// Added to the squared distance of an anchor, which may be 0.
const NEAREST: f64 = 1e-6;

/// Pairs of estimates by which the number of particles is found, and their particles.
const PAIRS: usize = 12;
const PARTICLES: usize = 16;
/// Most particles.
const MOST_PARTICLES: usize = 256;
/// The variance that ln of an estimate may have.
const VARIANCE: f64 = 0.5;

/// Where the anchors are. A chain keeps these alone; the rest is made from them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Spots {
    /// The sd of each outer unknown among the points: distances are in these.
    scale: Vec<f64>,
    /// The outer unknowns of each.
    outer: Vec<Vec<f64>>,
}

impl Spots {
    /// Spread over those of `points`, `(n, outer)`, that have weights worth counting.
    pub(super) fn new(points: &[Vec<f64>], weights: &[f64]) -> Self {
        let most = weights.iter().copied().fold(0.0, f64::max);
        let counts = |(_, weight): &(&Vec<f64>, &f64)| **weight > NEGLIGIBLE * most;
        let kept: Vec<&Vec<f64>> =
            points.iter().zip(weights).filter(counts).map(|(point, _)| point).collect();
        let scale = spread_of(points, weights);
        let chosen = far_apart(&kept, &scale);
        // where there are few different points, some are there twice
        let outer = chosen.iter().cycle().take(N_ANCHORS).cloned().collect();
        Self { scale, outer }
    }

    /// Whether they are of this layout.
    pub(super) fn fits(&self, layout: &Layout) -> bool {
        self.scale.len() == layout.outer.len()
            && self.outer.len() == N_ANCHORS
            && self.outer.iter().all(|outer| outer.len() == layout.outer.len())
    }
}

/// All anchors.
#[derive(Clone, Debug, Default)]
pub(super) struct Anchors {
    scale: Vec<f64>,
    all: Vec<Anchor>,
}

/// Some outer unknowns, and how to estimate the likelihood near them.
#[derive(Clone, Debug)]
struct Anchor {
    outer: Vec<f64>,
    /// Means of the latent values, `(group, block, place)`.
    theta: Vec<f64>,
    guide: Guide,
}

/// How to estimate the likelihood.
#[derive(Clone, Debug)]
pub(super) struct Guide {
    pub(super) lookahead: StandIn,
    pub(super) n_particles: usize,
}

impl Anchors {
    /// At these spots, but those where nothing can be estimated; `None` if none is left.
    pub(super) fn new(
        density: &dyn LatentGaussian,
        stand_in: &StandIn,
        spots: &Spots,
        seed: u64,
    ) -> Option<Self> {
        let mut rng = Stream::Anchors.rng(seed);
        let begin = stand_in.times(BEGIN);
        let begun: Vec<(&Vec<f64>, ChaCha8Rng)> =
            spots.outer.iter().map(|outer| (outer, ChaCha8Rng::from_rng(&mut rng))).collect();
        let anchor = |memory: &mut Memory<'_>, (outer, mut rng): (&Vec<f64>, ChaCha8Rng)| {
            Anchor::new(memory, begin.clone(), outer, &mut rng)
        };
        let all: Vec<Option<Anchor>> =
            begun.into_par_iter().map_init(|| Memory::new(density), anchor).collect();
        let all: Vec<Anchor> = all.into_iter().flatten().collect();
        (!all.is_empty()).then(|| Self { scale: spots.scale.clone(), all })
    }

    /// How to estimate the likelihood at these outer unknowns; `None` if that cannot be told.
    pub(super) fn at(&self, outer: &[f64], layout: &Layout) -> Option<Guide> {
        let near =
            |anchor: &Anchor| (distance(&anchor.outer, outer, &self.scale) + NEAREST).powi(-2);
        let mut weights: Vec<f64> = self.all.iter().map(near).collect();
        let total: f64 = weights.iter().sum();
        for weight in &mut weights {
            *weight /= total;
        }
        let parts = || weights.iter().copied().zip(&self.all);
        let all: Vec<_> =
            parts().map(|(w, anchor)| (w, &anchor.guide.lookahead, &anchor.theta[..])).collect();
        let lookahead = StandIn::between(&all, layout)?;
        let n: f64 = parts().map(|(w, anchor)| w * anchor.guide.n_particles as f64).sum();
        Some(Guide { lookahead, n_particles: n as usize })
    }
}

impl Anchor {
    /// At these outer unknowns; `None` where nothing can be estimated.
    fn new(
        Memory { layout, latent, whitening, coefficients }: &mut Memory<'_>,
        mut own: StandIn,
        outer: &[f64],
        rng: &mut ChaCha8Rng,
    ) -> Option<Self> {
        let latent = &mut **latent;
        let ln_prior = latent.set_outer(outer, &mut whitening.designs);
        if !ln_prior.is_finite() {
            return None;
        }
        for _ in 0..SWEEPS {
            whitening.prepare_basis(&own)?;
            sweep(layout, latent, whitening, &mut own, rng);
        }
        whitening.prepare_basis(&own)?;
        let of_group = |group: usize| whitening.basis(group).0.to_vec();
        let theta = (0..layout.groups.len()).flat_map(of_group).collect();
        let lookahead = own.times(LOOKAHEAD);
        let here = Here::new(layout, &lookahead, whitening)?;
        let mut square = || {
            let [a, b] = [0, 1].map(|_| here.draw(latent, PARTICLES, coefficients, rng));
            0.5 * (a - b) * (a - b)
        };
        let squares: Vec<f64> = (0..PAIRS).map(|_| square()).filter(|s| s.is_finite()).collect();
        let variance = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
        let needed = (PARTICLES as f64 * variance / VARIANCE) as usize;
        let n_particles = needed.clamp(PARTICLES, MOST_PARTICLES);
        Some(Self { outer: outer.to_vec(), theta, guide: Guide { lookahead, n_particles } })
    }
}

/// A sweep over all places. The whitening is that of `stand_in`, with its basis set.
pub(super) fn sweep(
    layout: &Layout,
    latent: &mut dyn Latent,
    whitening: &Whitening,
    stand_in: &mut StandIn,
    rng: &mut ChaCha8Rng,
) {
    for (group, of) in layout.groups.iter().enumerate() {
        let own = &mut stand_in.groups[group];
        for place in 0..of.n_seen {
            let Some(marginal) = Marginal::new(whitening.basis(group), of.n_seen, place) else {
                continue;
            };
            if let Some((information, centre)) = marginal.tilted(latent, [group, place], own, rng) {
                own.set(place, &information, &centre);
            }
        }
        own.set_gram(of);
    }
}

/// The values of a place under an approximation.
struct Marginal {
    mean: DVector<f64>,
    /// L of their covariance L Lᵀ.
    factor: DMatrix<f64>,
}

impl Marginal {
    fn new((origin, columns): (&[f64], &[f64]), n_seen: usize, place: usize) -> Option<Self> {
        let d = origin.len() / n_seen;
        let at = |f: usize| f * n_seen + place;
        let mut covariance = DMatrix::zeros(d, d);
        for column in columns.chunks_exact(origin.len()) {
            let own = DVector::from_fn(d, |f, _| column[at(f)]);
            covariance += &own * own.transpose();
        }
        let mean = DVector::from_fn(d, |f, _| origin[at(f)]);
        Some(Self { mean, factor: Cholesky::new(covariance)?.l() })
    }

    /// The information and the centre that the place's factor must have so that the approximation has the mean and the
    /// covariance there that it would have with the place's own likelihood. `None` where these cannot be told.
    fn tilted(
        &self,
        latent: &mut dyn Latent,
        at: [usize; 2],
        stand_in: &GroupStandIn,
        rng: &mut impl Rng,
    ) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let d = self.mean.len();
        let mut normal =
            || DVector::from_fn(d, |_, _| WIDER * rng.sample::<f64, _>(StandardNormal));
        let points: Vec<DVector<f64>> = (0..d * POINTS).map(|_| normal()).collect();
        let theta: Vec<f64> = points
            .iter()
            .flat_map(|x| (&self.mean + &self.factor * x).as_slice().to_vec())
            .collect();
        let mut ratio = vec![0.0; d * POINTS];
        latent.ln_likelihoods(at, &theta, &mut ratio);
        for (ratio, theta) in ratio.iter_mut().zip(theta.chunks_exact(d)) {
            *ratio += stand_in.quadratic(at[1], theta);
        }
        let narrower = |x: &DVector<f64>| 0.5 * (1.0 - 1.0 / (WIDER * WIDER)) * x.norm_squared();
        // where few points would count, a part of the way
        let part = |share: f64| {
            let ln = points.iter().zip(&ratio).map(|(x, ratio)| share * ratio - narrower(x));
            weights_of(ln.collect(), WORTH * d as f64)
        };
        let weights = SHARES.into_iter().find_map(part)?;
        let total: f64 = weights.iter().sum();
        let pairs = || points.iter().zip(&weights).map(|(x, w)| (x, w / total));
        let mean = pairs().fold(DVector::zeros(d), |sum, (x, w)| sum + x * w);
        let covariance = pairs().fold(DMatrix::zeros(d, d), |sum, (x, w)| {
            let y = x - &mean;
            sum + &y * y.transpose() * w
        });
        // all in units of the marginal, which has mean 0 and covariance 1
        let precision = covariance.try_inverse()?;
        let inverse = self.factor.clone().try_inverse()?;
        let (information, centre) = stand_in.at(at[1]);
        let own = self.factor.transpose() * information * &self.factor;
        let pull = &own * (&inverse * (centre - &self.mean)) + &precision * mean;
        let new = precision - DMatrix::identity(d, d) + own;
        let mut eigen = ((&new + new.transpose()) * 0.5).symmetric_eigen();
        eigen.eigenvalues.apply(|x| *x = x.max(LEAST));
        let new = eigen.recompose();
        let centre = &self.mean + &self.factor * (new.clone().try_inverse()? * pull);
        let information = inverse.transpose() * new * inverse;
        let finite = |x: &f64| x.is_finite();
        (information.iter().all(finite) && centre.iter().all(finite))
            .then_some((information, centre))
    }
}

/// Weights of these logarithms, the largest 1; `None` if they are worth too few.
fn weights_of(ln: Vec<f64>, least: f64) -> Option<Vec<f64>> {
    let most = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = ln.into_iter().map(|ln| (ln - most).exp()).collect();
    let total: f64 = weights.iter().sum();
    let squares: f64 = weights.iter().map(|w| w * w).sum();
    (total * total > least * squares).then_some(weights)
}

/// Each number's sd among these points.
fn spread_of(points: &[Vec<f64>], weights: &[f64]) -> Vec<f64> {
    let total: f64 = weights.iter().sum();
    let one = |i: usize| {
        let pairs = || points.iter().zip(weights).map(|(x, w)| (x[i], w / total));
        let mean: f64 = pairs().map(|(x, w)| x * w).sum();
        let variance: f64 = pairs().map(|(x, w)| (x - mean).powi(2) * w).sum();
        variance.sqrt().max(1e-3)
    };
    (0..points.first().map_or(0, Vec::len)).map(one).collect()
}

fn distance(a: &[f64], b: &[f64], scale: &[f64]) -> f64 {
    a.iter().zip(b).zip(scale).map(|((a, b), s)| ((a - b) / s).powi(2)).sum()
}

/// Up to [`N_ANCHORS`] of these points, each as far as can be from those before it.
fn far_apart(points: &[&Vec<f64>], scale: &[f64]) -> Vec<Vec<f64>> {
    let n = points.len() as f64;
    let mean: Vec<f64> =
        (0..scale.len()).map(|i| points.iter().map(|x| x[i]).sum::<f64>() / n).collect();
    let mut gaps = vec![f64::INFINITY; points.len()];
    // the first is the one in the middle
    let to_mean: Vec<f64> = points.iter().map(|x| distance(x, &mean, scale)).collect();
    let mut next = (0..points.len()).min_by(|a, b| to_mean[*a].total_cmp(&to_mean[*b]));
    let mut chosen = vec![];
    while let Some(own) = next.filter(|own| chosen.len() < N_ANCHORS && gaps[*own] > 0.0) {
        chosen.push(points[own].clone());
        for (gap, x) in gaps.iter_mut().zip(points) {
            *gap = gap.min(distance(x, points[own], scale));
        }
        next = (0..points.len()).max_by(|a, b| gaps[*a].total_cmp(&gaps[*b]));
    }
    chosen
}

#[cfg(test)]
#[path = "anchor_tests.rs"]
mod tests;
