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

use super::density::Evaluator;
use crate::num::vector::{axpy, dot};
use serde::{Deserialize, Serialize};

/// Factor F of the inverse mass matrix M⁻¹ = F Fᵀ:
///
/// ```text
/// F = S (I + Σ (stretch_r − 1) u_r u_rᵀ)        S = diag(scale), u_r orthonormal
/// ```
/// A product with F costs `(1 + 2 rank) dim`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Metric {
    /// One per coordinate.
    pub(super) scale: Vec<f64>,
    /// The u, row-major `(rank, dim)`.
    pub(super) directions: Vec<f64>,
    /// One per direction.
    pub(super) stretch: Vec<f64>,
}

impl Metric {
    /// F = diag(scale).
    pub(super) fn diagonal(scale: Vec<f64>) -> Self {
        Self { scale, directions: vec![], stretch: vec![] }
    }

    /// Whether it is a metric of `dim` coordinates.
    pub(super) fn fits(&self, dim: usize) -> bool {
        self.scale.len() == dim
            && Some(self.directions.len()) == self.stretch.len().checked_mul(dim)
    }

    fn stretched(&self) -> impl Iterator<Item = (&[f64], f64)> {
        self.directions.chunks_exact(self.scale.len()).zip(self.stretch.iter().copied())
    }

    /// q += ε F p
    pub(super) fn drift(&self, position: &mut [f64], step_size: f64, momentum: &[f64]) {
        for ((q, s), p) in position.iter_mut().zip(&self.scale).zip(momentum) {
            *q += step_size * s * p;
        }
        for (direction, stretch) in self.stretched() {
            let c = step_size * (stretch - 1.0) * dot::<4>(direction, momentum);
            for ((q, s), u) in position.iter_mut().zip(&self.scale).zip(direction) {
                *q += c * s * u;
            }
        }
    }

    /// x ← F⁻¹ x
    pub(super) fn whiten(&self, x: &mut [f64]) {
        x.iter_mut().zip(&self.scale).for_each(|(x, s)| *x /= s);
        for (direction, stretch) in self.stretched() {
            let c = (stretch.recip() - 1.0) * dot::<4>(direction, x);
            axpy(c, direction, x);
        }
    }

    /// force = Fᵀ gradient
    pub(super) fn pull(&self, gradient: &[f64], force: &mut [f64]) {
        for ((f, s), g) in force.iter_mut().zip(&self.scale).zip(gradient) {
            *f = s * g;
        }
        for (direction, stretch) in self.stretched() {
            // earlier directions are orthogonal to this one, so they may be in `force` already
            let c = (stretch - 1.0) * dot::<4>(direction, force);
            axpy(c, direction, force);
        }
    }
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

    fn metrics() -> [Metric; 2] {
        let turned = Metric {
            scale: vec![0.7, 1.9],
            directions: vec![0.6, 0.8, -0.8, 0.6],
            stretch: vec![3.0, 0.4],
        };
        [Metric::diagonal(vec![0.7, 1.9]), turned]
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
    fn leapfrog_preserves_volume_under_both_metrics() {
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

    /// drift multiplies by F, pull by its transpose: p · (Fᵀ g) = (F p) · g, and F is as written.
    #[test]
    fn drift_and_pull_are_the_factor_and_its_transpose() {
        let [_, metric] = metrics();
        let factor = |column: usize| {
            let (mut moved, mut unit) = ([0.0; 2], [0.0; 2]);
            unit[column] = 1.0;
            metric.drift(&mut moved, 1.0, &unit);
            moved
        };
        let entry = |i: usize, j: usize| {
            let u = [[0.6, 0.8], [-0.8, 0.6]];
            let sum: f64 = (0..2).map(|r| (metric.stretch[r] - 1.0) * u[r][i] * u[r][j]).sum();
            metric.scale[i] * (f64::from(u8::from(i == j)) + sum)
        };
        let mut force = [0.0; 2];
        metric.pull(&[0.3, -1.2], &mut force);
        for (j, force) in force.into_iter().enumerate() {
            let column = factor(j);
            assert!((0..2).all(|i| (column[i] - entry(i, j)).abs() < 1e-14));
            assert!((force - (0.3 * column[0] - 1.2 * column[1])).abs() < 1e-14);
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
