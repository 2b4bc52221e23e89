//! How well draws from an approximation q represent the density p that it approximates.
//!
//! # Source
//! Yao, Vehtari, Simpson & Gelman 2018, "Yes, but did it work?: evaluating variational inference"; Vehtari,
//! Simpson, Gelman, Yao & Gabry 2024, "Pareto smoothed importance sampling".

use super::loo::k_threshold;
use super::psis::{Smoothed, smooth};

/// What the importance ratios p/q of draws from q say.
#[derive(Clone, Debug)]
pub struct Importance {
    /// Shape of the ratios' tail; infinite where none can be fitted.
    pub pareto_k: f64,
    /// Largest shape at which this number of draws can be relied on.
    pub k_threshold: f64,
    /// Number of independent draws from p that the weighted draws are worth: `1 / Σ w²`.
    pub ess: f64,
    /// Log of the mean ratio. If q integrates to 1, this is the log of the integral of p.
    pub ln_mean: f64,
    /// Its Monte Carlo standard error.
    pub ln_mean_se: f64,
    /// Smoothed weights (S), summing to 1; 0 where p is.
    pub weights: Vec<f64>,
}

/// Largest less smallest of finite numbers.
fn spread(x: &[f64]) -> f64 {
    let ends = x
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (x.min(low), x.max(high)));
    ends.1 - ends.0
}

/// The figures of `log_ratios` (S): ln p − ln q of independent draws from q, −∞ where p is 0.
pub fn importance(log_ratios: &[f64]) -> Importance {
    let n = log_ratios.len() as f64;
    let supported = |ratio: &f64| *ratio != f64::NEG_INFINITY;
    let inside: Vec<f64> = log_ratios.iter().copied().filter(supported).collect();
    let Smoothed { log_weights, log_sum, pareto_k } = smooth(&inside, 1.0);
    let mut of_inside = log_weights.iter().map(|w| w.exp());
    let weight = |ratio| if supported(ratio) { of_inside.next().unwrap_or(0.0) } else { 0.0 };
    let weights: Vec<f64> = log_ratios.iter().map(weight).collect();
    let ess = weights.iter().map(|w| w * w).sum::<f64>().recip();
    let pareto_k = match () {
        () if inside.is_empty() => f64::INFINITY,
        // equal but for rounding: q is p, and there is no tail to judge
        () if spread(&inside) < 1e-9 => 0.0,
        () => pareto_k,
    };
    Importance {
        pareto_k,
        k_threshold: k_threshold(log_ratios.len()),
        ess,
        ln_mean: log_sum - n.ln(),
        ln_mean_se: (ess.recip() - n.recip()).max(0.0).sqrt(),
        weights,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    const N: usize = 20_000;

    /// ln p − ln q with q = N(0, 1) and p = 3 N(0, sd), cut off below −2 if so asked.
    fn of_normal(sd: f64, is_cut: bool) -> Importance {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut ratio = || {
            let x: f64 = rng.sample(StandardNormal);
            let inside = 3f64.ln() - sd.ln() + 0.5 * x * x * (1.0 - sd.powi(-2));
            if is_cut && x < -2.0 { f64::NEG_INFINITY } else { inside }
        };
        importance(&(0..N).map(|_| ratio()).collect::<Vec<_>>())
    }

    #[test]
    fn the_tail_of_normal_ratios_has_the_shape_of_theory() {
        // Ratios are e^(c x²) with c = (1 − 1/sd²)/2. The tail is fitted beyond |x| = 2.3 (the largest 424 of
        // 20,000), where P(|x| > a) falls as exp(−a²/2)/a: so ln P falls by (1 + 1/a²)/(2c) per unit of ln ratio.
        for sd in [1.2f64, 3.0] {
            let exact = (1.0 - sd.powi(-2)) / (1.0 + 2.3f64.powi(-2));
            let error = (of_normal(sd, false).pareto_k - exact) * 424f64.sqrt() / (1.0 + exact);
            assert!(error.abs() < 3.0, "sd {sd}: {error} standard errors from {exact}");
        }
        assert!(of_normal(0.5, false).pareto_k < 0.0, "a bounded ratio");
    }

    #[test]
    fn the_mean_ratio_is_the_integral_and_nothing_lies_outside_the_support() {
        for (is_cut, integral) in [(false, 3.0), (true, 3.0 * 0.95221)] {
            // Φ(2/1.2) = 0.95221
            let found = of_normal(1.2, is_cut);
            let error = (found.ln_mean - f64::ln(integral)) / found.ln_mean_se;
            assert!(error.abs() < 4.0, "{error} standard errors");
            assert!((found.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert_eq!(found.weights.iter().any(|w| *w <= 0.0), is_cut);
        }
        // E (p/q)² = 1 / (sd √(2 − sd²)) for the normalised p: what a draw is worth.
        let worth = of_normal(1.2, false).ess / N as f64;
        let exact = 1.2 * (2.0 - 1.44f64).sqrt();
        assert!((worth - exact).abs() < 0.03, "{worth} {exact}");
    }

    #[test]
    fn equal_ratios_are_perfect_and_no_support_is_none() {
        let perfect = importance(&[-7.0; 100]);
        assert!(perfect.pareto_k.abs() < 1e-12 && (perfect.ess - 100.0).abs() < 1e-6);
        assert!((perfect.ln_mean + 7.0).abs() < 1e-12 && perfect.ln_mean_se < 1e-6);
        assert!(importance(&[f64::NEG_INFINITY; 100]).pareto_k.is_infinite());
        assert!(importance(&[f64::NAN, 0.0, 1.0]).pareto_k.is_infinite());
    }
}
