//! Space-filling designs: a Latin hypercube made maximin by swaps.
//!
//! Knows ranges and numbers; it knows nothing of what the columns mean.

use crate::random::procedure;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Proposed swaps per point of the design.
const SWAPS_PER_POINT: usize = 200;

/// Exponent of the criterion: large enough that the closest pairs decide.
const EXPONENT: i32 = 15;

/// `n` points in the box `ranges` (lower, upper), each column a permutation of `n` cell centres.
///
/// Starts from a random Latin hypercube and swaps two entries of a column wherever this lowers
/// `φ = Σ_{i<j} d_ij^−15`, with `d` the distance in the unit cube: the smooth form of "the closest pair
/// is as far apart as possible".  The same seed gives the same design.
///
/// # Source
/// Morris and Mitchell 1995, "Exploratory designs for computational experiments".
pub fn latin_hypercube(n: usize, ranges: &[(f64, f64)], seed: u64) -> Vec<Vec<f64>> {
    let mut rng = procedure(seed);
    let mut unit = random_hypercube(n, ranges.len(), &mut rng);
    if n > 1 {
        for _ in 0..SWAPS_PER_POINT * n {
            let column = rng.random_range(0..ranges.len());
            let a = rng.random_range(0..n);
            let b = rng.random_range(0..n - 1);
            propose_swap(&mut unit, column, a, b + usize::from(b >= a));
        }
    }
    for point in &mut unit {
        for (u, (lower, upper)) in point.iter_mut().zip(ranges) {
            *u = lower + *u * (upper - lower);
        }
    }
    unit
}

/// A random Latin hypercube in the unit cube.
pub(super) fn random_hypercube(n: usize, dim: usize, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let mut unit = vec![vec![0.0; dim]; n];
    for d in 0..dim {
        for (i, point) in unit.iter_mut().enumerate() {
            point[d] = (i as f64 + 0.5) / n as f64;
        }
        for i in (1..n).rev() {
            let j = rng.random_range(0..=i);
            let held = unit[i][d];
            unit[i][d] = unit[j][d];
            unit[j][d] = held;
        }
    }
    unit
}

/// Swaps column `d` of points `a` and `b` unless that brings points closer together.
fn propose_swap(unit: &mut [Vec<f64>], d: usize, a: usize, b: usize) {
    let before = crowding(unit, a, b);
    let (at_a, at_b) = (unit[a][d], unit[b][d]);
    (unit[a][d], unit[b][d]) = (at_b, at_a);
    if crowding(unit, a, b) > before {
        (unit[a][d], unit[b][d]) = (at_a, at_b);
    }
}

/// The part of φ that involves `a` or `b` but not their mutual distance, which a swap leaves alone.
fn crowding(unit: &[Vec<f64>], a: usize, b: usize) -> f64 {
    let others = unit.iter().enumerate().filter(|&(i, _)| i != a && i != b);
    others.map(|(_, p)| repulsion(p, &unit[a]) + repulsion(p, &unit[b])).sum()
}

fn repulsion(p: &[f64], q: &[f64]) -> f64 {
    let squared: f64 = p.iter().zip(q).map(|(x, y)| (x - y) * (x - y)).sum();
    squared.sqrt().powi(-EXPONENT)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGES: [(f64, f64); 3] = [(0.1, 1.5), (1.0, 30.0), (120.0, 270.0)];

    /// Smallest distance of two points, in the unit cube.
    fn closest_pair(points: &[Vec<f64>]) -> f64 {
        let unit = |p: &[f64], d: usize| (p[d] - RANGES[d].0) / (RANGES[d].1 - RANGES[d].0);
        let mut closest = f64::INFINITY;
        for (i, p) in points.iter().enumerate() {
            for q in &points[..i] {
                let squared: f64 = (0..3).map(|d| (unit(p, d) - unit(q, d)).powi(2)).sum();
                closest = closest.min(squared.sqrt());
            }
        }
        closest
    }

    #[test]
    fn every_cell_of_every_column_is_used_once() {
        let n = 40;
        let points = latin_hypercube(n, &RANGES, 3);
        for (d, (lower, upper)) in RANGES.iter().enumerate() {
            let mut cells: Vec<usize> = points
                .iter()
                .map(|p| ((p[d] - lower) / (upper - lower) * n as f64) as usize)
                .collect();
            cells.sort_unstable();
            assert_eq!(cells, (0..n).collect::<Vec<_>>());
        }
    }

    /// Ten designs of either kind: the worst optimised one is twice as wide as the best random one.
    #[test]
    fn swapping_spreads_the_points() {
        let random = |seed| {
            let mut points = random_hypercube(100, 3, &mut procedure(seed));
            for point in &mut points {
                for (u, (lower, upper)) in point.iter_mut().zip(RANGES) {
                    *u = lower + *u * (upper - lower);
                }
            }
            closest_pair(&points)
        };
        let optimised = |seed| closest_pair(&latin_hypercube(100, &RANGES, seed));
        let widest_random = (0..10).map(random).fold(0.0, f64::max);
        let narrowest = (0..10).map(optimised).fold(f64::INFINITY, f64::min);
        // A cubic lattice of 100 points in the unit cube has spacing 0.215.
        assert!(narrowest > 0.13 && narrowest > 2.0 * widest_random, "{narrowest} {widest_random}");
    }

    #[test]
    fn the_seed_decides_and_one_point_is_the_centre() {
        assert_eq!(latin_hypercube(9, &RANGES, 1), latin_hypercube(9, &RANGES, 1));
        assert_ne!(latin_hypercube(9, &RANGES, 1), latin_hypercube(9, &RANGES, 2));
        assert_eq!(latin_hypercube(1, &[(0.0, 2.0)], 1), vec![[1.0]]);
    }
}
