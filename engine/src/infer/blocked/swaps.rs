//! Steps of a region of the surface from one regime to another.
//!
//! Measurements can allow two regimes of the values at neighbouring places: `tau_out` 15 ms with `apd_max` 130 ms, or
//! 29 ms with 100 ms. Hardly any trajectory goes from one to the other, for what lies between them is next to
//! impossible. Draws of the warm-up and what [`scouts`](super::scouts) find tell of such regimes: the values at a
//! place fall into two clusters that are far apart. The *swap* of that place is the difference of the clusters' means, at all places where
//! it is large.
//!
//! A step adds a swap to the latent values, or takes it away, with the same probability. Values at other places follow
//! as the stand-in has it. Of all changes of z that change the values by δ, give or take their slack E, it is the
//! most probable one:
//!
//! ```text
//! Δz = Jᵀ(J Jᵀ + E)⁻¹ δ      J: the rows of A U⁻¹ of the swap's values
//! ```
//! It depends on the hyperparameters alone, which stay as they are. So the step back is as probable as the step, and the ratio
//! of the densities decides.
//!
//! # Source
//! Ashman, Bird & Zepf 1994, "Detecting bimodality in astronomical datasets", for the distance of two clusters.

use super::groups::Whitening;
use super::latent::{Group, Layout};
use super::stand_in::Sample;
use nalgebra::{Cholesky, DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::slice::ChunksExact;

/// Least distance of the means of two clusters, in standard deviations. A normal that is cut in two at its mean has 2.6,
/// a uniform 3.5.
const APART: f64 = 4.0;
/// The same at the other places of a swap, in any direction.
const TAKES_PART: f64 = 2.0;
/// Least number of draws in a cluster.
const LEAST: usize = 5;
/// Two swaps whose clusters agree in this share of the draws are one.
const SAME: f64 = 0.8;
/// Most swaps.
const MOST: usize = 8;
/// About the most places that are looked at.
const MOST_TRIED: usize = 400;
/// Most places of a swap.
const MOST_PLACES: usize = 16;
/// Slack of a swap's values, as a share of their variance in a cluster.
const SLACK: f64 = 1e-4;

/// Places of a group, and by how much their values differ between two regimes.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Swap {
    group: usize,
    pub(super) places: Vec<usize>,
    /// δ and the diagonal of E, `(block, place of these)`.
    pub(super) shift: Vec<f64>,
    slack: Vec<f64>,
}

/// A cut of the draws into two clusters, by the values at a place of a group.
struct Cut {
    group: usize,
    is_high: Vec<bool>,
    /// How far the means are apart, in standard deviations.
    apart: f64,
}

impl Swap {
    /// Those that draws tell of, and earlier ones of regimes that these do not tell of.
    pub(super) fn of(samples: &[Sample], earlier: &[Self], layout: &Layout) -> Vec<Self> {
        let mut found = vec![];
        for (g, group) in layout.groups.iter().enumerate() {
            for place in places(group) {
                let values = Values::of(samples, layout, [g, place]);
                found.extend(values.cut(g).filter(|cut| cut.apart > APART));
            }
        }
        found.sort_by(|one, other| other.apart.total_cmp(&one.apart));
        let mut cuts: Vec<Cut> = vec![];
        for cut in found {
            if cuts.len() < MOST && !cuts.iter().any(|other| cut.is_as(other)) {
                cuts.push(cut);
            }
        }
        let mut swaps: Vec<Self> = cuts.iter().map(|cut| Self::new(samples, cut, layout)).collect();
        for one in earlier {
            if swaps.len() < MOST && !swaps.iter().any(|swap| swap.has_place_of(one)) {
                swaps.push(one.clone());
            }
        }
        swaps
    }

    fn new(samples: &[Sample], cut: &Cut, layout: &Layout) -> Self {
        let group = &layout.groups[cut.group];
        let mut parts: Vec<(usize, Between)> = places(group)
            .filter_map(|place| {
                let values = Values::of(samples, layout, [cut.group, place]);
                Some((place, values.between(&cut.is_high)?))
            })
            .filter(|(_, between)| between.apart > TAKES_PART)
            .collect();
        parts.sort_by(|(_, one), (_, other)| other.apart.total_cmp(&one.apart));
        parts.truncate(MOST_PLACES);
        let all = |of: fn(&Between) -> &DVector<f64>| {
            let block = |f: usize| parts.iter().map(move |(_, between)| of(between)[f]);
            (0..group.blocks.len()).flat_map(block).collect()
        };
        Self {
            group: cut.group,
            shift: all(|between| &between.shift),
            slack: all(|between| &between.slack),
            places: parts.iter().map(|(place, _)| *place).collect(),
        }
    }

    /// Δz, and which coefficients it is of; `None` where it cannot be computed.
    pub(super) fn step(
        &self,
        whitening: &Whitening,
        layout: &Layout,
    ) -> Option<(Range<usize>, DVector<f64>)> {
        let n_seen = layout.groups[self.group].n_seen;
        let (coefficients, n_latent) = whitening.of_group(self.group);
        let (_, basis) = whitening.basis(self.group);
        let n_places = self.places.len();
        let at = |i: usize| i / n_places * n_seen + self.places[i % n_places];
        let entry = |i: usize, k: usize| basis[k * n_latent + at(i)];
        let rows = DMatrix::from_fn(self.shift.len(), coefficients.len(), entry);
        let slack = DMatrix::from_diagonal(&DVector::from_column_slice(&self.slack));
        let factor = Cholesky::new(&rows * rows.transpose() + slack)?;
        Some((coefficients, rows.tr_mul(&factor.solve(&DVector::from_column_slice(&self.shift)))))
    }

    fn has_place_of(&self, other: &Self) -> bool {
        self.group == other.group && other.places.iter().any(|place| self.places.contains(place))
    }

    /// Whether it is one of this layout.
    pub(super) fn fits(&self, layout: &Layout) -> bool {
        let of = |group: &Group| {
            let n = self.places.len() * group.blocks.len();
            n > 0
                && self.places.iter().all(|place| *place < group.n_seen)
                && [self.shift.len(), self.slack.len()] == [n; 2]
        };
        layout.groups.get(self.group).is_some_and(of)
    }
}

impl Cut {
    /// Whether both are of the same regimes.
    fn is_as(&self, other: &Self) -> bool {
        let agree = self.is_high.iter().zip(&other.is_high).filter(|(one, other)| one == other);
        let share = agree.count() as f64 / self.is_high.len() as f64;
        self.group == other.group && share.max(1.0 - share) >= SAME
    }
}

/// The places that are looked at: all, or so many that the others lie between them.
fn places(group: &Group) -> impl Iterator<Item = usize> {
    (0..group.n_seen).step_by(group.n_seen.div_ceil(MOST_TRIED).max(1))
}

/// The values at one place, `(draw, block)`.
struct Values {
    n_blocks: usize,
    all: Vec<f64>,
}

/// What is different between two clusters at a place.
struct Between {
    /// The difference of their means.
    shift: DVector<f64>,
    slack: DVector<f64>,
    /// How far the means are apart, in the standard deviations within the clusters.
    apart: f64,
}

impl Values {
    fn of<'s>(samples: &'s [Sample], layout: &'s Layout, [g, place]: [usize; 2]) -> Self {
        let group = &layout.groups[g];
        let n_blocks = group.blocks.len();
        let at = move |f: usize| layout.n_latent_before(g) + f * group.n_seen + place;
        let values = move |sample: &'s Sample| (0..n_blocks).map(move |f| sample.theta[at(f)]);
        Self { n_blocks, all: samples.iter().flat_map(values).collect() }
    }

    fn draws(&self) -> ChunksExact<'_, f64> {
        self.all.chunks_exact(self.n_blocks)
    }

    /// Cuts in two along the axis on which the values vary most, in units of each block, so that the clusters vary least.
    /// `None` where they do not vary, or are too few.
    fn cut(&self, group: usize) -> Option<Cut> {
        let n = self.draws().len();
        if n < 2 * LEAST {
            return None;
        }
        let (_, covariance) = moments(self.draws());
        let scale = covariance.diagonal().map(|variance| 1.0 / variance.sqrt());
        if !scale.iter().all(|scale| scale.is_normal()) {
            return None;
        }
        let scales = DMatrix::from_diagonal(&scale);
        let eigen = (&scales * covariance * &scales).symmetric_eigen();
        let axis = scales * eigen.eigenvectors.column(eigen.eigenvalues.imax());
        let along: Vec<f64> =
            self.draws().map(|x| x.iter().zip(&axis).map(|(x, a)| x * a).sum()).collect();
        let mean = along.iter().sum::<f64>() / n as f64;
        let mut sorted = along.clone();
        sorted.sort_by(f64::total_cmp);
        let (mut low, mut best, mut most) = (0.0, 0.0, 0.0);
        for (i, pair) in sorted.windows(2).enumerate() {
            low += pair[0] - mean;
            let [n_low, n_high] = [i + 1, n - i - 1];
            // the sum over all draws is 0
            let between = low * low * (1.0 / n_low as f64 + 1.0 / n_high as f64);
            if n_low.min(n_high) >= LEAST && pair[0] < pair[1] && between > most {
                (best, most) = (pair[0], between);
            }
        }
        if most == 0.0 {
            return None;
        }
        let is_high: Vec<bool> = along.iter().map(|x| *x > best).collect();
        let line = Self { n_blocks: 1, all: along };
        Some(Cut { apart: line.between(&is_high)?.apart, group, is_high })
    }

    /// `None` where the values do not vary within the clusters.
    fn between(&self, is_high: &[bool]) -> Option<Between> {
        let cluster = |high: bool| {
            let own = self.draws().zip(is_high).filter(|(_, is)| **is == high);
            moments(own.map(|(x, _)| x))
        };
        let [(low, spread_low), (high, spread_high)] = [false, true].map(cluster);
        let (shift, within) = (high - low, (spread_low + spread_high) * 0.5);
        let slack = within.diagonal() * SLACK;
        let apart = shift.dot(&Cholesky::new(within)?.solve(&shift)).sqrt();
        Some(Between { shift, slack, apart })
    }
}

/// Mean and covariance of draws, of which there is at least one.
fn moments<'v>(draws: impl Iterator<Item = &'v [f64]> + Clone) -> (DVector<f64>, DMatrix<f64>) {
    let n_blocks = draws.clone().next().map_or(0, <[f64]>::len);
    let n = draws.clone().count() as f64;
    let mut mean = DVector::zeros(n_blocks);
    for draw in draws.clone() {
        mean.iter_mut().zip(draw).for_each(|(mean, x)| *mean += x / n);
    }
    let mut covariance = DMatrix::zeros(n_blocks, n_blocks);
    for draw in draws {
        for f in 0..n_blocks {
            for g in 0..n_blocks {
                covariance[(f, g)] += (draw[f] - mean[f]) * (draw[g] - mean[g]) / n;
            }
        }
    }
    (mean, covariance)
}
