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
        let line = Self::new(1, along);
        Some(Cut { apart: line.between(&is_high)?.apart, is_high })
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
