//! Whether draws of some quantities fall into two regimes.
//!
//! # Source
//! Ashman, Bird & Zepf 1994, "Detecting bimodality in astronomical datasets", for the distance of two clusters.

use nalgebra::{Cholesky, DMatrix, DVector};
use std::slice::ChunksExact;

/// Two clusters are two regimes if their means are farther apart than this, in standard deviations within them. A normal
/// that is cut in two at its mean has 2.6, a uniform 3.5.
pub const APART: f64 = 4.0;
/// Fewest draws in a cluster.
const CLUSTER: usize = 3;
/// Fewest draws in all: of a few, clusters are far apart by chance.
const FEWEST: usize = 50;
/// Where the valley between two clusters is looked for: so many places between their means.
const PLACES: usize = 33;
/// Draws in the valley: at most this share of those on its lower side.
const VALLEY: f64 = 1.0 / 3.0;
/// So many of its own standard deviations is the difference of both counts, at least: less may be chance.
const BY_CHANCE: f64 = 4.0;
/// Two cuts are of the same regimes if they agree in this share of the draws.
const SAME: f64 = 0.8;

/// Draws of quantities that may change together.
#[derive(Clone, Debug)]
pub struct Draws {
    n_quantities: usize,
    /// `(draw, quantity)`
    all: Vec<f64>,
}

/// A cut of draws into two clusters.
#[derive(Clone, Debug)]
pub struct Cut {
    /// In which of both each draw is.
    pub is_high: Vec<bool>,
    /// How far their means are apart, in standard deviations.
    pub apart: f64,
    /// Whether a stretch between them has fewer draws than on both sides of it. A long tail has no such stretch.
    pub has_valley: bool,
}

/// What is different between two clusters.
#[derive(Clone, Debug)]
pub struct Between {
    /// The means of the low cluster and of the high one.
    pub means: [DVector<f64>; 2],
    /// The mean variance within the clusters, of each quantity.
    pub variance: DVector<f64>,
    /// How far the means are apart in any direction, in the standard deviations within the clusters.
    pub apart: f64,
}

impl Draws {
    /// From `(draw, quantity)`.
    pub fn new(n_quantities: usize, all: Vec<f64>) -> Self {
        Self { n_quantities, all }
    }

    fn each(&self) -> ChunksExact<'_, f64> {
        self.all.chunks_exact(self.n_quantities)
    }

    /// Cuts the draws in two where both parts vary least, along the axis on which they vary most together when each quantity
    /// is divided by its standard deviation. `None` where a quantity does not vary, or draws are too few.
    pub fn cut(&self) -> Option<Cut> {
        let n = self.each().len();
        if n < FEWEST {
            return None;
        }
        let (_, covariance) = moments(self.each());
        let scale = covariance.diagonal().map(|variance| 1.0 / variance.sqrt());
        if !scale.iter().all(|scale| scale.is_normal()) {
            return None;
        }
        let scales = DMatrix::from_diagonal(&scale);
        let eigen = (&scales * covariance * &scales).symmetric_eigen();
        let axis = scales * eigen.eigenvectors.column(eigen.eigenvalues.imax());
        let dot = |x: &[f64]| x.iter().zip(&axis).map(|(x, a)| x * a).sum();
        let along: Vec<f64> = self.each().map(dot).collect();
        let mean = along.iter().sum::<f64>() / n as f64;
        let mut sorted = along.clone();
        sorted.sort_by(f64::total_cmp);
        let (mut low, mut best, mut most) = (0.0, 0.0, 0.0);
        for (i, pair) in sorted.windows(2).enumerate() {
            low += pair[0] - mean;
            let [n_low, n_high] = [i + 1, n - i - 1];
            // of both means about the mean of all, weighted by the number of draws
            let between = low * low * (1.0 / n_low as f64 + 1.0 / n_high as f64);
            if n_low.min(n_high) >= CLUSTER && pair[0] < pair[1] && between > most {
                (best, most) = (pair[0], between);
            }
        }
        if most == 0.0 {
            return None;
        }
        let is_high: Vec<bool> = along.iter().map(|x| *x > best).collect();
        let Between { means: [low, high], apart, .. } = Self::new(1, along).between(&is_high)?;
        Some(Cut { apart, has_valley: has_valley(&sorted, low[0], high[0], apart), is_high })
    }

    /// What is different between the clusters of a cut; `None` where nothing varies within them.
    pub fn between(&self, is_high: &[bool]) -> Option<Between> {
        let cluster = |high: bool| {
            let own = self.each().zip(is_high).filter(|(_, is)| **is == high);
            moments(own.map(|(x, _)| x))
        };
        let [(low, spread_low), (high, spread_high)] = [false, true].map(cluster);
        let (shift, within) = (&high - &low, (spread_low + spread_high) * 0.5);
        let variance = within.diagonal();
        let apart = shift.dot(&Cholesky::new(within)?.solve(&shift)).sqrt();
        Some(Between { means: [low, high], variance, apart })
    }
}

impl Cut {
    /// Whether both, of the same draws, are of the same regimes, whichever cluster is called high.
    pub fn is_as(&self, other: &Self) -> bool {
        let same = self.is_high.iter().zip(&other.is_high).filter(|(one, other)| one == other);
        let share = same.count() as f64 / self.is_high.len() as f64;
        share.max(1.0 - share) >= SAME
    }

    /// The share of the draws in the high cluster.
    pub fn high(&self) -> f64 {
        self.is_high.iter().filter(|is| **is).count() as f64 / self.is_high.len() as f64
    }
}

/// Whether there are few draws between the means of two clusters, in a stretch as long as a standard deviation within
/// them: fewer than in such stretches on both sides, and not by chance.
fn has_valley(sorted: &[f64], low: f64, high: f64, apart: f64) -> bool {
    let sd = (high - low) / apart;
    let below = |x: f64| sorted.partition_point(|draw| *draw < x);
    let count = |from: f64| (below(from + sd) - below(from)) as f64;
    let place = |i: usize| low + (high - sd - low) * i as f64 / (PLACES - 1) as f64;
    let fewest = (0..PLACES).map(place).min_by(|a, b| count(*a).total_cmp(&count(*b)));
    let Some(from) = fewest else { return false };
    let most = |draws: &[f64]| draws.iter().map(|draw| count(*draw)).fold(0.0, f64::max);
    let side = most(&sorted[..below(from - sd)]).min(most(&sorted[below(from + sd)..]));
    let valley = count(from);
    valley <= VALLEY * side && side - valley >= BY_CHANCE * (side + valley).sqrt()
}

/// Mean and covariance of draws, of which there is at least one.
fn moments<'v>(draws: impl Iterator<Item = &'v [f64]> + Clone) -> (DVector<f64>, DMatrix<f64>) {
    let n_quantities = draws.clone().next().map_or(0, <[f64]>::len);
    let n = draws.clone().count() as f64;
    let mut mean = DVector::zeros(n_quantities);
    for draw in draws.clone() {
        mean.iter_mut().zip(draw).for_each(|(mean, x)| *mean += x / n);
    }
    let mut covariance = DMatrix::zeros(n_quantities, n_quantities);
    for draw in draws {
        for f in 0..n_quantities {
            for g in 0..n_quantities {
                covariance[(f, g)] += (draw[f] - mean[f]) * (draw[g] - mean[g]) / n;
            }
        }
    }
    (mean, covariance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    /// 1,000 draws: each of a standard normal, or with a probability what `other` draws.
    fn cut(seed: u64, share: f64, other: impl Fn(&mut ChaCha8Rng) -> f64) -> Cut {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draw =
            || if rng.random_bool(share) { other(&mut rng) } else { rng.sample(StandardNormal) };
        Draws::new(1, (0..1000).map(|_| draw()).collect()).cut().unwrap()
    }

    /// Of 100 cuts, how many have clusters that are far apart, and how many of these have a valley between them.
    fn counts(share: f64, other: impl Fn(&mut ChaCha8Rng) -> f64) -> [usize; 2] {
        let cuts = (0..100).map(|seed| cut(seed, share, &other));
        let apart: Vec<Cut> = cuts.filter(|cut| cut.apart > APART).collect();
        [apart.len(), apart.iter().filter(|cut| cut.has_valley).count()]
    }

    #[test]
    fn a_long_tail_is_no_regime_of_its_own() {
        let normal = |rng: &mut ChaCha8Rng| rng.sample::<f64, _>(StandardNormal);
        assert_eq!(counts(0.1, |rng| 8.0 + normal(rng)), [100, 100]);
        assert_eq!(counts(0.05, |rng| 8.0 + 0.5 * normal(rng)), [100, 100]);
        assert_eq!(counts(0.4, normal)[1], 0);
        for share in [0.05, 0.1, 0.2] {
            let [apart, parted] = counts(share, |rng| rng.random_range(2.0..9.0));
            println!("{share} {apart} {parted}");
            assert!(apart > 50 && parted < 3, "{share}: {parted} of {apart}");
        }
    }
}
