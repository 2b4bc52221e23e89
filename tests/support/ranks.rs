//! Whether ranks are uniform: chi-square, and the empirical distribution function within a simultaneous band.
//!
//! # Source
//! Talts, Betancourt, Simpson, Vehtari & Gelman 2018, "Validating Bayesian inference algorithms with
//! simulation-based calibration"; Säilynoja, Bürkner & Vehtari 2022, "Graphical test for discrete uniformity and its
//! applications in goodness-of-fit evaluation and multiple sample comparison".

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Bins of the chi-square test.
const BINS: usize = 20;

/// Both tests for `n` ranks of 0 ..= `largest`, with their null distributions from simulated ranks.
pub(crate) struct Uniformity {
    n: usize,
    largest: usize,
    /// P(fewer than k of n ranks below i), `(i, k)`.
    below: Vec<Vec<f64>>,
    /// Sorted statistics of uniform ranks: chi-square, and the least pointwise tail probability.
    null: [Vec<f64>; 2],
}

impl Uniformity {
    const SIMULATIONS: usize = 20_000;

    pub(crate) fn new(n: usize, largest: usize) -> Self {
        assert!((largest + 1).is_multiple_of(BINS), "bins of equal width");
        let share = |i: usize| i as f64 / (largest + 1) as f64;
        let below = (1..=largest).map(|i| fewer(n, share(i))).collect();
        let mut tests = Self { n, largest, below, null: [vec![], vec![]] };
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for _ in 0..Self::SIMULATIONS {
            let ranks: Vec<usize> = (0..n).map(|_| rng.random_range(0..=largest)).collect();
            let tail = tests.least_tail(&ranks);
            tests.null[0].push(chi_square(&ranks, largest));
            tests.null[1].push(tail);
        }
        tests.null.iter_mut().for_each(|null| null.sort_by(f64::total_cmp));
        tests
    }

    /// p values of both tests: [chi-square, band].
    pub(crate) fn p_values(&self, ranks: &[usize]) -> [f64; 2] {
        assert_eq!(ranks.len(), self.n);
        let [chi_squares, tails] = &self.null;
        let as_high = |x: f64| chi_squares.len() - chi_squares.partition_point(|null| *null < x);
        let as_low = |x: f64| tails.partition_point(|null| *null <= x);
        let counts = [as_high(chi_square(ranks, self.largest)), as_low(self.least_tail(ranks))];
        counts.map(|count| (count + 1) as f64 / (Self::SIMULATIONS + 1) as f64)
    }

    /// The least two-sided binomial tail probability of the empirical distribution function at any rank: the
    /// band that just touches it has this pointwise level.
    fn least_tail(&self, ranks: &[usize]) -> f64 {
        let mut counts = vec![0usize; self.largest + 1];
        for rank in ranks {
            counts[*rank] += 1;
        }
        let (mut k, mut least) = (0, 1f64);
        for (count, below) in counts.iter().zip(&self.below) {
            k += count;
            least = least.min(2.0 * below[k + 1].min(1.0 - below[k]));
        }
        least
    }
}

/// P(Binomial(n, p) < k) for k = 0 ..= n + 1.
fn fewer(n: usize, p: f64) -> Vec<f64> {
    let (mut ln_mass, mut sum) = (n as f64 * (-p).ln_1p(), 0.0);
    let mut out = vec![0.0];
    for k in 0..=n {
        sum += ln_mass.exp();
        out.push(sum);
        ln_mass += ((n - k) as f64 / (k + 1) as f64 * p / (1.0 - p)).ln();
    }
    out
}

fn chi_square(ranks: &[usize], largest: usize) -> f64 {
    let mut counts = [0.0; BINS];
    for rank in ranks {
        counts[rank * BINS / (largest + 1)] += 1.0;
    }
    let expected = ranks.len() as f64 / BINS as f64;
    counts.iter().map(|count| (count - expected).powi(2) / expected).sum()
}
