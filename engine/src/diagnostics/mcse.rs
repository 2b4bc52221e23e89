//! Monte Carlo standard errors.

use super::ess::ess_quantile;
use super::special::beta_quantile;
use super::{ess_mean, is_valid, mean_and_sd, quantile, sorted};

/// Monte Carlo standard error of the mean, sd/√ESS.
pub fn mcse_mean(chains: &[&[f64]]) -> f64 {
    mean_and_sd(chains).1 / ess_mean(chains).sqrt()
}

/// Monte Carlo standard error of the standard deviation, by the delta method on the variance.
pub fn mcse_sd(chains: &[&[f64]]) -> f64 {
    if !is_valid(chains) {
        return f64::NAN;
    }
    let (mean, _) = mean_and_sd(chains);
    let squares: Vec<Vec<f64>> =
        chains.iter().map(|chain| chain.iter().map(|x| (x - mean).powi(2)).collect()).collect();
    let squares: Vec<&[f64]> = squares.iter().map(Vec::as_slice).collect();
    let (variance, _) = mean_and_sd(&squares);
    let fourth: Vec<f64> = squares.concat().iter().map(|x| x * x).collect();
    let (fourth, _) = mean_and_sd(&[&fourth]);
    let of_variance = (fourth - variance * variance) / ess_mean(&squares);
    (of_variance / variance / 4.0).sqrt()
}

/// Monte Carlo standard error of a quantile. The standard error of its probability comes from a
/// beta distribution. The result is half the span between the order statistics one such error below
/// and one above.
pub fn mcse_quantile(chains: &[&[f64]], probability: f64) -> f64 {
    /// Φ(−1) and Φ(1), with the digits that `ArviZ` has.
    const ONE_SIGMA: [f64; 2] = [0.158_655_3, 0.841_344_7];
    let Some(sorted) = sorted(chains) else { return f64::NAN };
    let ess = ess_quantile(chains, quantile(&sorted, probability));
    let (a, b) = (ess * probability + 1.0, ess * (1.0 - probability) + 1.0);
    let n = sorted.len() as f64;
    let [low, high] = ONE_SIGMA.map(|p| beta_quantile(p, a, b) * n - 1.0);
    if low.is_nan() || high.is_nan() {
        return f64::NAN;
    }
    let low = sorted[low.max(0.0).floor() as usize];
    let high = sorted[high.min(n - 1.0).ceil() as usize];
    0.5 * (high - low)
}
