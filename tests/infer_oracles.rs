//! The whole sampler, warm-up included, against densities whose moments are known exactly.
//!
//! Errors are measured in Monte Carlo standard errors from the measured effective sample size; the
//! limit is Bonferroni-corrected to 0.1 % over all moments of a test.  Broken twins must fail.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test binary")]

use eplat::diagnostics::{e_bfmi, ess_mean, mcse_mean, mean_and_sd, summarise};
use eplat::infer::{
    Chain, Evaluator, LogDensity, MetricKind, Settings, Silent, jittered_starts, sample,
};

/// A density given by a function of (position, gradient).
struct Density<F> {
    dim: usize,
    f: F,
}

impl<F: Fn(&[f64], &mut [f64]) -> f64 + Sync> LogDensity for Density<F> {
    fn dim(&self) -> usize {
        self.dim
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        Box::new(Evaluate(&self.f))
    }
}

struct Evaluate<'a, F>(&'a F);

impl<F: Fn(&[f64], &mut [f64]) -> f64 + Sync> Evaluator for Evaluate<'_, F> {
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        (self.0)(position, gradient)
    }
}

fn run(density: &dyn LogDensity, initial: &[f64], settings: &Settings) -> Vec<Chain> {
    let starts = jittered_starts(density, initial, settings.chains, settings.seed).unwrap();
    let chains = sample(density, &starts, settings, &Silent).unwrap();
    chains.into_iter().map(Result::unwrap).collect()
}

/// A function of the position, per chain.
fn quantity(chains: &[Chain], of: impl Fn(&[f64]) -> f64) -> Vec<Vec<f64>> {
    let values =
        |chain: &Chain| (0..chain.n_draws()).map(|i| of(&chain.draw(i).unwrap())).collect();
    chains.iter().map(values).collect()
}

/// |mean − expected| in Monte Carlo standard errors.
fn z_score(chains: &[Chain], expected: f64, of: impl Fn(&[f64]) -> f64) -> f64 {
    let values = quantity(chains, of);
    let values: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
    (summarise(&values).mean - expected).abs() / mcse_mean(&values)
}

/// The two-sided normal limit for `n` scores at 0.1 % in all: 2 Φ(−z) ≤ exp(−z²/2).
fn limit(n: usize) -> f64 {
    (2.0 * (n as f64 / 0.001).ln()).sqrt()
}

fn worst_r_hat(chains: &[Chain], dim: usize) -> f64 {
    let of = |i: usize| {
        let values = quantity(chains, |q| q[i]);
        summarise(&values.iter().map(Vec::as_slice).collect::<Vec<_>>()).r_hat
    };
    (0..dim).map(of).fold(0.0, f64::max)
}

/// Largest score over the first and second moments of independent normals with these sds.
fn worst_normal_score(chains: &[Chain], sd: &[f64]) -> f64 {
    let score = |(i, sd): (usize, &f64)| {
        z_score(chains, 0.0, |q| q[i]).max(z_score(chains, sd * sd, |q| q[i] * q[i]))
    };
    sd.iter().enumerate().map(score).fold(0.0, f64::max)
}

/// Independent normals whose gradient is off by this factor.
fn normal(sd: Vec<f64>, gradient_factor: f64) -> impl LogDensity {
    let dim = sd.len();
    let f = move |q: &[f64], g: &mut [f64]| {
        let mut ln_density = 0.0;
        for ((q, g), sd) in q.iter().zip(g).zip(&sd) {
            *g = -gradient_factor * q / (sd * sd);
            ln_density -= 0.5 * (q / sd).powi(2);
        }
        ln_density
    };
    Density { dim, f }
}

/// Largest score of one moment over all coordinates, which are exchangeable, so that the exact sd of
/// `of` and the mean effective sample size give a sharper standard error than each one's own.
fn worst_pooled_score(
    chains: &[Chain],
    dim: usize,
    [mean, sd]: [f64; 2],
    of: fn(f64) -> f64,
) -> f64 {
    let figures = |i: usize| {
        let values = quantity(chains, |q| of(q[i]));
        let values: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
        ((mean_and_sd(&values).0 - mean).abs(), ess_mean(&values))
    };
    let (errors, ess): (Vec<f64>, Vec<f64>) = (0..dim).map(figures).unzip();
    let ess = ess.iter().sum::<f64>() / dim as f64;
    errors.into_iter().fold(0.0, f64::max) * ess.sqrt() / sd
}

#[test]
fn independent_normal_in_250_dimensions() {
    let settings = Settings { warmup: 500, target_accept: Some(0.8), ..Settings::default() };
    let chains = run(&normal(vec![1.0; 250], 1.0), &[0.5; 250], &settings);
    let of_mean = worst_pooled_score(&chains, 250, [0.0, 1.0], |x| x);
    let of_variance = worst_pooled_score(&chains, 250, [1.0, 2f64.sqrt()], |x| x * x);
    assert!(of_mean < limit(500) && of_variance < limit(500), "{of_mean} {of_variance}");
    assert!(worst_r_hat(&chains, 250) < 1.01);
}

#[test]
fn normal_with_scales_over_six_decades() {
    let sd: Vec<f64> = (0..13).map(|i| 10f64.powf(f64::from(i) / 2.0 - 3.0)).collect();
    let settings = Settings { warmup: 500, ..Settings::default() };
    let chains = run(&normal(sd.clone(), 1.0), &[0.1; 13], &settings);
    let worst = worst_normal_score(&chains, &sd);
    assert!(worst < limit(26), "{worst}");
    // The metric makes it isotropic: short trajectories.
    assert!(chains.iter().all(|chain| chain.n_leapfrog.iter().all(|&n| n < 32)));
}

#[test]
fn energies_decide_so_a_wrong_gradient_costs_speed_and_a_wrong_density_fails() {
    // Any force that depends on position alone keeps the leapfrog reversible and volume-preserving.
    let settings = Settings { warmup: 500, draws: 2000, ..Settings::default() };
    let chains = run(&normal(vec![1.0; 5], 1.2), &[0.5; 5], &settings);
    let worst = worst_normal_score(&chains, &[1.0; 5]);
    assert!(worst < limit(10), "{worst}");
    let chains = run(&normal(vec![1.2; 5], 1.0), &[0.5; 5], &settings);
    assert!(worst_normal_score(&chains, &[1.0; 5]) > 2.0 * limit(10));
}

/// Five pairs with variances 1 and correlation ρ: condition (1 + ρ)/(1 − ρ).
fn correlated_pairs(rho: f64) -> impl LogDensity {
    let f = move |q: &[f64], g: &mut [f64]| {
        let precision = 1.0 / (1.0 - rho * rho);
        let mut ln_density = 0.0;
        for (q, g) in q.chunks_exact(2).zip(g.chunks_exact_mut(2)) {
            g[0] = -precision * (q[0] - rho * q[1]);
            g[1] = -precision * (q[1] - rho * q[0]);
            ln_density += 0.5 * (q[0] * g[0] + q[1] * g[1]);
        }
        ln_density
    };
    Density { dim: 10, f }
}

#[test]
fn correlated_normal_of_condition_ten_thousand_under_both_metrics() {
    let rho = 1.0 - 2e-4;
    let mut leapfrogs = Vec::new();
    for metric in [MetricKind::Diagonal, MetricKind::LowRank] {
        let settings = Settings { metric, ..Settings::default() };
        let chains = run(&correlated_pairs(rho), &[0.3; 10], &settings);
        let mut worst = worst_normal_score(&chains, &[1.0; 10]);
        for pair in 0..5 {
            worst = worst.max(z_score(&chains, rho, |q| q[2 * pair] * q[2 * pair + 1]));
            let narrow = |q: &[f64]| (q[2 * pair] - q[2 * pair + 1]).powi(2);
            worst = worst.max(z_score(&chains, 2.0 * (1.0 - rho), narrow));
        }
        assert!(worst < limit(30), "{metric:?} {worst}");
        leapfrogs.push(chains.iter().map(|chain| chain.n_grad_sampling).sum::<u64>());
    }
    println!("leapfrogs: diagonal {}, low-rank {}", leapfrogs[0], leapfrogs[1]);
    assert!(leapfrogs[1] * 3 < leapfrogs[0], "the low-rank metric must pay: {leapfrogs:?}");
}

/// Unit vectors, whose reflections turn the axes.
fn mirrors(dim: usize) -> Vec<Vec<f64>> {
    let mirror = |k: usize| {
        let v: Vec<f64> = (0..dim).map(|i| ((i * i + 3 * k * i + k) as f64).sin()).collect();
        let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        v.into_iter().map(|x| x / norm).collect()
    };
    (1..=6).map(mirror).collect()
}

fn reflect(mirror: &[f64], x: &mut [f64]) {
    let along: f64 = mirror.iter().zip(&*x).map(|(m, x)| m * x).sum();
    mirror.iter().zip(x).for_each(|(m, x)| *x -= 2.0 * along * m);
}

/// A normal with these variances along turned axes.
fn turned_normal<'a>(variances: &'a [f64], mirrors: &'a [Vec<f64>]) -> impl LogDensity + 'a {
    let f = move |q: &[f64], g: &mut [f64]| {
        g.copy_from_slice(q);
        for mirror in mirrors {
            reflect(mirror, g);
        }
        let ln_density = g.iter().zip(variances).map(|(y, v)| -0.5 * y * y / v).sum();
        g.iter_mut().zip(variances).for_each(|(y, v)| *y /= -v);
        // reflections undo themselves, the last one first
        for mirror in mirrors.iter().rev() {
            reflect(mirror, g);
        }
        ln_density
    };
    Density { dim: variances.len(), f }
}

#[test]
fn a_turned_normal_of_condition_a_million_in_250_dimensions() {
    let variances: Vec<f64> = (0..250).map(|i| 10f64.powf(6.0 * f64::from(i) / 249.0)).collect();
    let mirrors = mirrors(250);
    let settings = Settings { draws: 500, ..Settings::default() };
    let chains = run(&turned_normal(&variances, &mirrors), &[0.3; 250], &settings);
    let gradients: u64 = chains.iter().map(|c| c.n_grad_warmup + c.n_grad_sampling).sum();
    println!("{gradients} gradients");
    assert!(gradients < 1_000_000, "{gradients}");
    let ends = [0, 1, 60, 125, 190, 248, 249];
    let square = |i: usize, q: &[f64]| {
        let mut y = q.to_vec();
        for mirror in &mirrors {
            reflect(mirror, &mut y);
        }
        y[i] * y[i]
    };
    let scores = ends.map(|i| z_score(&chains, variances[i], |q| square(i, q)));
    let worst = scores.into_iter().fold(0.0, f64::max);
    assert!(worst < limit(ends.len()), "{worst}");
    let broken = z_score(&chains, 1.5 * variances[60], |q| square(60, q));
    assert!(broken > limit(1), "a variance wrong by a half goes unseen: {broken}");
}

/// Known data, unknown mean μ and ln σ, prior p(μ, σ²) ∝ 1/σ²: σ² ~ InvGamma((n − 1)/2, S/2).
fn normal_model(data: &[f64], with_jacobian: bool) -> impl LogDensity {
    let f = move |q: &[f64], g: &mut [f64]| {
        let (mu, ln_sigma) = (q[0], q[1]);
        let precision = (-2.0 * ln_sigma).exp();
        let n = data.len() as f64;
        let squares: f64 = data.iter().map(|y| (y - mu).powi(2)).sum();
        // d σ² = 2 σ² d ln σ cancels the prior's 1/σ².
        let prior = if with_jacobian { 0.0 } else { -2.0 };
        g[0] = precision * data.iter().map(|y| y - mu).sum::<f64>();
        g[1] = -n + precision * squares + prior;
        (prior - n) * ln_sigma - 0.5 * precision * squares
    };
    Density { dim: 2, f }
}

#[test]
fn conjugate_normal_model_has_its_exact_posterior() {
    let data = [4.1, 5.3, 2.2, 6.8, 5.0, 3.9, 4.4, 7.1, 5.6, 2.9, 4.8, 5.2];
    let n = data.len() as f64;
    let mean = data.iter().sum::<f64>() / n;
    let squares: f64 = data.iter().map(|y| (y - mean).powi(2)).sum();
    let (shape, scale) = (0.5 * (n - 1.0), 0.5 * squares);
    let variance = scale / (shape - 1.0);
    let worst = |with_jacobian| {
        let settings = Settings { draws: 4000, ..Settings::default() };
        let chains = run(&normal_model(&data, with_jacobian), &[4.0, 0.0], &settings);
        [
            z_score(&chains, mean, |q| q[0]),
            z_score(&chains, variance / n, |q| (q[0] - mean).powi(2)),
            z_score(&chains, variance, |q| (2.0 * q[1]).exp()),
            z_score(&chains, shape / scale, |q| (-2.0 * q[1]).exp()),
        ]
        .into_iter()
        .fold(0.0, f64::max)
    };
    let (right, twin) = (worst(true), worst(false));
    assert!(right < limit(4), "{right}");
    assert!(twin > 2.0 * limit(4), "dropped Jacobian: {twin}");
}

#[test]
fn banana_has_its_exact_moments() {
    // x ~ N(0, 1), y | x ~ N(x² − 1, ½).
    let f = |q: &[f64], g: &mut [f64]| {
        let z = (q[1] - q[0] * q[0] + 1.0) / 0.5;
        g[1] = -z / 0.5;
        g[0] = -q[0] - 2.0 * q[0] * g[1];
        -0.5 * (q[0] * q[0] + z * z)
    };
    let settings = Settings { draws: 4000, ..Settings::default() };
    let chains = run(&Density { dim: 2, f }, &[0.5, 0.5], &settings);
    let scores = [
        z_score(&chains, 0.0, |q| q[0]),
        z_score(&chains, 0.0, |q| q[1]),
        z_score(&chains, 1.0, |q| q[0] * q[0]),
        z_score(&chains, 2.25, |q| q[1] * q[1]),
        z_score(&chains, 0.0, |q| q[0] * q[1]),
        z_score(&chains, 2.0, |q| q[0] * q[0] * q[1]),
    ];
    assert!(scores.iter().all(|&z| z < limit(6)), "{scores:?}");
}

#[test]
fn the_funnel_fails_loudly() {
    // Neal's: v ~ N(0, 3), nine x | v ~ N(0, exp(v/2)).
    let f = |q: &[f64], g: &mut [f64]| {
        let precision = (-q[0]).exp();
        let squares: f64 = q[1..].iter().map(|x| x * x).sum();
        g[0] = -q[0] / 9.0 - 4.5 + 0.5 * precision * squares;
        g[1..].iter_mut().zip(&q[1..]).for_each(|(g, x)| *g = -precision * x);
        -q[0] * q[0] / 18.0 - 4.5 * q[0] - 0.5 * precision * squares
    };
    let settings = Settings { target_accept: Some(0.8), ..Settings::default() };
    let chains = run(&Density { dim: 10, f }, &[0.5; 10], &settings);
    let divergences: usize = chains.iter().map(|chain| chain.divergences.len()).sum();
    let e_bfmi = chains.iter().map(|chain| e_bfmi(&chain.energy)).fold(f64::INFINITY, f64::min);
    let r_hat = worst_r_hat(&chains, 10);
    println!("funnel: divergences {divergences}, E-BFMI {e_bfmi:.2}, R̂ {r_hat:.3}");
    assert!(e_bfmi < 0.3 && r_hat > 1.01, "divergences {divergences}, {e_bfmi}, {r_hat}");
}
