//! Maximises a log density by L-BFGS with a strong-Wolfe line search.
//!
//! Points without support (−∞, NaN) act as walls: the line search steps back from them.
//!
//! # Source
//! Nocedal & Wright 2006, algorithms 7.4 (two-loop recursion), 3.5 and 3.6 (line search).

use super::density::{Evaluator, LogDensity};
use super::error::InferError;
use crate::num::vector::{axpy, dot};
use std::collections::VecDeque;

/// When to stop climbing.
#[derive(Clone, Copy, Debug)]
pub struct OptimumSettings {
    /// Most L-BFGS iterations.
    pub max_iterations: usize,
    /// Converged when the largest gradient entry is below this.
    pub gradient_tolerance: f64,
    /// Stops, unconverged, once each of three successive iterations gains less than this (nats).
    pub least_gain: f64,
}

impl Default for OptimumSettings {
    fn default() -> Self {
        Self { max_iterations: 1000, gradient_tolerance: 1e-6, least_gain: 0.0 }
    }
}

/// Where the climb ended.
#[derive(Clone, Debug)]
pub struct Optimum {
    /// Unconstrained position, `(dim)`.
    pub position: Vec<f64>,
    /// Log density there.
    pub ln_density: f64,
    /// Largest absolute gradient entry there.
    pub gradient_norm: f64,
    /// Iterations used.
    pub iterations: usize,
    /// Whether the gradient tolerance was reached.
    pub converged: bool,
}

/// Climbs from `start`, `(dim)`, towards a local maximum of `density`.
///
/// # Errors
/// [`InferError::StartLength`] (chain 0) if `start` does not fit; [`InferError::NoSupport`] if the
/// density or its gradient is not finite at `start`.
pub fn maximise(
    density: &dyn LogDensity,
    start: &[f64],
    settings: &OptimumSettings,
) -> Result<Optimum, InferError> {
    let dim = density.dim();
    if start.len() != dim {
        return Err(InferError::StartLength { chain: 0, expected: dim, got: start.len() });
    }
    let mut evaluator = density.evaluator();
    let mut point = Point::at(&mut *evaluator, start.to_vec());
    if !point.is_finite() {
        let (ln_density, position) = (point.ln_density, point.position);
        return Err(InferError::NoSupport { ln_density, position });
    }
    let mut memory = Memory::default();
    let mut iterations = 0;
    let mut idle = 0;
    while iterations < settings.max_iterations
        && point.gradient_norm() > settings.gradient_tolerance
        && idle < 3
    {
        let mut direction = memory.ascent_direction(&point.gradient);
        if dot::<4>(&direction, &point.gradient) <= 0.0 {
            memory = Memory::default();
            direction = memory.ascent_direction(&point.gradient);
        }
        let Some(next) = LineSearch {
            evaluator: &mut *evaluator,
            from: &point,
            direction,
            least_gain: settings.least_gain,
        }
        .run() else {
            if memory.pairs.is_empty() {
                break;
            }
            memory = Memory::default();
            continue;
        };
        iterations += 1;
        idle = if next.ln_density - point.ln_density < settings.least_gain { idle + 1 } else { 0 };
        memory.push(&point, &next);
        point = next;
    }
    let gradient_norm = point.gradient_norm();
    Ok(Optimum {
        position: point.position,
        ln_density: point.ln_density,
        gradient_norm,
        iterations,
        converged: gradient_norm <= settings.gradient_tolerance,
    })
}

#[derive(Clone, Debug)]
struct Point {
    position: Vec<f64>,
    gradient: Vec<f64>,
    ln_density: f64,
}

impl Point {
    fn at(evaluator: &mut dyn Evaluator, position: Vec<f64>) -> Self {
        let mut gradient = vec![0.0; position.len()];
        let ln_density = evaluator.ln_density(&position, &mut gradient);
        Self { position, gradient, ln_density }
    }

    fn is_finite(&self) -> bool {
        self.ln_density.is_finite() && self.gradient.iter().all(|g| g.is_finite())
    }

    fn gradient_norm(&self) -> f64 {
        self.gradient.iter().fold(0.0, |norm, g| g.abs().max(norm))
    }
}

/// The last few steps and gradient changes: an implicit inverse Hessian.
#[derive(Debug, Default)]
struct Memory {
    /// (step s, −gradient change y, 1 / sᵀy)
    pairs: VecDeque<(Vec<f64>, Vec<f64>, f64)>,
}

impl Memory {
    const LENGTH: usize = 10;

    fn push(&mut self, from: &Point, to: &Point) {
        let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect();
        let step: Vec<f64> = difference(&to.position, &from.position);
        let change: Vec<f64> = difference(&from.gradient, &to.gradient);
        let curvature = dot::<4>(&step, &change);
        if curvature > 1e-10 * dot::<4>(&change, &change).sqrt() * dot::<4>(&step, &step).sqrt() {
            if self.pairs.len() == Self::LENGTH {
                self.pairs.pop_front();
            }
            self.pairs.push_back((step, change, 1.0 / curvature));
        }
    }

    /// The direction by the two-loop recursion. Before anything is known, it is the gradient scaled
    /// to a length of at most 1.
    fn ascent_direction(&self, gradient: &[f64]) -> Vec<f64> {
        let mut direction = gradient.to_vec();
        let Some((step, change, _)) = self.pairs.back() else {
            let length = dot::<4>(gradient, gradient).sqrt().max(1.0);
            for d in &mut direction {
                *d /= length;
            }
            return direction;
        };
        let scale = dot::<4>(step, change) / dot::<4>(change, change);
        let mut alphas = Vec::with_capacity(self.pairs.len());
        for (step, change, inverse) in self.pairs.iter().rev() {
            let alpha = inverse * dot::<4>(step, &direction);
            axpy(-alpha, change, &mut direction);
            alphas.push(alpha);
        }
        for d in &mut direction {
            *d *= scale;
        }
        for ((step, change, inverse), alpha) in self.pairs.iter().zip(alphas.iter().rev()) {
            let beta = inverse * dot::<4>(change, &direction);
            axpy(alpha - beta, step, &mut direction);
        }
        direction
    }
}

/// Search along one direction for a step that gains enough and flattens enough (strong Wolfe).
struct LineSearch<'a> {
    evaluator: &'a mut dyn Evaluator,
    from: &'a Point,
    direction: Vec<f64>,
    /// A step is not tried if it is so short that it can gain no more than this.
    least_gain: f64,
}

impl LineSearch<'_> {
    /// Sufficient increase.
    const C1: f64 = 1e-4;
    /// Curvature.
    const C2: f64 = 0.9;
    const MAX_STEPS: u32 = 50;

    /// A step that satisfies both conditions. If there is none, the best step that gains at all;
    /// `None` if no step gains.
    ///
    /// The bracket [low, high] holds such a step: `low` gains, `high` (once finite) is too far.
    fn run(mut self) -> Option<Point> {
        let slope = dot::<4>(&self.from.gradient, &self.direction);
        let (mut low, mut high, mut length) = (0.0, f64::INFINITY, 1.0);
        let mut best: Option<Point> = None;
        for _ in 0..Self::MAX_STEPS {
            if length * slope < self.least_gain {
                break;
            }
            let point = self.at(length);
            let threshold = self.from.ln_density + Self::C1 * length * slope;
            let floor = best.as_ref().map_or(f64::NEG_INFINITY, |best| best.ln_density);
            if !point.is_finite() || point.ln_density < threshold.max(floor) {
                high = length;
                if low == 0.0 && point.is_finite() {
                    // the top of the parabola through both ends with the slope at this one
                    let gain = point.ln_density - self.from.ln_density;
                    let top = 0.5 * slope * length / (slope * length - gain);
                    length *= top.clamp(0.1, 0.5);
                    continue;
                }
            } else {
                let here = dot::<4>(&point.gradient, &self.direction);
                if here.abs() <= Self::C2 * slope {
                    return Some(point);
                }
                if here > 0.0 {
                    low = length;
                } else {
                    high = length;
                }
                best = Some(point);
            }
            length = if high.is_finite() { 0.5 * (low + high) } else { 2.0 * length };
        }
        best.filter(|best| best.ln_density > self.from.ln_density)
    }

    fn at(&mut self, length: f64) -> Point {
        let mut position = self.from.position.clone();
        axpy(length, &self.direction, &mut position);
        Point::at(self.evaluator, position)
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_densities::{FnDensity, funnel, normal};
    use super::*;

    #[test]
    fn finds_the_rosenbrock_maximum() {
        let rosenbrock = FnDensity {
            dim: 2,
            f: |q: &[f64], g: &mut [f64]| {
                let (a, b) = (1.0 - q[0], q[1] - q[0] * q[0]);
                g[0] = 2.0 * a + 400.0 * q[0] * b;
                g[1] = -200.0 * b;
                -a * a - 100.0 * b * b
            },
        };
        let optimum = maximise(&rosenbrock, &[-1.2, 1.0], &OptimumSettings::default()).unwrap();
        assert!(optimum.converged && optimum.iterations < 60, "{optimum:?}");
        assert!(optimum.position.iter().all(|q| (q - 1.0).abs() < 1e-6), "{optimum:?}");
    }

    #[test]
    fn converges_on_a_badly_scaled_normal() {
        let density = normal((0..50).map(|i| 10f64.powf(f64::from(i) / 25.0 - 1.0)).collect());
        let optimum = maximise(&density, &[3.0; 50], &OptimumSettings::default()).unwrap();
        assert!(optimum.converged, "{optimum:?}");
    }

    #[test]
    fn steps_back_from_walls_of_minus_infinity_and_nan() {
        // Gamma(2, 1) kernel on its natural scale: no support for q ≤ 0, NaN beyond 50.
        let gamma = FnDensity {
            dim: 1,
            f: |q: &[f64], g: &mut [f64]| {
                g[0] = 1.0 / q[0] - 1.0;
                if q[0] <= 0.0 {
                    f64::NEG_INFINITY
                } else if q[0] > 50.0 {
                    f64::NAN
                } else {
                    q[0].ln() - q[0]
                }
            },
        };
        for start in [1e-3, 49.0] {
            let optimum = maximise(&gamma, &[start], &OptimumSettings::default()).unwrap();
            assert!(optimum.converged && (optimum.position[0] - 1.0).abs() < 1e-5, "{optimum:?}");
        }
        let error = maximise(&gamma, &[-1.0], &OptimumSettings::default()).unwrap_err();
        assert!(matches!(error, InferError::NoSupport { .. }));
    }

    #[test]
    fn an_unbounded_density_ends_unconverged_and_finite() {
        let settings = OptimumSettings { max_iterations: 100, ..OptimumSettings::default() };
        let optimum = maximise(&funnel(20), &[0.5; 20], &settings).unwrap();
        assert!(optimum.ln_density.is_finite());
        let linear = FnDensity {
            dim: 1,
            f: |q: &[f64], g: &mut [f64]| {
                g[0] = 1.0;
                q[0]
            },
        };
        let optimum = maximise(&linear, &[0.0], &settings).unwrap();
        assert!(!optimum.converged && optimum.ln_density.is_finite());
    }
}
