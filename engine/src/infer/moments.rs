//! Running moments of draws and gradients, and the metrics made from them.

use super::density::LogDensity;
use crate::num::Moments;
use faer::{Mat, Side};
use serde::{Deserialize, Serialize};

/// Running means and second moments of positions and gradients.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct DrawMoments {
    n: usize,
    position: Moments,
    gradient: Moments,
    /// Σ (q − mean)(q − mean)ᵀ, row-major, if a dense metric is wanted.
    products: Option<Vec<f64>>,
}

impl DrawMoments {
    pub(super) fn new(dim: usize, dense: bool) -> Self {
        let products = dense.then(|| vec![0.0; dim * dim]);
        Self { n: 0, position: Moments::new(dim), gradient: Moments::new(dim), products }
    }

    /// The moments of these draws, each `(dim)`. Draws that `density` does not support are left
    /// out.
    pub(super) fn of(density: &dyn LogDensity, draws: &[Vec<f64>], dense: bool) -> Self {
        let mut moments = Self::new(density.dim(), dense);
        let mut evaluator = density.evaluator();
        let mut gradient = vec![0.0; density.dim()];
        for draw in draws {
            let ln_density = evaluator.ln_density(draw, &mut gradient);
            if ln_density.is_finite() && gradient.iter().all(|g| g.is_finite()) {
                moments.add(draw, &gradient);
            }
        }
        moments
    }

    pub(super) fn n(&self) -> usize {
        self.n
    }

    pub(super) fn clear(&mut self) {
        self.n = 0;
        self.position.clear();
        self.gradient.clear();
        self.products.iter_mut().for_each(|products| products.fill(0.0));
    }

    pub(super) fn add(&mut self, position: &[f64], gradient: &[f64]) {
        self.n += 1;
        let n = self.n as f64;
        if let Some(products) = &mut self.products {
            let dim = position.len();
            // of the draws before, the first of which changes nothing
            let mean = self.position.means();
            let change: Vec<f64> = position
                .iter()
                .zip(mean)
                .map(|(q, mean)| if n > 1.0 { q - mean } else { 0.0 })
                .collect();
            for (row, a) in products.chunks_exact_mut(dim).zip(&change) {
                for (sum, b) in row.iter_mut().zip(&change) {
                    *sum += a * b * (n - 1.0) / n;
                }
            }
        }
        self.position.add(position.iter().copied());
        self.gradient.add(gradient.iter().copied());
    }

    /// Writes scale = (var q / var ∇)^¼ per coordinate: for a normal, its standard deviation.
    ///
    /// This scale minimises the Fisher divergence over diagonal metrics. A coordinate whose
    /// variances cannot be used (all draws are equal, or they overflow) keeps its scale.
    pub(super) fn fisher_scales(&self, scale: &mut [f64]) {
        let variances = self.position.squares().iter().zip(self.gradient.squares());
        for (scale, (position, gradient)) in scale.iter_mut().zip(variances) {
            let fisher = (position / gradient).sqrt().sqrt();
            if fisher.is_finite() && (1e-10..1e10).contains(&fisher) {
                *scale = fisher;
            }
        }
    }

    /// The lower factor of the sample covariance, whose correlations are shrunk by n/(n + dim).
    /// `None` if this is not positive definite, or if no dense metric is wanted.
    pub(super) fn shrunk_covariance_factor(&self) -> Option<Vec<f64>> {
        let products = self.products.as_ref()?;
        let dim = self.position.counts().len();
        let n = self.n as f64;
        let keep = n / (n + dim as f64);
        let covariance = Mat::from_fn(dim, dim, |i, j| {
            let shrink = if i == j { 1.0 } else { keep };
            shrink * products[i * dim + j] / (n - 1.0)
        });
        let factor = covariance.llt(Side::Lower).ok()?;
        let lower = factor.L();
        let entry = |k: usize| if k % dim <= k / dim { lower[(k / dim, k % dim)] } else { 0.0 };
        let entries: Vec<f64> = (0..dim * dim).map(entry).collect();
        entries.iter().all(|x| x.is_finite()).then_some(entries)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fisher_scales_of_normal_draws_are_exact_whatever_the_draws() {
        // For a normal the gradient is −q/sd², so any set of draws gives sd exactly.
        let sd = [1e-3, 1.0, 250.0];
        let mut moments = DrawMoments::new(3, false);
        for k in 0..5 {
            let q: Vec<f64> = sd.iter().map(|s| s * f64::from(k * k % 7)).collect();
            let g: Vec<f64> = q.iter().zip(&sd).map(|(q, s)| -q / (s * s)).collect();
            moments.add(&q, &g);
        }
        let mut scale = vec![9.0; 3];
        moments.fisher_scales(&mut scale);
        assert!(scale.iter().zip(&sd).all(|(a, b)| (a / b - 1.0).abs() < 1e-12), "{scale:?}");
    }

    #[test]
    fn equal_draws_leave_the_scale_alone() {
        let mut moments = DrawMoments::new(1, false);
        (0..4).for_each(|_| moments.add(&[2.0], &[1.0]));
        let mut scale = vec![9.0];
        moments.fisher_scales(&mut scale);
        assert_eq!(scale, [9.0]);
    }

    #[test]
    fn covariance_factor_matches_a_hand_computed_one() {
        let mut moments = DrawMoments::new(2, true);
        for q in [[0.0, 0.0], [2.0, 1.0], [4.0, 5.0]] {
            moments.add(&q, &[0.0, 0.0]);
        }
        // Covariance [4 5; 5 7]; off-diagonal shrunk by 3/5 to 3: L = [2 0; 1.5 sqrt(4.75)].
        let factor = moments.shrunk_covariance_factor().unwrap();
        let want = [2.0, 0.0, 1.5, 4.75f64.sqrt()];
        assert!(factor.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-12), "{factor:?}");
        moments.clear();
        assert!(moments.shrunk_covariance_factor().is_none());
    }
}
