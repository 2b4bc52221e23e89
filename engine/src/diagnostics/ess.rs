//! Effective sample sizes by Geyer's initial monotone sequence over all chains.

use super::rank::normal_scores;
use super::{Split, is_constant, mean_and_sd, quantile, sorted, split};

/// Effective sample size for the centre of the distribution: of the rank-normalised draws.
pub fn ess_bulk(chains: &[&[f64]]) -> f64 {
    if !super::is_valid(chains) {
        return f64::NAN;
    }
    effective_size(&normal_scores(split(chains)))
}

/// Effective sample size for the tails: the smaller of those of the 5 % and the 95 % quantile.
pub fn ess_tail(chains: &[&[f64]]) -> f64 {
    let Some(sorted) = sorted(chains) else { return f64::NAN };
    let at = |probability| ess_quantile(chains, quantile(&sorted, probability));
    let (low, high) = (at(0.05), at(0.95));
    if low.is_nan() || high.is_nan() { f64::NAN } else { low.min(high) }
}

/// Effective sample size for the mean: of the draws as they are.
pub fn ess_mean(chains: &[&[f64]]) -> f64 {
    if !super::is_valid(chains) {
        return f64::NAN;
    }
    effective_size(&split(chains))
}

/// Effective sample size of the indicator "draw ≤ `threshold`", for valid chains.
pub(super) fn ess_quantile(chains: &[&[f64]], threshold: f64) -> f64 {
    let mut indicator = split(chains);
    indicator.values.iter_mut().for_each(|x| *x = f64::from(u8::from(*x <= threshold)));
    effective_size(&indicator)
}

/// m n / τ̂ of half-chains, with autocovariances combined over chains as for R̂.
fn effective_size(split: &Split) -> f64 {
    let mut ordered = split.values.clone();
    ordered.sort_unstable_by(f64::total_cmp);
    let total = split.values.len() as f64;
    if is_constant(&ordered) {
        return total;
    }
    let rho = Autocorrelation::new(split);
    let tau = integrated_time(&rho, split.half).max(1.0 / total.log10());
    total / tau
}

/// ρ̂ at any lag, of the draws of all chains together.
struct Autocorrelation {
    /// Deviations of each half-chain from its own mean, end to end.
    centred: Vec<f64>,
    half: usize,
    /// Mean variance within half-chains, n/(n − 1) corrected.
    within: f64,
    /// Variance over all, with that between half-chains.
    overall: f64,
}

impl Autocorrelation {
    fn new(split: &Split) -> Self {
        let half = split.half;
        let n = half as f64;
        let means: Vec<f64> =
            split.values.chunks_exact(half).map(|chain| chain.iter().sum::<f64>() / n).collect();
        let chains = split.values.chunks_exact(half).zip(&means);
        let centred = chains.flat_map(|(chain, mean)| chain.iter().map(move |x| x - mean));
        let mut rho = Self { centred: centred.collect(), half, within: 0.0, overall: 1.0 };
        let variance = rho.autocovariance(0);
        rho.within = variance * n / (n - 1.0);
        rho.overall = variance + mean_and_sd(&[&means]).1.powi(2);
        rho
    }

    fn autocovariance(&self, lag: usize) -> f64 {
        let of = |chain: &[f64]| sum_of_products(&chain[lag..], &chain[..chain.len() - lag]);
        self.centred.chunks_exact(self.half).map(of).sum::<f64>() / self.centred.len() as f64
    }

    fn at(&self, lag: usize) -> f64 {
        1.0 - (self.within - self.autocovariance(lag)) / self.overall
    }
}

/// τ̂ = −1 + 2 Σ ρ̂ over Geyer's initial monotone sequence, cut as `ArviZ` cuts it.
fn integrated_time(rho: &Autocorrelation, n: usize) -> f64 {
    // pairs[k] = (ρ̂ at 2k, ρ̂ at 2k + 1)
    let mut pairs = vec![(1.0, rho.at(1))];
    let mut last = pairs[0];
    let mut t = 1;
    while t + 3 < n && last.0 + last.1 > 0.0 {
        last = (rho.at(t + 1), rho.at(t + 2));
        pairs.push(last);
        t += 2;
    }
    // The last pair is dropped, but for a positive even member, which counts once.
    pairs.pop();
    let even = last.0.max(0.0);
    for k in 1..pairs.len() {
        let before = pairs[k - 1].0 + pairs[k - 1].1;
        if pairs[k].0 + pairs[k].1 > before {
            pairs[k] = (0.5 * before, 0.5 * before);
        }
    }
    2.0 * pairs.iter().map(|pair| pair.0 + pair.1).sum::<f64>() - 1.0 + even
}

/// Σ aᵢ bᵢ in eight interleaved partial sums, so that it vectorises.
fn sum_of_products(a: &[f64], b: &[f64]) -> f64 {
    let (a, a_rest) = a.as_chunks::<8>();
    let (b, b_rest) = b.as_chunks::<8>();
    let mut partial = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..8 {
            partial[lane] += a[lane] * b[lane];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    partial.iter().sum::<f64>() + rest
}
