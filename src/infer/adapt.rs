//! Warm-up: step size by dual averaging, metric from draws and gradients.
//!
//! Knows the sampler only through [`Nuts`]; nothing of chains, threads or storage.
//!
//! # Source
//! Hoffman & Gelman 2014, section 3.2 (dual averaging, initial step size; the letters are theirs).
//! Seyboldt, Carlson & Carpenter, "Preconditioning Hamiltonian Monte Carlo by minimizing
//! Fisher divergence" (diagonal metric, two overlapping windows).

use super::hamiltonian::Metric;
use super::nuts::{Nuts, Transition};
use super::sample::MetricKind;
use super::{Evaluator, moments::Moments};
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

    /// Starts at `step_size`, leaning towards ten times it: large steps are cheap to try.
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

/// Doubles or halves ε until the acceptance of one leapfrog step crosses 0.8; `None` if no ε does.
pub(super) fn initial_step_size(nuts: &mut Nuts) -> Option<f64> {
    const MAX_DOUBLINGS: u32 = 100;
    let mut step_size = 1.0;
    let growing = nuts.trial_acceptance(step_size) > 0.8;
    for _ in 0..MAX_DOUBLINGS {
        let next = if growing { step_size * 2.0 } else { step_size * 0.5 };
        let accepted = nuts.trial_acceptance(next) > 0.8;
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

/// Conditional standard deviation of every coordinate, (−∂²ln π/∂qᵢ²)^−½ by central differences of
/// the gradient; `missing` where the curvature has the wrong sign.  Costs 2 dim evaluations.
///
/// No scale is larger than a thousand times the coordinate (or 1): where a likelihood has saturated
/// the curvature is next to nothing, or rounding, and no step size would suit the scale it gives.
pub(super) fn conditional_scales(
    evaluator: &mut dyn Evaluator,
    position: &[f64],
    missing: f64,
) -> Vec<f64> {
    const LARGEST: f64 = 1e3;
    let mut moved = position.to_vec();
    let mut gradient = vec![0.0; position.len()];
    let mut scale = |i: usize| {
        let h = 1e-5 * position[i].abs().max(1.0);
        let mut slope_at = |q: f64| {
            moved[i] = q;
            let ln_density = evaluator.ln_density(&moved, &mut gradient);
            moved[i] = position[i];
            if ln_density.is_finite() { gradient[i] } else { f64::NAN }
        };
        let precision = -(slope_at(position[i] + h) - slope_at(position[i] - h)) / (2.0 * h);
        let usable = precision.is_finite() && precision > f64::MIN_POSITIVE;
        let most = LARGEST * position[i].abs().max(1.0);
        if usable { precision.powf(-0.5).min(most) } else { missing }
    };
    (0..position.len()).map(&mut scale).collect()
}

/// The warm-up of one chain: what to learn at each iteration.
///
/// ```text
/// 0 ───── 30 % ──────────────── 85 % ───────── 100 %
///  windows of 10   windows of 80    step size only
/// ```
/// Two windows overlap: the metric comes from the older one, which is dropped for the younger
/// whenever that has filled, so early draws are forgotten and no draw is waited for.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Warmup {
    early_end: usize,
    metric_end: usize,
    kind: MetricKind,
    target_accept: f64,
    older: Moments,
    younger: Moments,
    step_size: DualAveraging,
}

impl Warmup {
    const EARLY_WINDOW: usize = 10;
    const WINDOW: usize = 80;

    /// Sets the chain's first step size, and its first metric where enough is `learnt` before:
    /// then there are no early windows, and a full one must come before that is forgotten.
    /// `None` if no step size works.
    pub(super) fn begin(
        nuts: &mut Nuts,
        kind: MetricKind,
        n: usize,
        target_accept: f64,
        learnt: &Moments,
    ) -> Option<Self> {
        let is_warm = learnt.n() >= Self::WINDOW;
        let mut younger = learnt.clone();
        younger.clear();
        let older = if is_warm { learnt.clone() } else { younger.clone() };
        if let (true, Some(factor)) = (is_warm, older.shrunk_covariance_factor()) {
            nuts.hamiltonian().metric = Metric::Dense(factor);
        } else if let (true, Metric::Diagonal(scale)) = (is_warm, &mut nuts.hamiltonian().metric) {
            older.fisher_scales(scale);
        }
        let step_size = DualAveraging::new(initial_step_size(nuts)?, target_accept);
        Some(Self {
            early_end: if is_warm { 0 } else { n * 3 / 10 },
            metric_end: n * 85 / 100,
            kind,
            target_accept,
            older,
            younger,
            step_size,
        })
    }

    /// ε for the next transition.
    pub(super) fn step_size(&self) -> f64 {
        self.step_size.step_size()
    }

    /// ε for sampling.
    pub(super) fn final_step_size(&self) -> f64 {
        self.step_size.averaged_step_size()
    }

    /// Learns from transition `iteration`.
    pub(super) fn update(&mut self, iteration: usize, nuts: &mut Nuts, transition: &Transition) {
        self.step_size.update(transition.accept);
        if iteration >= self.metric_end {
            return;
        }
        self.older.add(&nuts.point.position, &nuts.point.gradient);
        self.younger.add(&nuts.point.position, &nuts.point.gradient);
        let window = if iteration < self.early_end { Self::EARLY_WINDOW } else { Self::WINDOW };
        let full = self.younger.n() >= window;
        match self.kind {
            MetricKind::Diagonal if self.older.n() >= Self::EARLY_WINDOW => self.set_diagonal(nuts),
            MetricKind::Dense if full => self.set_dense(nuts),
            _ => {}
        }
        if full {
            std::mem::swap(&mut self.older, &mut self.younger);
            self.younger.clear();
        }
        if iteration + 1 == self.metric_end {
            let averaged = self.final_step_size();
            self.step_size = DualAveraging::new(averaged, self.target_accept);
        }
    }

    fn set_diagonal(&self, nuts: &mut Nuts) {
        if let Metric::Diagonal(scale) = &mut nuts.hamiltonian().metric {
            self.older.fisher_scales(scale);
        }
    }

    /// A dense metric moves every ε, so the step size starts anew.
    fn set_dense(&mut self, nuts: &mut Nuts) {
        if let Some(factor) = self.older.shrunk_covariance_factor() {
            nuts.hamiltonian().metric = Metric::Dense(factor);
            if let Some(step_size) = initial_step_size(nuts) {
                self.step_size = DualAveraging::new(step_size, self.target_accept);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::LogDensity;
    use super::super::hamiltonian::Hamiltonian;
    use super::super::test_densities::{FnDensity, normal};
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn nuts(density: &dyn LogDensity) -> Nuts<'_> {
        let metric = Metric::Diagonal(vec![1.0; density.dim()]);
        let hamiltonian = Hamiltonian::new(density.evaluator(), metric);
        Nuts::new(hamiltonian, &vec![0.1; density.dim()], 10, ChaCha8Rng::seed_from_u64(3))
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
        let large = initial_step_size(&mut nuts(&normal(vec![1e3; 5]))).unwrap();
        let small = initial_step_size(&mut nuts(&normal(vec![1e-3; 5]))).unwrap();
        assert!((5e4..5e7).contains(&(large / small)), "{large} {small}");
        let nowhere = FnDensity { dim: 2, f: |_: &[f64], _: &mut [f64]| f64::NAN };
        assert!(initial_step_size(&mut nuts(&nowhere)).is_none());
    }

    #[test]
    fn initial_step_size_stays_on_this_side_of_an_undefined_region() {
        // Flat, so that every step inside is accepted, and NaN beyond.
        let f = |q: &[f64], g: &mut [f64]| {
            g[0] = 0.0;
            if q[0].abs() > 100.0 { f64::NAN } else { 0.0 }
        };
        let step_size = initial_step_size(&mut nuts(&FnDensity { dim: 1, f })).unwrap();
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
            let mut nuts = nuts(&density);
            let learnt = Moments::of(&density, draws, false);
            Warmup::begin(&mut nuts, MetricKind::Diagonal, 100, 0.9, &learnt).unwrap();
            let Metric::Diagonal(scales) = nuts.hamiltonian().metric.clone() else { panic!() };
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
            let mut nuts = nuts(&density);
            nuts.hamiltonian().metric = Metric::Diagonal(scales);
            initial_step_size(&mut nuts)
        };
        assert!(step_size(scales).is_some());
        assert!(step_size(vec![1e75, 1.0]).is_none(), "the scale that the curvature gives");
    }
}
