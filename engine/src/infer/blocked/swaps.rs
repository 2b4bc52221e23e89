//! Steps of a region of the surface from one regime to another.
//!
//! Measurements can allow two regimes of the values at neighbouring places: `tau_out` 15 ms with `apd_max` 130 ms, or
//! 29 ms with 100 ms. Hardly any trajectory goes from one to the other, for what lies between them is next to
//! impossible. Draws of the warm-up and what [`scouts`](super::scouts) find tell of such regimes: the values at a
//! place fall into two clusters that are far apart. The *swap* of that place is the difference of the
//! clusters' means, there and wherever else it is large.
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

use super::groups::Whitening;
use super::latent::{Group, Layout};
use super::stand_in::Sample;
use crate::diagnostics::regimes::{APART, Between, Cut, Draws};
use nalgebra::{Cholesky, DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Least distance of both regimes' means at a place that takes part in a swap, in standard deviations in any direction.
const TAKES_PART: f64 = 2.0;
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

impl Swap {
    /// Those that draws tell of, and earlier ones of regimes that these do not tell of.
    pub(super) fn of(samples: &[Sample], earlier: &[Self], layout: &Layout) -> Vec<Self> {
        let mut found = vec![];
        for (g, group) in layout.groups.iter().enumerate() {
            for place in places(group) {
                let cut = values(samples, layout, [g, place]).cut();
                found.extend(cut.filter(|cut| cut.apart > APART).map(|cut| (g, cut)));
            }
        }
        found.sort_by(|(_, one), (_, other)| other.apart.total_cmp(&one.apart));
        let mut cuts: Vec<(usize, Cut)> = vec![];
        for (g, cut) in found {
            let is_same = |(of, other): &(usize, Cut)| *of == g && cut.is_as(other);
            if cuts.len() < MOST && !cuts.iter().any(is_same) {
                cuts.push((g, cut));
            }
        }
        let of_cut = |(g, cut): &(usize, Cut)| Self::new(samples, layout, *g, cut);
        let mut swaps: Vec<Self> = cuts.iter().map(of_cut).collect();
        swaps.retain(|swap| !swap.places.is_empty());
        for one in earlier {
            if swaps.len() < MOST && !swaps.iter().any(|swap| swap.has_place_of(one)) {
                swaps.push(one.clone());
            }
        }
        swaps
    }

    fn new(samples: &[Sample], layout: &Layout, g: usize, cut: &Cut) -> Self {
        let group = &layout.groups[g];
        let between =
            |place| Some((place, values(samples, layout, [g, place]).between(&cut.is_high)?));
        let mut parts: Vec<(usize, Between)> = places(group)
            .filter_map(between)
            .filter(|(_, between)| between.apart > TAKES_PART)
            .collect();
        parts.sort_by(|(_, one), (_, other)| other.apart.total_cmp(&one.apart));
        parts.truncate(MOST_PLACES);
        let all = |of: fn(&Between, usize) -> f64| {
            let block = |f: usize| parts.iter().map(move |(_, between)| of(between, f));
            (0..group.blocks.len()).flat_map(block).collect()
        };
        Self {
            group: g,
            shift: all(|between, f| between.means[1][f] - between.means[0][f]),
            slack: all(|between, f| SLACK * between.variance[f]),
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

/// The places that are looked at: all, or so many that the others lie between them.
fn places(group: &Group) -> impl Iterator<Item = usize> {
    (0..group.n_seen).step_by(group.n_seen.div_ceil(MOST_TRIED).max(1))
}

/// The values of the blocks at one place in all draws.
fn values(samples: &[Sample], layout: &Layout, [g, place]: [usize; 2]) -> Draws {
    let group = &layout.groups[g];
    let n_blocks = group.blocks.len();
    let first = layout.n_latent_before(g) + place;
    let of_sample = |s: &Sample| -> Vec<f64> {
        (0..n_blocks).map(|f| s.theta[first + f * group.n_seen]).collect()
    };
    Draws::new(n_blocks, samples.iter().flat_map(of_sample).collect())
}
