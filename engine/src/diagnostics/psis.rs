//! Pareto-smoothed importance sampling. A generalised Pareto distribution is fitted to the largest
//! weights, and its expected order statistics take their place.
//!
//! Knows only log ratios; nothing of what the weights are for.
//!
//! # Source
//! Vehtari, Simpson, Gelman, Yao & Gabry 2024, "Pareto smoothed importance sampling"; the fit by
//! Zhang & Stephens 2009, "A new and efficient estimation method for the generalized Pareto
//! distribution", with the prior on k of the former.  Conventions as in `ArviZ` 1.3.

/// Fewest draws that a tail can be fitted to.
const SHORTEST_TAIL: usize = 5;

/// Normalised weights and how heavy their tail is.
#[derive(Clone, Debug)]
pub(super) struct Smoothed {
    /// Log weights (S), their exponentials summing to 1.
    pub(super) log_weights: Vec<f64>,
    /// Log of the sum of the smoothed ratios.
    pub(super) log_sum: f64,
    /// Shape of the weights' tail; infinite where none can be fitted.
    pub(super) pareto_k: f64,
}

/// Smooths the importance ratios of S draws, each worth `r_eff` independent ones.
///
/// - Ratios that are all equal have k = 0.
/// - A tail that cannot be fitted keeps its weights and has k = ∞, so that nobody relies on it.
///   This is a tail of fewer than five draws, or one whose smallest quarter is tied. It differs
///   from `ArviZ`, which raises an error or returns NaN.
/// - A ratio that is not finite makes every weight NaN.
pub(super) fn smooth(log_ratios: &[f64], r_eff: f64) -> Smoothed {
    let n = log_ratios.len();
    let largest = log_ratios.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut log_weights: Vec<f64> = log_ratios.iter().map(|ratio| ratio - largest).collect();
    if !log_weights.iter().all(|w| w.is_finite()) {
        return Smoothed {
            log_weights: vec![f64::NAN; n],
            log_sum: f64::NAN,
            pareto_k: f64::INFINITY,
        };
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| log_weights[*a].total_cmp(&log_weights[*b]));
    let begin = n - tail_length(n, r_eff).min(n);
    let is_constant = order.first().is_none_or(|least| log_weights[*least] >= 0.0);
    let pareto_k = match (is_constant, begin) {
        (true, _) => 0.0,
        (_, 0) => f64::INFINITY,
        _ => smooth_tail(&mut log_weights, &order[begin..], order[begin - 1]),
    };
    let norm = log_sum_exp(&log_weights);
    for weight in &mut log_weights {
        *weight -= norm;
    }
    Smoothed { log_weights, log_sum: largest + norm, pareto_k }
}

/// `ln Σ exp`. If no value is finite, the result is NaN, so that it cannot be taken for a figure.
/// [`crate::num::ln_sum_exp`], which priors and likelihoods use, is −∞ there.
pub(super) fn log_sum_exp(values: &[f64]) -> f64 {
    let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    largest + values.iter().map(|x| (x - largest).exp()).sum::<f64>().ln()
}

/// `min(0.2 S, 3 √(S / r_eff))`, rounded down.
fn tail_length(n: usize, r_eff: f64) -> usize {
    let n = n as f64;
    (0.2 * n).min(3.0 * (n / r_eff).sqrt()) as usize
}

/// Replaces the weights at `tail` (ascending) by quantiles of the fit above the weight at `below`;
/// returns its k.
fn smooth_tail(log_weights: &mut [f64], tail: &[usize], below: usize) -> f64 {
    if tail.len() < SHORTEST_TAIL {
        return f64::INFINITY;
    }
    let cutoff = log_weights[below].exp();
    let excess: Vec<f64> = tail.iter().map(|i| log_weights[*i].exp() - cutoff).collect();
    let Some(fit) = GeneralisedPareto::fit(&excess) else { return f64::INFINITY };
    for (rank, i) in tail.iter().enumerate() {
        let probability = (rank as f64 + 0.5) / tail.len() as f64;
        // No weight above the largest one that occurred, which is 1.
        log_weights[*i] = (cutoff + fit.quantile(probability)).ln().min(0.0);
    }
    fit.k
}

/// Excesses over a threshold with density `(1 + k x / σ)^(−1/k − 1) / σ`.
#[derive(Clone, Copy, Debug)]
struct GeneralisedPareto {
    k: f64,
    sigma: f64,
}

impl GeneralisedPareto {
    /// Fits ascending excesses `x`, by the mean of the profile posterior of `b = −k/σ`. The
    /// estimate of k is drawn towards 0.5, as ten more excesses would do. `None` if the smallest
    /// quarter is tied.
    fn fit(x: &[f64]) -> Option<Self> {
        let n = x.len() as f64;
        let quartile = x[(n / 4.0 + 0.5) as usize - 1];
        if !(quartile > x[0]) {
            return None;
        }
        let k_of = |b: f64| x.iter().map(|x| (-b * x).ln_1p()).sum::<f64>() / n;
        let n_grid = 30 + n.sqrt() as usize;
        let grid: Vec<f64> = (0..n_grid)
            .map(|j| {
                let step = 1.0 - (n_grid as f64 / (j as f64 + 0.5)).sqrt();
                step / (3.0 * quartile) + 1.0 / x[x.len() - 1]
            })
            .collect();
        let profile = |b: &f64| {
            let k = k_of(*b);
            n * ((-b / k).ln() - k - 1.0)
        };
        let profile: Vec<f64> = grid.iter().map(profile).collect();
        let norm = log_sum_exp(&profile);
        let weights = profile.iter().map(|l| (l - norm).exp());
        let weighted = grid.iter().zip(weights).filter(|(_, w)| *w >= 10.0 * f64::EPSILON);
        let (sum, mass) = weighted.fold((0.0, 0.0), |(s, m), (b, w)| (s + b * w, m + w));
        let b = sum / mass;
        let k = k_of(b);
        let fit = Self { k: (n * k + 10.0 * 0.5) / (n + 10.0), sigma: -k / b };
        (fit.k.is_finite() && fit.sigma > 0.0).then_some(fit)
    }

    fn quantile(&self, probability: f64) -> f64 {
        let log = (-probability).ln_1p();
        if self.k.abs() < 1e-30 {
            -self.sigma * log
        } else {
            self.sigma * (-self.k * log).exp_m1() / self.k
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Quantiles of a generalised Pareto distribution at regular probabilities.
    fn pareto(k: f64, n: usize) -> Vec<f64> {
        let exact = GeneralisedPareto { k, sigma: 2.0 };
        (0..n).map(|i| exact.quantile((i as f64 + 0.5) / n as f64)).collect()
    }

    #[test]
    fn the_fit_finds_the_shape_of_ideal_samples() {
        for k in [-0.3, 0.0, 0.4, 0.9] {
            let fit = GeneralisedPareto::fit(&pareto(k, 2000)).unwrap();
            assert!((fit.k - k).abs() < 0.03 && (fit.sigma - 2.0).abs() < 0.1, "{k}: {fit:?}");
        }
    }

    #[test]
    fn weights_sum_to_one_and_keep_their_order() {
        let ratios: Vec<f64> = pareto(0.6, 1000).iter().map(|x| x.ln()).collect();
        let smoothed = smooth(&ratios, 0.8);
        let sum: f64 = smoothed.log_weights.iter().map(|w| w.exp()).sum();
        assert!((sum - 1.0).abs() < 1e-12);
        assert!(smoothed.log_weights.is_sorted());
        assert!((smoothed.pareto_k - 0.6).abs() < 0.1, "{}", smoothed.pareto_k);
    }

    #[test]
    fn what_cannot_be_fitted_is_never_called_reliable() {
        let equal = smooth(&[-3.0; 100], 1.0);
        assert!(equal.pareto_k.abs() < 1e-15 && (equal.log_weights[7] + 100f64.ln()).abs() < 1e-12);
        let mut tied = vec![0.0; 1000];
        tied[3] = 1.0;
        assert!(smooth(&tied, 1.0).pareto_k.is_infinite(), "tail of ties");
        let short: Vec<f64> = (0..20).map(f64::from).collect();
        assert!(smooth(&short, 1.0).pareto_k.is_infinite(), "four draws in the tail");
        tied[4] = f64::INFINITY;
        let broken = smooth(&tied, 1.0);
        assert!(broken.pareto_k.is_infinite() && broken.log_weights.iter().all(|w| w.is_nan()));
        assert!(smooth(&[], 1.0).log_weights.is_empty());
    }
}
