//! Hamiltonian dynamics on a log density: the metric, the phase-space point, the leapfrog step.
//!
//! Momenta are kept *whitened*, p ~ N(0, I), so that every metric has kinetic energy ½ pᵀp and a
//! metric is only the factor F of M⁻¹ = F Fᵀ:
//!
//! ```text
//! energy = −ln π(q) + ½ pᵀp        p += ½ ε Fᵀ∇ln π(q)      q += ε F p
//! ```
//!
//! Knows nothing of trees or of adaptation.

use super::cholesky::Factor;
use super::density::Evaluator;
use crate::num::vector::{axpy, dot};
use serde::{Deserialize, Serialize};

/// Factor F of the inverse mass matrix M⁻¹ = F Fᵀ: F = S G, S = diag(scale).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Metric {
    /// One per coordinate.
    pub(super) scale: Vec<f64>,
    /// G
    pub(super) shape: Shape,
}

/// How coordinates go together, in units of their scales.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) enum Shape {
    /// G = I + Σ (stretch − 1) u uᵀ, the u orthonormal. A product with it costs 2 rank dim.
    Stretched {
        /// The u, row-major `(rank, dim)`.
        directions: Vec<f64>,
        /// One per direction.
        stretch: Vec<f64>,
    },
    /// G = L⁻ᵀ, of the precision L Lᵀ. A product with it costs ½ dim².
    Precision(Factor),
}

impl Shape {
    /// G = I
    const ROUND: Self = Self::Stretched { directions: vec![], stretch: vec![] };
}

impl Metric {
    /// F = diag(scale).
    pub(super) fn diagonal(scale: Vec<f64>) -> Self {
        Self { scale, shape: Shape::ROUND }
    }

    /// Whether it is a metric of `dim` coordinates.
    pub(super) fn fits(&self, dim: usize) -> bool {
        self.scale.len() == dim
            && match &self.shape {
                Shape::Stretched { directions, stretch } => {
                    Some(directions.len()) == stretch.len().checked_mul(dim)
                }
                Shape::Precision(factor) => factor.fits(dim),
            }
    }

    /// q += ε F p
    pub(super) fn drift(&self, position: &mut [f64], step_size: f64, momentum: &[f64]) {
        let mut add = |c: f64, x: &[f64]| {
            for ((q, s), x) in position.iter_mut().zip(&self.scale).zip(x) {
                *q += c * s * x;
            }
        };
        match &self.shape {
            Shape::Stretched { directions, stretch } => {
                add(step_size, momentum);
                for (u, stretch) in each(directions, stretch) {
                    add(step_size * (stretch - 1.0) * dot::<4>(u, momentum), u);
                }
            }
            Shape::Precision(factor) => {
                let mut velocity = momentum.to_vec();
                factor.solve_transposed(&mut velocity);
                add(step_size, &velocity);
            }
        }
    }

    /// F⁻¹ x
    pub(super) fn whitened(&self, x: &[f64]) -> Vec<f64> {
        let mut whitened: Vec<f64> = x.iter().zip(&self.scale).map(|(x, s)| x / s).collect();
        match &self.shape {
            Shape::Stretched { directions, stretch } => {
                for (u, stretch) in each(directions, stretch) {
                    let c = (stretch.recip() - 1.0) * dot::<4>(u, &whitened);
                    axpy(c, u, &mut whitened);
                }
                whitened
            }
            Shape::Precision(factor) => factor.whitened(&whitened),
        }
    }

    /// force = Fᵀ gradient
    pub(super) fn pull(&self, gradient: &[f64], force: &mut [f64]) {
        for ((f, s), g) in force.iter_mut().zip(&self.scale).zip(gradient) {
            *f = s * g;
        }
        match &self.shape {
            Shape::Stretched { directions, stretch } => {
                for (u, stretch) in each(directions, stretch) {
                    // earlier directions are orthogonal to this one, so they may be in `force` already
                    let c = (stretch - 1.0) * dot::<4>(u, force);
                    axpy(c, u, force);
                }
            }
            Shape::Precision(factor) => factor.solve(force),
        }
    }
}

/// Directions with their stretches.
fn each<'m>(directions: &'m [f64], stretch: &'m [f64]) -> impl Iterator<Item = (&'m [f64], f64)> {
    let dim = directions.len() / stretch.len().max(1);
    directions.chunks_exact(dim.max(1)).zip(stretch.iter().copied())
}

/// A point in phase space with the density's value and slope there.
#[derive(Clone, Debug, Default)]
pub(super) struct PhasePoint {
    pub(super) position: Vec<f64>,
    /// Whitened: standard normal.
    pub(super) momentum: Vec<f64>,
    pub(super) gradient: Vec<f64>,
    /// Fᵀ gradient.
    force: Vec<f64>,
    pub(super) ln_density: f64,
}

impl PhasePoint {
    pub(super) fn new(dim: usize) -> Self {
        let zeros = || vec![0.0; dim];
        Self {
            position: zeros(),
            momentum: zeros(),
            gradient: zeros(),
            force: zeros(),
            ln_density: 0.0,
        }
    }

    /// Copies without allocating.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.position.copy_from_slice(&other.position);
        self.momentum.copy_from_slice(&other.momentum);
        self.gradient.copy_from_slice(&other.gradient);
        self.force.copy_from_slice(&other.force);
        self.ln_density = other.ln_density;
    }

    /// −ln π + ½ pᵀp; not finite where the density or its gradient is not.
    pub(super) fn energy(&self) -> f64 {
        0.5 * dot::<4>(&self.momentum, &self.momentum) - self.ln_density
    }
}

/// A density's evaluator with a metric: what moves a [`PhasePoint`].
pub(super) struct Hamiltonian<E> {
    pub(super) evaluator: E,
    pub(super) metric: Metric,
    /// Density evaluations so far.
    pub(super) n_evaluations: u64,
}

impl<E: Evaluator> Hamiltonian<E> {
    pub(super) fn new(evaluator: E, metric: Metric) -> Self {
        Self { evaluator, metric, n_evaluations: 0 }
    }

    /// Fills value, gradient and force of `point` from its position.
    pub(super) fn evaluate(&mut self, point: &mut PhasePoint) {
        self.n_evaluations += 1;
        point.ln_density = self.evaluator.ln_density(&point.position, &mut point.gradient);
        self.refresh_force(point);
    }

    /// Recomputes the force, after the metric has changed.
    pub(super) fn refresh_force(&self, point: &mut PhasePoint) {
        self.metric.pull(&point.gradient, &mut point.force);
    }

    /// One leapfrog step of size ε (negative: backwards in time).
    pub(super) fn leapfrog(&mut self, point: &mut PhasePoint, step_size: f64) {
        axpy(0.5 * step_size, &point.force, &mut point.momentum);
        self.metric.drift(&mut point.position, step_size, &point.momentum);
        self.evaluate(point);
        axpy(0.5 * step_size, &point.force, &mut point.momentum);
    }
}

#[cfg(test)]
mod tests {
    use super::super::density::LogDensity;
    use super::super::test_densities::{FnDensity, banana};
    use super::*;

    fn metrics() -> [Metric; 3] {
        let scale = vec![0.7, 1.9];
        let of = |shape: Shape| Metric { scale: scale.clone(), shape };
        let (directions, stretch) = (vec![0.6, 0.8, -0.8, 0.6], vec![3.0, 0.4]);
        let precision = faer::Mat::from_fn(2, 2, |i, j| [[2.0, -0.9], [-0.9, 0.7]][i][j]);
        let factor = Factor::of(precision.as_ref()).unwrap();
        [Shape::ROUND, Shape::Stretched { directions, stretch }, Shape::Precision(factor)].map(of)
    }

    fn start(hamiltonian: &mut Hamiltonian<impl Evaluator>) -> PhasePoint {
        let mut point = PhasePoint::new(2);
        point.position = vec![0.3, -0.8];
        point.momentum = vec![0.9, -1.3];
        hamiltonian.evaluate(&mut point);
        point
    }

    #[test]
    fn leapfrog_is_reversible_and_of_second_order() {
        for metric in metrics() {
            let density = banana();
            let mut hamiltonian = Hamiltonian::new(density.evaluator(), metric);
            let first = start(&mut hamiltonian);
            let mut error = |n: u32| {
                let mut point = first.clone();
                let step_size = 0.4 / f64::from(n);
                (0..n).for_each(|_| hamiltonian.leapfrog(&mut point, step_size));
                let error = point.energy() - first.energy();
                (0..n).for_each(|_| hamiltonian.leapfrog(&mut point, -step_size));
                let back = point.position.iter().zip(&first.position);
                assert!(back.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 1e-12);
                error.abs()
            };
            let order = (error(64) / error(128)).log2();
            assert!((order - 2.0).abs() < 0.05, "order {order}");
        }
    }

    #[test]
    fn leapfrog_preserves_volume_under_each_metric() {
        for metric in metrics() {
            let density = banana();
            let mut hamiltonian = Hamiltonian::new(density.evaluator(), metric);
            let first = start(&mut hamiltonian);
            let mut column = |k: usize, h: f64| {
                let mut point = first.clone();
                let coordinate =
                    if k < 2 { &mut point.position[k] } else { &mut point.momentum[k - 2] };
                *coordinate += h;
                hamiltonian.evaluate(&mut point);
                hamiltonian.leapfrog(&mut point, 0.2);
                [point.position, point.momentum].concat()
            };
            let h = 1e-5;
            let jacobian = nalgebra::DMatrix::from_fn(4, 4, |i, k| {
                (column(k, h)[i] - column(k, -h)[i]) / (2.0 * h)
            });
            assert!((jacobian.determinant() - 1.0).abs() < 1e-8);
        }
    }

    /// F, by what drift moves.
    fn factor(metric: &Metric) -> [[f64; 2]; 2] {
        let column = |j: usize| {
            let (mut moved, mut unit) = ([0.0; 2], [0.0; 2]);
            unit[j] = 1.0;
            metric.drift(&mut moved, 1.0, &unit);
            moved
        };
        let columns = [column(0), column(1)];
        [0, 1].map(|i| [0, 1].map(|j| columns[j][i]))
    }

    /// pull multiplies by the transpose of F, whitened by its inverse.
    #[test]
    fn drift_pull_and_whitened_are_of_one_factor() {
        for metric in metrics() {
            let f = factor(&metric);
            let mut force = [0.0; 2];
            metric.pull(&[0.3, -1.2], &mut force);
            let there = [0, 1].map(|i| f[i][0] * 0.5 - f[i][1] * 0.8);
            let back = metric.whitened(&there);
            for (j, expected) in [0.5, -0.8].into_iter().enumerate() {
                assert!((force[j] - (0.3 * f[0][j] - 1.2 * f[1][j])).abs() < 1e-14);
                assert!((back[j] - expected).abs() < 1e-14);
            }
        }
    }

    /// As written: S (I + Σ (stretch − 1) u uᵀ), and F Fᵀ = S P⁻¹ S.
    #[test]
    fn factors_are_as_written() {
        let [_, stretched, precise] = metrics();
        let f = factor(&stretched);
        let turned = |i: usize, j: usize| {
            let (u, stretch) = ([[0.6, 0.8], [-0.8, 0.6]], [3.0, 0.4]);
            (0..2).map(|r| stretch[r] * u[r][i] * u[r][j]).sum::<f64>()
        };
        let g = factor(&precise);
        let determinant = 2.0 * 0.7 - 0.9 * 0.9;
        let covariance = [[0.7, 0.9], [0.9, 2.0]].map(|row| row.map(|x| x / determinant));
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let s = &stretched.scale;
            assert!((f[i][j] - s[i] * turned(i, j)).abs() < 1e-14);
            let product: f64 = (0..2).map(|k| g[i][k] * g[j][k]).sum();
            assert!((product - s[i] * s[j] * covariance[i][j]).abs() < 1e-13);
        }
    }

    #[test]
    fn energy_outside_the_support_is_infinite() {
        let density = FnDensity { dim: 1, f: |_: &[f64], _: &mut [f64]| f64::NEG_INFINITY };
        let metric = Metric::diagonal(vec![1.0]);
        let mut hamiltonian = Hamiltonian::new(density.evaluator(), metric);
        let mut point = PhasePoint::new(1);
        hamiltonian.evaluate(&mut point);
        assert!(point.energy() == f64::INFINITY);
    }
}
