//! Least squares with few terms: of many functions, only those are kept that are worth their
//! coefficient.
//!
//! Knows columns of numbers and a target; it knows nothing of what they mean.
//!
//! ```text
//! in each step the column that takes most from the residual's square, (wᵀr)²/wᵀw, where w is what the columns
//! chosen before leave of it; until √(rᵀr/n) is below a tolerance
//! ```
//!
//! # Source
//! Chen, Billings and Luo 1989, "Orthogonal least squares methods and their application to non-linear system
//! identification".

use crate::num::vector::dot;
use faer::Mat;
use faer::linalg::solvers::SolveLstsq;

/// If the chosen columns leave less than this share of a column's square, it is taken for a sum of
/// them.
const DEPENDENT: f64 = 1e-8;

/// Chooses at most `most` of `columns`, each `(n)`. It stops at the first choice that is within
/// `tolerance` (root mean square) of `target` `(n)`. Returns the places of the chosen columns, in
/// the order of `columns`, and their coefficients.
pub(super) fn few_terms(
    columns: &[Vec<f64>],
    target: &[f64],
    tolerance: f64,
    most: usize,
) -> Vec<(usize, f64)> {
    let (mut left, mut residual) = (columns.to_vec(), target.to_vec());
    let dependent: Vec<f64> = columns.iter().map(|w| DEPENDENT * dot::<1>(w, w)).collect();
    let enough = tolerance * tolerance * target.len() as f64;
    let mut chosen = vec![];
    while dot::<1>(&residual, &residual) > enough && chosen.len() < most {
        let gain = |k: usize| {
            let square = dot::<1>(&left[k], &left[k]);
            if square > dependent[k] { dot::<1>(&left[k], &residual).powi(2) / square } else { 0.0 }
        };
        let gains: Vec<f64> = (0..left.len()).map(gain).collect();
        let Some(best) = (0..left.len()).max_by(|&a, &b| gains[a].total_cmp(&gains[b])) else {
            break;
        };
        if !(gains[best] > 0.0) {
            break;
        }
        chosen.push(best);
        let direction = left[best].clone();
        subtract(&mut residual, &direction);
        for column in &mut left {
            subtract(column, &direction);
        }
    }
    chosen.sort_unstable();
    let design = Mat::from_fn(target.len(), chosen.len(), |i, k| columns[chosen[k]][i]);
    let goal = Mat::from_fn(target.len(), 1, |i, _| target[i]);
    let coefficients = design.qr().solve_lstsq(goal);
    chosen.into_iter().enumerate().map(|(k, place)| (place, coefficients[(k, 0)])).collect()
}

/// `a` less its component along `direction`.
fn subtract(a: &mut [f64], direction: &[f64]) {
    let share = dot::<1>(a, direction) / dot::<1>(direction, direction);
    a.iter_mut().zip(direction).for_each(|(a, d)| *a -= share * d);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn powers() -> Vec<Vec<f64>> {
        let at = |i: i32| f64::from(i) / 20.0 - 1.0;
        (0..8).map(|k| (0..41).map(|i| at(i).powi(k)).collect()).collect()
    }

    #[test]
    fn a_sum_of_three_of_eight_columns_is_found() {
        let columns = powers();
        let target: Vec<f64> =
            (0..41).map(|i| 2.0 - 3.0 * columns[4][i] + 0.5 * columns[5][i]).collect();
        let found = few_terms(&columns, &target, 1e-9, 8);
        let significant: Vec<_> = found.iter().filter(|(_, c)| c.abs() > 1e-6).collect();
        assert_eq!(significant.iter().map(|t| t.0).collect::<Vec<_>>(), [0, 4, 5]);
        for ((_, c), expected) in significant.iter().zip([2.0, -3.0, 0.5]) {
            assert!((c - expected).abs() < 1e-6, "{found:?}");
        }
    }

    #[test]
    fn terms_end_at_the_tolerance_or_at_the_most() {
        let columns = powers();
        let target: Vec<f64> = columns[1].iter().map(|x| (2.0 * x).exp()).collect();
        let rms = |terms: &[(usize, f64)]| {
            let off =
                |i: usize| target[i] - terms.iter().map(|(k, c)| c * columns[*k][i]).sum::<f64>();
            ((0..41).map(|i| off(i).powi(2)).sum::<f64>() / 41.0).sqrt()
        };
        let near = few_terms(&columns, &target, 0.05, 8);
        assert!(rms(&near) < 0.05 && near.len() < 6, "{near:?}");
        assert!(rms(&few_terms(&columns, &target, 0.05, near.len() - 1)) > 0.05);
        // the same column twice is one column
        let twice = [columns[0].clone(), columns[0].clone()];
        assert_eq!(few_terms(&twice, &target, 0.05, 2).len(), 1);
    }
}
