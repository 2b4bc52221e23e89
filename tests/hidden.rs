//! Mixtures, hidden states and hierarchies against quadrature by other algorithms.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "models/hidden.rs"]
mod models;
mod support;

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_distr::StandardNormal;
use support::oracle::{draws, grid_moments, worst_error};
use support::{rng, table};

/// Largest error in Monte Carlo standard errors.
const LIMIT: f64 = 4.5;

/// Agrees with these moments, and not with deviations wrong by a tenth.
fn assert_agrees(draws: &[Vec<Vec<f64>>], (mean, sd): (Vec<f64>, Vec<f64>)) {
    let error = worst_error(draws, &mean, &sd);
    assert!(error < LIMIT, "{error} Monte Carlo standard errors of {mean:?}, {sd:?}");
    let wider: Vec<f64> = sd.iter().map(|sd| 1.1 * sd).collect();
    let broken = worst_error(draws, &mean, &wider);
    assert!(broken > LIMIT, "deviations wrong by a tenth go unseen: {broken}");
}

fn column(y: &[f64]) -> eplat::table::Measurements {
    table("y", &y.iter().map(f64::to_string).collect::<Vec<_>>())
}

fn bell(y: f64, mu: f64, sd: f64) -> f64 {
    (-0.5 * ((y - mu) / sd).powi(2)).exp() / sd
}

#[test]
fn two_groups_of_unknown_members_agree_with_a_grid() {
    let mut rng = rng(31);
    let y: Vec<f64> = (0..60)
        .map(|i| if i < 25 { -2.5 } else { 2.5 } + rng.sample::<f64, _>(StandardNormal))
        .collect();
    // mu[1] = mu[0] + e^q[1]; sigma = e^q[2]
    let point = |q: &[f64]| {
        let (mu, sigma, theta) = ([q[0], q[0] + q[1].exp()], q[2].exp(), q[3]);
        let of = |y: &f64| theta * bell(*y, mu[0], sigma) + (1.0 - theta) * bell(*y, mu[1], sigma);
        let prior = -(mu[0] * mu[0] + mu[1] * mu[1] + sigma * sigma) / 8.0
            + 4.0 * (theta * (1.0 - theta)).ln();
        let likelihood: f64 = y.iter().map(|y| of(y).ln()).sum();
        (vec![mu[0], mu[1], sigma, theta], prior + q[1] + q[2] + likelihood)
    };
    let exact = grid_moments(&[(-4.2, -0.4), (0.9, 2.1), (-0.6, 0.9), (0.05, 0.85)], 28, point);
    assert_agrees(&draws(&models::mixture::TwoGroups, None, &column(&y), 1500), exact);
}

#[test]
fn hidden_states_agree_with_a_grid() {
    let mut rng = rng(32);
    let mut state = 0;
    let y: Vec<f64> = (0..50)
        .map(|_| {
            let stays = rng.random::<f64>() < [0.75, 0.6][state];
            state = if stays { state } else { 1 - state };
            [3.0, 6.0][state] + rng.sample::<f64, _>(StandardNormal)
        })
        .collect();
    // probabilities themselves, scaled at each step: not the model's own arithmetic
    let point = |q: &[f64]| {
        let (stay, mu) = ([q[0], q[1]], [q[2], q[2] + q[3].exp()]);
        let (mut p, mut ln_p) = ([0.5, 0.5], 0.0);
        for (t, y) in y.iter().enumerate() {
            if t > 0 {
                p = [
                    p[0] * stay[0] + p[1] * (1.0 - stay[1]),
                    p[1] * stay[1] + p[0] * (1.0 - stay[0]),
                ];
            }
            p = [p[0] * bell(*y, mu[0], 1.0), p[1] * bell(*y, mu[1], 1.0)];
            let total = p[0] + p[1];
            p = p.map(|p| p / total);
            ln_p += total.ln();
        }
        for stay in stay {
            ln_p += 3.0 * stay.ln() + (1.0 - stay).ln();
        }
        ln_p -= ((mu[0] - 5.0).powi(2) + (mu[1] - 5.0).powi(2)) / 32.0;
        (vec![stay[0], stay[1], mu[0], mu[1]], ln_p + q[3])
    };
    let exact = grid_moments(&[(0.0, 1.0), (0.0, 1.0), (1.5, 4.5), (0.0, 1.8)], 30, point);
    assert_agrees(&draws(&models::markov::HiddenMarkov, None, &column(&y), 1500), exact);
}

#[test]
fn counties_about_a_common_mean_agree_with_a_grid_over_both_spreads() {
    const COUNTIES: usize = 8;
    let mut rng = rng(33);
    let mut rows = vec![];
    for county in 0..COUNTIES {
        let alpha = 1.5 + 0.8 * rng.sample::<f64, _>(StandardNormal);
        for i in 0..4 + county {
            let floor = f64::from(u8::from(i % 3 == 0));
            let y: f64 = alpha - 0.7 * floor + 0.6 * rng.sample::<f64, _>(StandardNormal);
            rows.push((county, floor, y));
        }
    }
    // mu, beta and the alphas are normal given tau and sigma: precision P, P × mean = m
    let n = COUNTIES + 2;
    let point = |q: &[f64]| {
        let (tau, sigma) = (q[0].exp(), q[1].exp());
        let (mut p, mut m) = (DMatrix::zeros(n, n), DVector::zeros(n));
        let mut squares = 0.0;
        for &(county, floor, y) in &rows {
            let mut x = DVector::zeros(n);
            (x[1], x[2 + county]) = (floor, 1.0);
            p += &x * x.transpose() / (sigma * sigma);
            m += x * (y / (sigma * sigma));
            squares += y * y / (sigma * sigma);
        }
        for county in 0..COUNTIES {
            let mut x = DVector::zeros(n);
            (x[0], x[2 + county]) = (1.0, -1.0);
            p += &x * x.transpose() / (tau * tau);
        }
        let factor = p.cholesky().unwrap();
        let (mean, covariance) = (factor.solve(&m), factor.inverse());
        let half_ln_det: f64 = factor.l().diagonal().iter().map(|d| d.ln()).sum();
        let ln_p = 0.5 * (m.dot(&mean) - squares)
            - half_ln_det
            - rows.len() as f64 * q[1]
            - COUNTIES as f64 * q[0]
            - (tau * tau + sigma * sigma) / 8.0
            + q[0]
            + q[1];
        let mut values = vec![tau, sigma];
        values.extend(mean.iter());
        values.extend((0..n).map(|i| mean[i] * mean[i] + covariance[(i, i)]));
        (values, ln_p)
    };
    let (mean, sd) = grid_moments(&[(-3.0, 1.6), (-1.4, 0.3)], 120, point);
    let total = |i: usize| (mean[2 + n + i] - mean[2 + i].powi(2)).sqrt();
    // in the model's order: mu, tau, alpha, beta, sigma
    let order: Vec<usize> = (0..COUNTIES).map(|county| 2 + county).collect();
    let pick = |of: &dyn Fn(usize) -> f64, spread: [f64; 2]| {
        let alphas = order.iter().map(|i| of(*i));
        [of(0), spread[0]].into_iter().chain(alphas).chain([of(1), spread[1]]).collect::<Vec<_>>()
    };
    let exact = (pick(&|i| mean[2 + i], [mean[0], mean[1]]), pick(&total, [sd[0], sd[1]]));
    let lines: Vec<String> =
        rows.iter().map(|(county, floor, y)| format!("c{county},{floor},{y}")).collect();
    let data = table("county,floor,log_radon", &lines);
    assert_agrees(&draws(&models::radon::Radon, None, &data, 2500), exact);
}
