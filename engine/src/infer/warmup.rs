//! Warm-up: step size by stochastic approximation, metric from draws and gradients.
//!
//! Knows the sampler only through [`Kernel`]; nothing of chains,
//! threads or storage.
//!
//! # Source
//! Hoffman & Gelman 2014, section 3.2 (initial step size). Robbins & Monro 1951, Polyak & Juditsky 1992.
//! Seyboldt, Carlson & Carpenter, "Preconditioning Hamiltonian Monte Carlo by minimizing
//! Fisher divergence" (two overlapping windows).

use super::density::Evaluator;
use super::draws::Transition;
use super::kernel::Kernel;
use super::moments::DrawMoments;
use super::settings::MetricKind;
use super::stages::{Stage, WarmUp};
use serde::{Deserialize, Serialize};

/// Step size that brings the mean acceptance to δ: each transition moves ln ε by its error of the
/// acceptance, less and less. Averages of ln ε over ever later transitions are the answer.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct StepSize {
    /// Target acceptance.
    delta: f64,
    t: f64,
    ln_epsilon: f64,
    ln_epsilon_bar: f64,
}

impl StepSize {
    /// Gain of the first transition; that of transition t is its (1 + t)^−GAIN_KAPPA-th part.
    const GAIN: f64 = 2.0;
    const GAIN_KAPPA: f64 = 0.6;
    const KAPPA: f64 = 0.75;

    pub(super) fn new(step_size: f64, delta: f64) -> Self {
        let ln_epsilon = step_size.ln();
        Self { delta, t: 0.0, ln_epsilon, ln_epsilon_bar: ln_epsilon }
    }

    /// Learns from the mean acceptance of one transition.
    pub(super) fn update(&mut self, accept: f64) {
        self.t += 1.0;
        let gain = Self::GAIN * (1.0 + self.t).powf(-Self::GAIN_KAPPA);
        self.ln_epsilon += gain * (accept - self.delta);
        let eta = self.t.powf(-Self::KAPPA);
        self.ln_epsilon_bar = eta * self.ln_epsilon + (1.0 - eta) * self.ln_epsilon_bar;
    }

    /// The mean of what some have learnt.
    fn mean(of: &[&Self]) -> Option<Self> {
        let mean = |number: fn(&Self) -> f64| {
            of.iter().map(|one| number(one)).sum::<f64>() / of.len() as f64
        };
        let (t, delta) = (mean(|one| one.t), of.first()?.delta);
        let (ln_epsilon, ln_epsilon_bar) =
            (mean(|one| one.ln_epsilon), mean(|one| one.ln_epsilon_bar));
        Some(Self { delta, t, ln_epsilon, ln_epsilon_bar })
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
    step_size: StepSize,
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
        if is_warm {
            older.fit(&mut kernel.hamiltonian().metric);
        }
        let step_size = StepSize::new(initial_step_size(kernel)?, target_accept);
        Some(Self { kind, target_accept, older, younger, step_size })
    }

    /// One with the mean step size of all of these; `None` of none.
    pub(super) fn together(of: &[Self]) -> Option<Self> {
        let all: Vec<&StepSize> = of.iter().map(|one| &one.step_size).collect();
        Some(Self { step_size: StepSize::mean(&all)?, ..of.first()?.clone() })
    }

    /// Whether it has learnt of `dim` coordinates, for a metric of this kind.
    pub(super) fn fits(&self, dim: usize, kind: MetricKind) -> bool {
        self.kind == kind && self.older.fits(dim, kind) && self.younger.fits(dim, kind)
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
            MetricKind::Diagonal if self.older.n() >= Self::LEAST => {
                self.older.fit(&mut kernel.hamiltonian().metric);
            }
            MetricKind::LowRank if full || is_due(self.older.n()) => self.set_low_rank(kernel),
            _ => {}
        }
        if full {
            std::mem::swap(&mut self.older, &mut self.younger);
            self.younger.clear();
        }
        if warm_up.ends_metric() {
            self.step_size = StepSize::new(self.final_step_size(), self.target_accept);
        }
    }

    /// With new directions the step size that suits the metric is another one, so its adaptation
    /// starts anew.
    fn set_low_rank<E: Evaluator>(&mut self, kernel: &mut Kernel<E>) {
        self.older.fit(&mut kernel.hamiltonian().metric);
        if let Some(step_size) = initial_step_size(kernel) {
            self.step_size = StepSize::new(step_size, self.target_accept);
        }
    }
}

/// Directions cost more than a transition, so they are learnt at some numbers of draws only: 10, 15,
/// 22, …
fn is_due(n: usize) -> bool {
    let mut due = 10;
    while due < n {
        due += due / 2;
    }
    due == n
}

#[cfg(test)]
mod tests {
    use super::super::curvature::conditional_scales;
    use super::super::density::LogDensity;
    use super::super::hamiltonian::{Hamiltonian, Metric};
    use super::super::test_densities::{FnDensity, normal};
    use super::*;
    use crate::num::Moments;
    use rand::{RngExt as _, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn kernel(density: &dyn LogDensity) -> Kernel<Box<dyn Evaluator + '_>> {
        let metric = Metric::diagonal(vec![1.0; density.dim()]);
        let hamiltonian = Hamiltonian::new(density.evaluator(), metric);
        Kernel::new(hamiltonian, &vec![0.1; density.dim()], 10, ChaCha8Rng::seed_from_u64(3))
    }

    #[test]
    fn the_step_size_settles_at_that_of_a_known_acceptance_curve() {
        let mut adapt = StepSize::new(0.2, 0.9);
        for _ in 0..1000 {
            let accept = (-adapt.step_size()).exp();
            adapt.update(accept);
        }
        assert!((adapt.averaged_step_size() + 0.9f64.ln()).abs() < 0.005);
    }

    /// Of chains that tuned theirs to the same curve, each with errors of its own: the variance of a mean of four.
    #[test]
    fn a_step_size_together_varies_less_than_those_of_single_chains() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut one = || {
            let mut adapt = StepSize::new(0.2, 0.9);
            for _ in 0..40 {
                let accept = (-adapt.step_size()).exp() + 0.2 * (rng.random::<f64>() - 0.5);
                adapt.update(accept);
            }
            adapt
        };
        let ln = |adapt: &StepSize| [adapt.averaged_step_size().ln()].into_iter();
        let (mut alone, mut together) = (Moments::new(1), Moments::new(1));
        for _ in 0..300 {
            let chains: [StepSize; 4] = std::array::from_fn(|_| one());
            alone.add(ln(&chains[0]));
            together.add(ln(&StepSize::mean(&chains.each_ref()).unwrap()));
        }
        let ratio = (together.sds()[0] / alone.sds()[0]).powi(2);
        // a variance of 300 numbers is known to 8 %
        assert!((ratio - 0.25).abs() < 4.0 * 0.25 * 0.08 * 2f64.sqrt(), "{ratio}");
        assert!(StepSize::mean(&[]).is_none());
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
            let learnt = DrawMoments::of(&density, draws, MetricKind::Diagonal);
            Adaptation::begin(&mut kernel, MetricKind::Diagonal, 0.9, &learnt).unwrap();
            kernel.hamiltonian().metric.scale.clone()
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
            kernel.hamiltonian().metric = Metric::diagonal(scales);
            initial_step_size(&mut kernel)
        };
        assert!(step_size(scales).is_some());
        assert!(step_size(vec![1e75, 1.0]).is_none(), "the scale that the curvature gives");
    }
}
