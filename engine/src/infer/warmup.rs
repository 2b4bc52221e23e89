//! Warm-up: step size by dual averaging, metric from draws and gradients.
//!
//! Knows the sampler only through [`Kernel`]; nothing of chains,
//! threads or storage.
//!
//! # Source
//! Hoffman & Gelman 2014, section 3.2 (dual averaging, initial step size; the letters are theirs).
//! Seyboldt, Carlson & Carpenter, "Preconditioning Hamiltonian Monte Carlo by minimizing
//! Fisher divergence" (diagonal metric, two overlapping windows).

use super::density::Evaluator;
use super::draws::Transition;
use super::hamiltonian::Metric;
use super::kernel::Kernel;
use super::moments::DrawMoments;
use super::settings::MetricKind;
use super::stages::{Stage, WarmUp};
use serde::{Deserialize, Serialize};

/// Step size that brings the mean acceptance to δ.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct DualAveraging {
    /// Target acceptance.
    delta: f64,
    /// Where ln ε shrinks to.
    mu: f64,
    t: f64,
    /// H̄: averaged error of the acceptance.
    h_bar: f64,
    ln_epsilon: f64,
    /// Averaged ln ε, the final answer.
    ln_epsilon_bar: f64,
}

impl DualAveraging {
    const GAMMA: f64 = 0.05;
    const T0: f64 = 10.0;
    const KAPPA: f64 = 0.75;

    /// Starts at `step_size`, and leans towards ten times that, because large steps are cheap to
    /// try.
    pub(super) fn new(step_size: f64, delta: f64) -> Self {
        let ln_epsilon = step_size.ln();
        let mu = (10.0 * step_size).ln();
        Self { delta, mu, t: 0.0, h_bar: 0.0, ln_epsilon, ln_epsilon_bar: ln_epsilon }
    }

    /// Learns from the mean acceptance of one transition.
    pub(super) fn update(&mut self, accept: f64) {
        self.t += 1.0;
        let w = 1.0 / (self.t + Self::T0);
        self.h_bar = (1.0 - w) * self.h_bar + w * (self.delta - accept);
        self.ln_epsilon = self.mu - self.t.sqrt() / Self::GAMMA * self.h_bar;
        let eta = self.t.powf(-Self::KAPPA);
        self.ln_epsilon_bar = eta * self.ln_epsilon + (1.0 - eta) * self.ln_epsilon_bar;
    }

    /// ε to use while adapting.
    pub(super) fn step_size(&self) -> f64 {
        self.ln_epsilon.exp()
    }

    /// ε to keep afterwards.
    pub(super) fn averaged_step_size(&self) -> f64 {
        self.ln_epsilon_bar.exp()
    }
}

/// Doubles or halves ε until the acceptance of one leapfrog step crosses 0.8. `None` if no ε
/// reaches it.
fn initial_step_size<E: Evaluator>(kernel: &mut Kernel<E>) -> Option<f64> {
    const MAX_DOUBLINGS: u32 = 100;
    let mut step_size = 1.0;
    let growing = kernel.trial_acceptance(step_size) > 0.8;
    for _ in 0..MAX_DOUBLINGS {
        let next = if growing { step_size * 2.0 } else { step_size * 0.5 };
        let accepted = kernel.trial_acceptance(next) > 0.8;
        if growing && !accepted {
            return Some(step_size);
        }
        step_size = next;
        if !growing && accepted {
            return Some(step_size);
        }
    }
    None
}

/// What one chain has learnt in its warm-up.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Adaptation {
    kind: MetricKind,
    target_accept: f64,
    older: DrawMoments,
    younger: DrawMoments,
    step_size: DualAveraging,
}

impl Adaptation {
    /// The fewest draws that a diagonal metric is made of.
    const LEAST: usize = 10;

    /// Whether enough is known beforehand to make a metric.
    pub(super) fn is_enough(learnt: &DrawMoments) -> bool {
        learnt.n() >= Stage::LATE.0
    }

    /// Sets the chain's first step size. Sets its first metric, too, if enough was `learnt` before.
    /// `None` if no step size works.
    pub(super) fn begin<E: Evaluator>(
        kernel: &mut Kernel<E>,
        kind: MetricKind,
        target_accept: f64,
        learnt: &DrawMoments,
    ) -> Option<Self> {
        let is_warm = Self::is_enough(learnt);
        let mut younger = learnt.clone();
        younger.clear();
        let older = if is_warm { learnt.clone() } else { younger.clone() };
        if let (true, Some(factor)) = (is_warm, older.shrunk_covariance_factor()) {
            kernel.hamiltonian().metric = Metric::Dense(factor);
        } else if let (true, Metric::Diagonal(scale)) = (is_warm, &mut kernel.hamiltonian().metric)
        {
            older.fisher_scales(scale);
        }
        let step_size = DualAveraging::new(initial_step_size(kernel)?, target_accept);
        Some(Self { kind, target_accept, older, younger, step_size })
    }

    /// ε for the next transition.
    pub(super) fn step_size(&self) -> f64 {
        self.step_size.step_size()
    }

    /// ε for sampling.
    pub(super) fn final_step_size(&self) -> f64 {
        self.step_size.averaged_step_size()
    }

    /// Learns from the transition that was just made; `warm_up` says what adapts at it.
    pub(super) fn update<E: Evaluator>(
        &mut self,
        warm_up: &WarmUp,
        kernel: &mut Kernel<E>,
        transition: &Transition,
    ) {
        self.step_size.update(transition.accept);
        let Some(window) = warm_up.window() else { return };
        self.older.add(&kernel.point.position, &kernel.point.gradient);
        self.younger.add(&kernel.point.position, &kernel.point.gradient);
        let full = self.younger.n() >= window;
        match self.kind {
            MetricKind::Diagonal if self.older.n() >= Self::LEAST => self.set_diagonal(kernel),
            MetricKind::Dense if full => self.set_dense(kernel),
            _ => {}
        }
        if full {
            std::mem::swap(&mut self.older, &mut self.younger);
            self.younger.clear();
        }
        if warm_up.ends_metric() {
            self.step_size = DualAveraging::new(self.final_step_size(), self.target_accept);
        }
    }

    fn set_diagonal<E: Evaluator>(&self, kernel: &mut Kernel<E>) {
        if let Metric::Diagonal(scale) = &mut kernel.hamiltonian().metric {
            self.older.fisher_scales(scale);
        }
    }

    /// With a new dense metric the step size that suits it is another one, so its adaptation starts
    /// anew.
    fn set_dense<E: Evaluator>(&mut self, kernel: &mut Kernel<E>) {
        if let Some(factor) = self.older.shrunk_covariance_factor() {
            kernel.hamiltonian().metric = Metric::Dense(factor);
            if let Some(step_size) = initial_step_size(kernel) {
                self.step_size = DualAveraging::new(step_size, self.target_accept);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::curvature::conditional_scales;
    use super::super::density::LogDensity;
    use super::super::hamiltonian::Hamiltonian;
    use super::super::test_densities::{FnDensity, normal};
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn kernel(density: &dyn LogDensity) -> Kernel<Box<dyn Evaluator + '_>> {
        let metric = Metric::Diagonal(vec![1.0; density.dim()]);
        let hamiltonian = Hamiltonian::new(density.evaluator(), metric);
        Kernel::new(hamiltonian, &vec![0.1; density.dim()], 10, ChaCha8Rng::seed_from_u64(3))
    }

    #[test]
    fn dual_averaging_follows_the_paper_for_two_steps() {
        // By hand: mu = ln 10, target 0.8, acceptances 0.3 then 1.
        let mut adapt = DualAveraging::new(1.0, 0.8);
        adapt.update(0.3);
        let h1 = 0.5 / 11.0;
        let x1 = 10f64.ln() - h1 / 0.05;
        assert!((adapt.step_size().ln() - x1).abs() < 1e-14);
        assert!((adapt.averaged_step_size().ln() - x1).abs() < 1e-14);
        adapt.update(1.0);
        let h2 = h1 * 11.0 / 12.0 - 0.2 / 12.0;
        let x2 = 10f64.ln() - 2f64.sqrt() / 0.05 * h2;
        let eta = 2f64.powf(-0.75);
        assert!((adapt.step_size().ln() - x2).abs() < 1e-14);
        let averaged = eta * x2 + (1.0 - eta) * x1;
        assert!((adapt.averaged_step_size().ln() - averaged).abs() < 1e-14);
    }

    #[test]
    fn dual_averaging_finds_the_step_size_of_a_known_acceptance_curve() {
        let mut adapt = DualAveraging::new(0.2, 0.9);
        for _ in 0..1000 {
            let accept = (-adapt.step_size()).exp();
            adapt.update(accept);
        }
        assert!((adapt.averaged_step_size() + 0.9f64.ln()).abs() < 0.005);
    }

    #[test]
    fn initial_step_size_scales_with_the_density_and_fails_without_support() {
        let large = initial_step_size(&mut kernel(&normal(vec![1e3; 5]))).unwrap();
        let small = initial_step_size(&mut kernel(&normal(vec![1e-3; 5]))).unwrap();
        assert!((5e4..5e7).contains(&(large / small)), "{large} {small}");
        let nowhere = FnDensity { dim: 2, f: |_: &[f64], _: &mut [f64]| f64::NAN };
        assert!(initial_step_size(&mut kernel(&nowhere)).is_none());
    }

    #[test]
    fn initial_step_size_stays_on_this_side_of_an_undefined_region() {
        // Flat, so that every step inside is accepted, and NaN beyond.
        let f = |q: &[f64], g: &mut [f64]| {
            g[0] = 0.0;
            if q[0].abs() > 100.0 { f64::NAN } else { 0.0 }
        };
        let step_size = initial_step_size(&mut kernel(&FnDensity { dim: 1, f })).unwrap();
        assert!(step_size < 1e5, "{step_size}");
    }

    #[test]
    fn conditional_scales_are_exact_for_a_normal_and_fall_back_on_flat_ground() {
        let density = normal(vec![0.01, 1.0, 30.0]);
        let scales = conditional_scales(&mut *density.evaluator(), &[0.02, -3.0, 5.0], 1.0);
        for (scale, sd) in scales.iter().zip([0.01, 1.0, 30.0]) {
            assert!((scale / sd - 1.0).abs() < 1e-6);
        }
        let flat = FnDensity {
            dim: 1,
            f: |_: &[f64], g: &mut [f64]| {
                g[0] = 0.0;
                0.0
            },
        };
        assert_eq!(conditional_scales(&mut *flat.evaluator(), &[0.0], 2.5), [2.5]);
    }

    #[test]
    fn warm_up_begins_with_the_scales_of_enough_earlier_draws() {
        let sd = [0.01, 1.0, 30.0];
        let density = normal(sd.to_vec());
        let draws: Vec<Vec<f64>> =
            (0..80).map(|k| sd.iter().map(|s| s * f64::from(k * k % 7)).collect()).collect();
        let scales = |draws: &[Vec<f64>]| {
            let mut kernel = kernel(&density);
            let learnt = DrawMoments::of(&density, draws, false);
            Adaptation::begin(&mut kernel, MetricKind::Diagonal, 0.9, &learnt).unwrap();
            let Metric::Diagonal(scales) = kernel.hamiltonian().metric.clone() else { panic!() };
            scales
        };
        // for a normal the scales are exact whatever the draws
        let ratios = scales(&draws).into_iter().zip(sd).map(|(scale, sd)| scale / sd);
        assert!(ratios.into_iter().all(|ratio| (ratio - 1.0).abs() < 1e-9));
        assert_eq!(scales(&draws[1..]), [1.0; 3]);
        let outside = vec![vec![f64::NAN; 3]; 80];
        assert_eq!(scales(&outside), [1.0; 3]);
    }

    #[test]
    fn a_coordinate_that_is_all_but_flat_has_a_step_size() {
        // Curvature 1e-150 between two walls, as where every measurement is explained for certain.
        let f = |q: &[f64], g: &mut [f64]| {
            let beyond = (q[0].abs() - 10.0).max(0.0);
            g[0] = -1e-150 * q[0] - 100.0 * beyond * q[0].signum();
            g[1] = -q[1];
            -0.5e-150 * q[0] * q[0] - 50.0 * beyond * beyond - 0.5 * q[1] * q[1]
        };
        let density = FnDensity { dim: 2, f };
        let scales = conditional_scales(&mut *density.evaluator(), &[0.1, 0.1], 1.0);
        assert!((scales[0] - 1e3).abs() < 1e-9 && (scales[1] - 1.0).abs() < 1e-6, "{scales:?}");
        let step_size = |scales: Vec<f64>| {
            let mut kernel = kernel(&density);
            kernel.hamiltonian().metric = Metric::Diagonal(scales);
            initial_step_size(&mut kernel)
        };
        assert!(step_size(scales).is_some());
        assert!(step_size(vec![1e75, 1.0]).is_none(), "the scale that the curvature gives");
    }
}
