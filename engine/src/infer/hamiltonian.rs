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

/// Factor F of the inverse mass matrix M⁻¹ = F Fᵀ.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) enum Metric {
    /// F = diag(scale).
    Diagonal(Vec<f64>),
    /// F lower triangular, row-major `(dim, dim)`.
    Dense(Vec<f64>),
}

impl Metric {
    /// M⁻¹: its diagonal `(dim)`, or row-major `(dim, dim)` if dense.
    pub(super) fn inverse_mass(&self, dim: usize) -> Vec<f64> {
        match self {
            Self::Diagonal(scale) => scale.iter().map(|s| s * s).collect(),
            Self::Dense(factor) => {
                let row = |i: usize| &factor[i * dim..(i + 1) * dim];
                (0..dim * dim).map(|k| dot::<4>(row(k / dim), row(k % dim))).collect()
            }
        }
    }

    /// q += ε F p
    fn drift(&self, position: &mut [f64], step_size: f64, momentum: &[f64]) {
        match self {
            Self::Diagonal(scale) => {
                for ((q, s), p) in position.iter_mut().zip(scale).zip(momentum) {
                    *q += step_size * s * p;
                }
            }
            Self::Dense(factor) => {
                let dim = position.len();
                for (i, (q, row)) in position.iter_mut().zip(factor.chunks_exact(dim)).enumerate() {
                    *q += step_size * dot::<4>(&row[..=i], &momentum[..=i]);
                }
            }
        }
    }

    /// force = Fᵀ gradient
    fn pull(&self, gradient: &[f64], force: &mut [f64]) {
        match self {
            Self::Diagonal(scale) => {
                for ((f, s), g) in force.iter_mut().zip(scale).zip(gradient) {
                    *f = s * g;
                }
            }
            Self::Dense(factor) => {
                force.fill(0.0);
                for (i, row) in factor.chunks_exact(force.len()).enumerate() {
                    axpy(gradient[i], &row[..=i], &mut force[..=i]);
                }
            }
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
        [Metric::Diagonal(vec![0.7, 1.9]), Metric::Dense(vec![0.7, 0.0, -0.4, 1.9])]
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

    #[test]
    fn inverse_mass_is_the_factor_times_its_transpose() {
        let dense = Metric::Dense(vec![2.0, 0.0, 3.0, 1.0]).inverse_mass(2);
        assert_eq!(dense, [4.0, 6.0, 6.0, 10.0]);
        assert_eq!(Metric::Diagonal(vec![2.0, 3.0]).inverse_mass(2), [4.0, 9.0]);
    }

    #[test]
    fn energy_outside_the_support_is_infinite() {
        let density = FnDensity { dim: 1, f: |_: &[f64], _: &mut [f64]| f64::NEG_INFINITY };
        let metric = Metric::Diagonal(vec![1.0]);
        let mut hamiltonian = Hamiltonian::new(density.evaluator(), metric);
        let mut point = PhasePoint::new(1);
        hamiltonian.evaluate(&mut point);
        assert!(point.energy() == f64::INFINITY);
    }
}
