//! Running moments of draws and gradients, and the metrics made from them.

use super::density::LogDensity;
use super::directions;
use super::hamiltonian::Metric;
use super::settings::MetricKind;
use crate::num::Moments;
use serde::{Deserialize, Serialize};

/// Running means and second moments of positions and gradients.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct DrawMoments {
    n: usize,
    position: Moments,
    gradient: Moments,
    /// All positions and gradients, each row-major `(n, dim)`, if directions are wanted.
    all: Option<[Vec<f64>; 2]>,
}

impl DrawMoments {
    pub(super) fn new(dim: usize, kind: MetricKind) -> Self {
        let all = (kind == MetricKind::LowRank).then(Default::default);
        Self { n: 0, position: Moments::new(dim), gradient: Moments::new(dim), all }
    }

    /// The moments of these draws, each `(dim)`. Draws that `density` does not support are left
    /// out.
    pub(super) fn of(density: &dyn LogDensity, draws: &[Vec<f64>], kind: MetricKind) -> Self {
        let mut moments = Self::new(density.dim(), kind);
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

    /// Whether these are moments of `dim` coordinates, with what such a metric is made from.
    pub(super) fn fits(&self, dim: usize, kind: MetricKind) -> bool {
        let is_whole = |all: &Vec<f64>| Some(all.len()) == self.n.checked_mul(dim);
        self.position.has(dim)
            && self.gradient.has(dim)
            && self.all.is_some() == (kind == MetricKind::LowRank)
            && self.all.iter().flatten().all(is_whole)
    }

    pub(super) fn n(&self) -> usize {
        self.n
    }

    pub(super) fn clear(&mut self) {
        self.n = 0;
        self.position.clear();
        self.gradient.clear();
        self.all.iter_mut().flatten().for_each(Vec::clear);
    }

    pub(super) fn add(&mut self, position: &[f64], gradient: &[f64]) {
        self.n += 1;
        if let Some([positions, gradients]) = &mut self.all {
            positions.extend_from_slice(position);
            gradients.extend_from_slice(gradient);
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

    /// Writes the metric that suits these draws: scales, and directions where all draws were kept.
    pub(super) fn fit(&self, metric: &mut Metric) {
        self.fisher_scales(&mut metric.scale);
        if let Some([positions, gradients]) = &self.all {
            directions::fit(positions, gradients, metric);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fisher_scales_of_normal_draws_are_exact_whatever_the_draws() {
        // For a normal the gradient is −q/sd², so any set of draws gives sd exactly.
        let sd = [1e-3, 1.0, 250.0];
        let mut moments = DrawMoments::new(3, MetricKind::Diagonal);
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
        let mut moments = DrawMoments::new(1, MetricKind::Diagonal);
        (0..4).for_each(|_| moments.add(&[2.0], &[1.0]));
        let mut scale = vec![9.0];
        moments.fisher_scales(&mut scale);
        assert_eq!(scale, [9.0]);
    }
}
