//! Rank normalisation and R̂.

use super::special::normal_quantile;
use super::{Split, is_valid, mean_and_sd, split};

/// Rank-normalised split R̂: the larger of two, that of the draws and that of the folded draws.
/// Converged chains have less than 1.01. NaN for a single chain or for chains that never move.
pub fn r_hat(chains: &[&[f64]]) -> f64 {
    if chains.len() < 2 || !is_valid(chains) {
        return f64::NAN;
    }
    let split = split(chains);
    let mut sorted = split.values.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    let median = super::quantile(&sorted, 0.5);
    let distances = split.values.iter().map(|x| (x - median).abs()).collect();
    let folded = Split { values: distances, half: split.half };
    let bulk = potential_scale_reduction(&normal_scores(split));
    let tail = potential_scale_reduction(&normal_scores(folded));
    // A quantity of two values folds to a constant, whose NaN says nothing.
    if bulk.is_nan() { f64::NAN } else { bulk.max(tail) }
}

/// Replaces every draw by Φ⁻¹((rank − 3/8)/(n + 1/4)), ties by their mean rank.
pub(super) fn normal_scores(mut split: Split) -> Split {
    let values = &mut split.values;
    let n = values.len();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_unstable_by(|&i, &j| values[i].total_cmp(&values[j]));
    let mut scores = vec![0.0; n];
    let mut from = 0;
    for tied in order.chunk_by(|&i, &j| values[i] >= values[j]) {
        // Ranks from + 1 ..= from + len have the mean from + (len + 1)/2.
        let rank = from as f64 + 0.5 * (tied.len() + 1) as f64;
        let score = normal_quantile((rank - 0.375) / (n as f64 + 0.25));
        for &i in tied {
            scores[i] = score;
        }
        from += tied.len();
    }
    *values = scores;
    split
}

/// √((B/W + n − 1)/n) of Gelman & Rubin.
fn potential_scale_reduction(split: &Split) -> f64 {
    let moments = split.values.chunks_exact(split.half).map(|half| mean_and_sd(&[half]));
    let (means, sds): (Vec<f64>, Vec<f64>) = moments.unzip();
    let n = split.half as f64;
    let between = n * mean_and_sd(&[&means]).1.powi(2);
    let within = sds.iter().map(|sd| sd * sd).sum::<f64>() / sds.len() as f64;
    ((between / within + n - 1.0) / n).sqrt()
}
