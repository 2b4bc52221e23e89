//! Convergence diagnostics and posterior summaries of draws from several chains.
//!
//! Knows nothing of samplers, fields or models: only arrays of draws, one slice per chain.

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
}
