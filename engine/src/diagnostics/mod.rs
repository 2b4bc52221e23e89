//! Convergence diagnostics and posterior summaries of draws from several chains.
//!
//! Knows nothing of samplers, fields or models: only arrays of draws, one slice per chain, all of
//! one length.  Every function returns NaN where its figure is undefined: a NaN among the draws,
//! fewer than four draws, chains of different lengths.
//!
//! # Source
//! Vehtari, Gelman, Simpson, Carpenter & Bürkner 2021, "Rank-normalization, folding, and
//! localization: an improved R̂"; conventions as in `ArviZ` 1.3, against which the tests compare.

mod ess;
mod importance;
mod loo;
mod mcse;
mod psis;
mod rank;
pub mod regimes;
mod special;
mod stray;
pub mod verdict;

pub use crate::num::Moments;
pub use ess::{ess_bulk, ess_mean, ess_tail};
pub use importance::{Importance, importance};
pub use loo::{
    Loo, LooPoint, bridged, k_threshold, loo_weights, relative_efficiency, standard_error,
};
pub use mcse::{mcse_mean, mcse_quantile, mcse_sd};
pub use rank::r_hat;
pub use special::{beta_above, normal_quantile};
pub use stray::{Stray, stray};

use serde::Serialize;

/// Summary of one scalar quantity over all chains.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Posterior mean.
    pub mean: f64,
    /// Posterior standard deviation.
    pub sd: f64,
    /// Monte Carlo standard error of the mean.
    pub mcse: f64,
    /// 5 % quantile.
    pub q5: f64,
    /// Median.
    pub q50: f64,
    /// 95 % quantile.
    pub q95: f64,
    /// Bulk effective sample size.
    pub ess_bulk: f64,
    /// Tail effective sample size.
    pub ess_tail: f64,
    /// Rank-normalised split R̂.
    pub r_hat: f64,
    /// Monte Carlo standard error of the standard deviation.
    pub mcse_sd: f64,
    /// Monte Carlo standard error of the 5 % quantile.
    pub mcse_q5: f64,
    /// Monte Carlo standard error of the median.
    pub mcse_q50: f64,
    /// Monte Carlo standard error of the 95 % quantile.
    pub mcse_q95: f64,
}

/// Summary of one quantity, one slice of draws per chain.
///
/// A quantity that never varies has NaN for R̂, errors and both effective sizes (differs from `ArviZ`, which
/// reports as many effective draws as there are draws).
pub fn summarise(chains: &[&[f64]]) -> Summary {
    let (mean, sd) = mean_and_sd(chains);
    let (constant, [q5, q50, q95]) = match sorted(chains) {
        Some(sorted) => {
            let constant = is_constant(&sorted);
            (constant, [0.05, 0.5, 0.95].map(|probability| quantile(&sorted, probability)))
        }
        None => (true, [f64::NAN; 3]),
    };
    let varying = |figure: fn(&[&[f64]]) -> f64| if constant { f64::NAN } else { figure(chains) };
    Summary {
        mean,
        sd,
        mcse: varying(mcse_mean),
        q5,
        q50,
        q95,
        ess_bulk: varying(ess_bulk),
        ess_tail: varying(ess_tail),
        r_hat: varying(r_hat),
        mcse_sd: varying(mcse_sd),
        mcse_q5: varying(|chains| mcse_quantile(chains, 0.05)),
        mcse_q50: varying(|chains| mcse_quantile(chains, 0.5)),
        mcse_q95: varying(|chains| mcse_quantile(chains, 0.95)),
    }
}

/// Mean and standard deviation (n − 1) over all chains.
pub fn mean_and_sd(chains: &[&[f64]]) -> (f64, f64) {
    let n = chains.iter().map(|chain| chain.len()).sum::<usize>() as f64;
    let all = || chains.iter().copied().flatten();
    let mean = all().sum::<f64>() / n;
    let squares: f64 = all().map(|x| (x - mean).powi(2)).sum();
    (mean, (squares / (n - 1.0)).sqrt())
}

/// Energy Bayesian fraction of missing information of one chain's energies; below 0.3 the chain
/// explores the energy levels, and so the tails, too slowly.
///
/// ```text
/// mean (Eᵢ − Eᵢ₋₁)² / var E
/// ```
/// # Source
/// Betancourt 2016, "Diagnosing suboptimal cotangent disintegrations in Hamiltonian Monte Carlo".
pub fn e_bfmi(energy: &[f64]) -> f64 {
    let (_, sd) = mean_and_sd(&[energy]);
    let squares: f64 = energy.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
    squares / (energy.len() as f64 - 1.0) / (sd * sd)
}

/// Quantile of sorted values, linear between order statistics (`NumPy`'s default, type 7).
///
/// NaN for no values or a probability outside [0, 1].
pub fn quantile(sorted: &[f64], probability: f64) -> f64 {
    if sorted.is_empty() || !(0.0..=1.0).contains(&probability) {
        return f64::NAN;
    }
    let place = probability * (sorted.len() - 1) as f64;
    let (low, fraction) = (place as usize, place.fract());
    let next = sorted[(low + 1).min(sorted.len() - 1)];
    sorted[low] + fraction * (next - sorted[low])
}

/// Quantiles of values in any order, as [`quantile`] has them, at ascending probabilities; the values change their order.
/// It takes a fraction of the time of sorting.
pub fn quantiles<const N: usize>(values: &mut [f64], ascending: [f64; N]) -> [f64; N] {
    let mut first = 0;
    ascending.map(|probability| {
        if values.is_empty() || !(0.0..=1.0).contains(&probability) {
            return f64::NAN;
        }
        let place = probability * (values.len() - 1) as f64;
        let (low, fraction) = (place as usize, place.fract());
        // all before `first` are no greater than those from there on
        let (_, own, above) = values[first..].select_nth_unstable_by(low - first, f64::total_cmp);
        let next = above.iter().copied().min_by(f64::total_cmp).unwrap_or(*own);
        first = low;
        *own + fraction * (next - *own)
    })
}

/// Quantile of values in ascending order with weights: the first below which, itself included, lies at
/// least this share of all weight.
///
/// NaN for no values or a probability outside [0, 1].
pub fn weighted_quantile(sorted: &[(f64, f64)], probability: f64) -> f64 {
    if !(0.0..=1.0).contains(&probability) {
        return f64::NAN;
    }
    let total: f64 = sorted.iter().map(|(_, weight)| weight).sum();
    let mut below = 0.0;
    let found = sorted.iter().find(|(_, weight)| {
        below += weight;
        below >= probability * total
    });
    found.or(sorted.last()).map_or(f64::NAN, |(value, _)| *value)
}

/// Whether the figures are defined: at least four draws per chain, one length, all finite.
fn is_valid(chains: &[&[f64]]) -> bool {
    let n = chains.first().map_or(0, |chain| chain.len());
    n >= 4 && chains.iter().all(|chain| chain.len() == n && chain.iter().all(|x| x.is_finite()))
}

/// All draws in ascending order; `None` if they are not valid.
fn sorted(chains: &[&[f64]]) -> Option<Vec<f64>> {
    is_valid(chains).then(|| {
        let mut all = chains.concat();
        all.sort_unstable_by(f64::total_cmp);
        all
    })
}

/// Whether sorted values differ by less than a double resolves at 1, `ArviZ`'s criterion.
fn is_constant(sorted: &[f64]) -> bool {
    sorted.first().zip(sorted.last()).is_none_or(|(low, high)| high - low < 1e-15)
}

/// First and last half of every chain (the middle draw of an odd number is left out), end to end.
fn split(chains: &[&[f64]]) -> Split {
    let half = chains.first().map_or(0, |chain| chain.len() / 2);
    let ends = |of: fn(&[f64], usize) -> &[f64]| chains.iter().flat_map(move |c| of(c, half));
    let first = ends(|chain, half| &chain[..half]);
    let last = ends(|chain, half| &chain[chain.len() - half..]);
    Split { values: first.chain(last).copied().collect(), half }
}

/// Half-chains of equal length, end to end.
#[derive(Clone, Debug)]
struct Split {
    values: Vec<f64>,
    half: usize,
}

#[cfg(test)]
#[path = "arviz_tests.rs"]
mod tests;
