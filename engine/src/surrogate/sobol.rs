//! Sobol indices: the shares of a function's variance that each input causes, alone and together
//! with others.
//!
//! Knows a function on the unit cube; it knows nothing of what the inputs mean.
//!
//! ```text
//! first S_d = Var E(f | x_d)/Var f        total T_d = 1 − Var E(f | all but x_d)/Var f
//! with A, B independent points and C_d = A with coordinate d of B:
//! S_d ≈ 1 − ½ mean (f(B) − f(C_d))²/Var f        T_d ≈ ½ mean (f(A) − f(C_d))²/Var f
//! ```
//!
//! # Source
//! Jansen 1999, "Analysis of variance designs for model output"; Saltelli et al. 2010.

use crate::random::procedure;
use rand::RngExt;

/// Pairs of points A, B.
const N_PAIRS: usize = 1 << 14;

/// Resamples behind a standard error.
const N_RESAMPLES: usize = 100;

/// An estimate and its standard error (bootstrap over pairs of points).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The estimate.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
}

/// The indices of one input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SobolIndex {
    /// First-order: what the input causes alone.
    pub first: Estimate,
    /// Total: what the input causes alone and together with others.
    pub total: Estimate,
}

/// f at A, B and the `C_d` of one pair.
struct Pair {
    a: f64,
    b: f64,
    c: Vec<f64>,
}

/// The indices of each of `f`'s `n_inputs` inputs, which are independent and uniform on 0..1.
pub fn sobol(f: impl Fn(&[f64]) -> f64, n_inputs: usize, seed: u64) -> Vec<SobolIndex> {
    let mut rng = procedure(seed);
    let mut point = || (0..n_inputs).map(|_| rng.random::<f64>()).collect::<Vec<f64>>();
    let pairs: Vec<Pair> = (0..N_PAIRS)
        .map(|_| {
            let (mut a, b) = (point(), point());
            let at_a = f(&a);
            let crossed = (0..n_inputs).map(|d| {
                let own = std::mem::replace(&mut a[d], b[d]);
                let value = f(&a);
                a[d] = own;
                value
            });
            Pair { a: at_a, c: crossed.collect(), b: f(&b) }
        })
        .collect();
    let resamples: Vec<Vec<[f64; 2]>> = (0..N_RESAMPLES)
        .map(|_| indices(n_inputs, (0..N_PAIRS).map(|_| &pairs[rng.random_range(0..N_PAIRS)])))
        .collect();
    let all = indices(n_inputs, pairs.iter());
    let estimate = |d: usize, which: usize| {
        let values = || resamples.iter().map(|r| r[d][which]);
        let mean = values().sum::<f64>() / N_RESAMPLES as f64;
        let squares: f64 = values().map(|v| (v - mean).powi(2)).sum();
        Estimate { value: all[d][which], error: (squares / (N_RESAMPLES - 1) as f64).sqrt() }
    };
    (0..n_inputs).map(|d| SobolIndex { first: estimate(d, 0), total: estimate(d, 1) }).collect()
}

/// First-order and total index of each input.
fn indices<'a>(n_inputs: usize, pairs: impl Iterator<Item = &'a Pair>) -> Vec<[f64; 2]> {
    let (mut n, mut sum, mut square) = (0.0, 0.0, 0.0);
    let mut half_squares = vec![[0.0; 2]; n_inputs];
    for Pair { a, b, c } in pairs {
        n += 1.0;
        sum += 0.5 * (a + b);
        square += 0.5 * (a * a + b * b);
        for (sums, c) in half_squares.iter_mut().zip(c) {
            sums[0] += 0.5 * (b - c) * (b - c);
            sums[1] += 0.5 * (a - c) * (a - c);
        }
    }
    let total = square - sum * sum / n;
    half_squares.into_iter().map(|[first, all]| [1.0 - first / total, all / total]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Within 4.5 standard errors, which are below `error`.
    fn assert_indices(got: &[SobolIndex], expected: &[[f64; 2]], error: f64) {
        for (got, expected) in got.iter().zip(expected) {
            for (estimate, expected) in [got.first, got.total].iter().zip(expected) {
                let difference = (estimate.value - expected).abs();
                assert!(difference < 4.5 * estimate.error + 1e-9, "{estimate:?} {expected}");
                assert!(estimate.error < error, "{estimate:?}");
            }
        }
    }

    /// Ishigami and Homma 1990, a = 7, b = 0.1: indices in closed form.
    #[test]
    fn of_the_ishigami_function() {
        let f = |u: &[f64]| {
            let x: Vec<f64> = u.iter().map(|u| PI * (2.0 * u - 1.0)).collect();
            x[0].sin() + 7.0 * x[1].sin().powi(2) + 0.1 * x[2].powi(4) * x[0].sin()
        };
        let alone = 0.5 * (1.0 + 0.1 * PI.powi(4) / 5.0).powi(2);
        let second = 49.0 / 8.0;
        let both = 0.01 * PI.powi(8) * (1.0 / 18.0 - 1.0 / 50.0);
        let all = alone + second + both;
        let expected =
            [[alone, alone + both], [second, second], [0.0, both]].map(|s| s.map(|v| v / all));
        let got = sobol(f, 3, 1);
        assert_indices(&got, &expected, 0.02);
        // the two estimators differ where inputs interact: exchanged, they are found out
        assert!((got[0].first.value - expected[0][1]).abs() > 10.0 * got[0].first.error);
    }

    /// Sobol's g-function: f = Π (|4u − 2| + a)/(1 + a).
    #[test]
    fn of_the_g_function() {
        let a = [0.0, 1.0, 4.5, 9.0, 99.0];
        let f = |u: &[f64]| -> f64 {
            u.iter().zip(a).map(|(u, a)| ((4.0 * u - 2.0).abs() + a) / (1.0 + a)).product()
        };
        let own = a.map(|a| 1.0 / (3.0 * (1.0 + a) * (1.0 + a)));
        let product =
            |skip: usize| -> f64 { (0..5).filter(|&d| d != skip).map(|d| 1.0 + own[d]).product() };
        let all = product(5) - 1.0;
        let expected: Vec<[f64; 2]> =
            (0..5).map(|d| [own[d] / all, own[d] * product(d) / all]).collect();
        assert_indices(&sobol(f, 5, 2), &expected, 0.02);
    }
}
