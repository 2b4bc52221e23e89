//! Leave-one-out predictive accuracy from one set of draws, by Pareto-smoothed importance sampling.
//!
//! Knows pointwise log likelihoods; nothing of models or measurements.
//!
//! # Source
//! Vehtari, Gelman & Gabry 2017, "Practical Bayesian model evaluation using leave-one-out
//! cross-validation and WAIC"; the threshold on k from Vehtari, Simpson, Gelman, Yao & Gabry 2024,
//! "Pareto smoothed importance sampling".  Conventions as in `ArviZ` 1.3.

use super::mean_and_sd;
use super::psis::{Smoothed, log_sum_exp, smooth};

/// Leave-one-out predictive accuracy of a model on its own measurements.
#[derive(Clone, Debug)]
pub struct Loo {
    /// Expected log pointwise predictive density: the sum over measurements.
    pub elpd: f64,
    /// Its standard error; NaN for fewer than two measurements.
    pub se: f64,
    /// Effective number of parameters: how much better the measurements are fitted than predicted.
    pub p_loo: f64,
    /// Largest Pareto k at which a measurement's elpd can be relied on, for this number of draws.
    pub k_threshold: f64,
    /// Each measurement's share.
    pub pointwise: Vec<LooPoint>,
}

/// One measurement's share of a [`Loo`].
#[derive(Clone, Copy, Debug)]
pub struct LooPoint {
    /// Log predictive density of this measurement given the others.
    pub elpd: f64,
    /// Shape of the tail of its importance weights; infinite where it cannot be estimated.
    pub pareto_k: f64,
}

impl LooPoint {
    /// From its log density at points (S) that `log_weight` makes those of the posterior without it; beside it the smoothed
    /// weights (S, their sum is 1). `None` if one of these is not finite.
    pub fn weighted(log_density: &[f64], log_weight: &[f64]) -> Option<(Self, Vec<f64>)> {
        let smoothed = smooth(log_weight, 1.0);
        let point = told_by(&smoothed, log_density);
        let weights: Vec<f64> = smoothed.log_weights.into_iter().map(f64::exp).collect();
        weights.iter().all(|w| w.is_finite()).then_some((point, weights))
    }

    /// From the log likelihood of one measurement in each draw (S), of all chains. Its log density given all
    /// measurements, itself among them, comes beside it.
    ///
    /// `r_eff` is the mean number of independent draws that a draw is worth ([`relative_efficiency`]).
    /// A measurement with a log likelihood that is not finite has elpd NaN and k = ∞.
    pub fn of(log_likelihood: &[f64], r_eff: f64) -> (Self, f64) {
        let lpd = log_sum_exp(log_likelihood) - (log_likelihood.len() as f64).ln();
        (leave_out(log_likelihood, r_eff), lpd)
    }
}

impl Loo {
    /// PSIS-LOO of measurements, each with its log density given all of them, from `n_draws` draws in all.
    pub fn of(points: &[(LooPoint, f64)], n_draws: usize) -> Self {
        let (pointwise, lpd): (Vec<LooPoint>, Vec<f64>) = points.iter().copied().unzip();
        let elpd_of: Vec<f64> = pointwise.iter().map(|point| point.elpd).collect();
        let elpd = elpd_of.iter().sum::<f64>();
        Self {
            elpd,
            se: standard_error(&elpd_of),
            p_loo: lpd.iter().sum::<f64>() - elpd,
            k_threshold: k_threshold(n_draws),
            pointwise,
        }
    }
}

/// Weights (S, their sum is 1) that make draws of the posterior represent the posterior without one
/// measurement. They come from the log likelihood of the measurement in each draw. `None` if one of
/// these is not finite.
///
/// They can be relied on where the measurement's Pareto k is at most [`Loo::k_threshold`].
pub fn loo_weights(log_likelihood: &[f64], r_eff: f64) -> Option<Vec<f64>> {
    let ratios: Vec<f64> = log_likelihood.iter().map(|l| -l).collect();
    let weights: Vec<f64> = smooth(&ratios, r_eff).log_weights.into_iter().map(f64::exp).collect();
    weights.iter().all(|w| w.is_finite()).then_some(weights)
}

/// Log predictive density of a measurement given the others, from its log likelihoods in draws of the posterior `with` it and of the
/// one `without` it. There may be any number of each, but at least one.
///
/// The mean likelihood over draws without it is too small where few of them come near the measurement, and weights of draws with it
/// make it too large. Both errors are small in the Z for which these sums are equal (L is the likelihood at a draw):
///
/// ```text
/// Σ 1/(1 + n₁Z/n₀L) over the n₁ draws without = Σ 1/(1 + n₀L/n₁Z) over the n₀ draws with
/// ```
///
/// # Source
/// Bennett 1976, "Efficient estimation of free energy differences from Monte Carlo data"; Meng & Wong 1996.
pub fn bridged(with: &[f64], without: &[f64]) -> f64 {
    /// ln Z is sought from so many nats below the least to as many above the largest log likelihood.
    const BEYOND: f64 = 50.0;
    const HALVINGS: usize = 60;
    if without.iter().all(|l| *l == f64::NEG_INFINITY) {
        return f64::NEG_INFINITY;
    }
    let shift = (without.len() as f64 / with.len() as f64).ln();
    let taken = |of: &[f64], sign: f64, ln_z: f64| {
        of.iter().map(|l| 1.0 / (1.0 + (sign * (ln_z + shift - l)).exp())).sum::<f64>()
    };
    let all = || with.iter().chain(without).copied().filter(|l| l.is_finite());
    let (mut low, mut high) =
        (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
    (low, high) = (low - BEYOND, high + BEYOND);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if taken(without, 1.0, middle) > taken(with, -1.0, middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Standard error of a sum of pointwise values, `√(n var)`; NaN for fewer than two.
pub fn standard_error(pointwise: &[f64]) -> f64 {
    let (_, sd) = mean_and_sd(&[pointwise]);
    (pointwise.len() as f64).sqrt() * sd
}

/// The mean number of independent draws that one draw is worth: the effective sample size for the
/// mean, per draw, averaged over the quantities as `ArviZ` does it. It is 1 for a single chain.
///
/// A quantity that never varies has the effective sample size NaN, and counts as drawn
/// independently.
pub fn relative_efficiency(ess_mean: &[f64], n_chains: usize, n_draws: usize) -> f64 {
    if n_chains < 2 || ess_mean.is_empty() {
        return 1.0;
    }
    let total = (n_chains * n_draws) as f64;
    let each = ess_mean.iter().map(|ess| if ess.is_finite() { ess / total } else { 1.0 });
    each.sum::<f64>() / ess_mean.len() as f64
}

/// `min(1 − 1/log₁₀ S, 0.7)`: the largest Pareto k at which S draws can be relied on.
pub fn k_threshold(n_draws: usize) -> f64 {
    if n_draws > 1 { (1.0 - 1.0 / (n_draws as f64).log10()).min(0.7) } else { 0.7 }
}

/// One measurement's predictive density without it, from its log likelihoods with it.
fn leave_out(log_likelihood: &[f64], r_eff: f64) -> LooPoint {
    let ratios: Vec<f64> = log_likelihood.iter().map(|l| -l).collect();
    told_by(&smooth(&ratios, r_eff), log_likelihood)
}

fn told_by(smoothed: &Smoothed, log_density: &[f64]) -> LooPoint {
    let weighted: Vec<f64> =
        smoothed.log_weights.iter().zip(log_density).map(|(w, l)| w + l).collect();
    LooPoint { elpd: log_sum_exp(&weighted), pareto_k: smoothed.pareto_k }
}

#[cfg(test)]
#[path = "loo_tests.rs"]
mod tests;
