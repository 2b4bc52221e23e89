//! Models without fields against posteriors known from closed forms or from quadrature on a grid.
//!
//! Means and standard deviations must agree within 4.5 Monte Carlo standard errors of the run; each
//! test sees that deviations wrong by a tenth are refused.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "models/posteriors.rs"]
mod models;
#[path = "support/shipped.rs"]
mod shipped;
mod support;

use eplat::model::{Declare, Model};
use eplat::table::Measurements;
use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_distr::StandardNormal;
use shipped::shipped;
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

/// Coefficients of `x` and standard deviation of the noise in `y`, all flat.
///
/// The variance is InvGamma((n − k − 1)/2, RSS/2); the coefficients have its mean times (XᵀX)⁻¹.
fn least_squares(x: &DMatrix<f64>, y: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let y = DVector::from_row_slice(y);
    let inverse = (x.transpose() * x).try_inverse().unwrap();
    let coefficients = &inverse * (x.transpose() * &y);
    let (a, b) = (
        ((x.nrows() - x.ncols()) as f64 - 1.0) / 2.0,
        (&y - x * &coefficients).norm_squared() / 2.0,
    );
    let variance = b / (a - 1.0);
    let sigma = b.sqrt() * (libm::lgamma(a - 0.5) - libm::lgamma(a)).exp();
    let mut mean: Vec<f64> = coefficients.iter().copied().collect();
    let mut sd: Vec<f64> = inverse.diagonal().iter().map(|d| (d * variance).sqrt()).collect();
    mean.push(sigma);
    sd.push((variance - sigma * sigma).sqrt());
    (mean, sd)
}

fn column(name: &str, values: &[f64]) -> Measurements {
    table(name, &values.iter().map(f64::to_string).collect::<Vec<_>>())
}

#[test]
fn an_autoregression_is_least_squares_on_its_own_past() {
    let mut rng = rng(21);
    let mut y = vec![0.3, -0.2];
    for t in 2..82 {
        let noise: f64 = rng.sample(StandardNormal);
        y.push(0.2 + 0.6 * y[t - 1] - 0.3 * y[t - 2] + 0.7 * noise);
    }
    let x = DMatrix::from_fn(80, 3, |i, k| if k == 0 { 1.0 } else { y[i + 2 - k] });
    let drawn = draws(&models::autoregression::Autoregression, None, &column("y", &y), 1500);
    assert_agrees(&drawn, least_squares(&x, &y[2..]));
}

#[test]
fn a_regression_on_thirty_columns_is_least_squares() {
    let mut rng = rng(22);
    let x =
        DMatrix::from_fn(120, 31, |_, k| if k == 0 { 1.0 } else { rng.random_range(-1.0..1.0) });
    let noise = |rng: &mut rand_chacha::ChaCha8Rng| rng.sample::<f64, _>(StandardNormal);
    let y: Vec<f64> =
        (0..120).map(|i| 2.0 * x[(i, 1)] - x[(i, 7)] + 1.5 * noise(&mut rng)).collect();
    let header = (1..=30).map(|k| format!("x{k}")).collect::<Vec<_>>().join(",") + ",y";
    let line = |i: usize| {
        let cells: Vec<String> = (1..31).map(|k| x[(i, k)].to_string()).collect();
        format!("{},{}", cells.join(","), y[i])
    };
    let data = table(&header, &(0..120).map(line).collect::<Vec<_>>());
    assert_agrees(&draws(&models::thirty::Thirty, None, &data, 1500), least_squares(&x, &y));
}

/// The broken twin of `garch.rs`: a normalised prior of beta1 is not flat over the triangle.
mod not_flat {
    use eplat::prelude::*;
    model! {
        model NotFlat;
        column y;
        param mu ~ Flat;
        param alpha0 ~ FlatPositive;
        param alpha1 ~ Uniform(0.0, 1.0);
        param beta1 ~ Uniform(0.0, -alpha1 + 1.0);
        density series(data) = super::by_squares(mu, alpha0, alpha1, beta1, data.y);
    }
}

/// GARCH(1, 1) once more, by squares alone and generic only for the twin.
fn by_squares<D: eplat::num::Real>(mu: D, alpha0: D, alpha1: D, beta1: D, y: &[f64]) -> D {
    let (mut variance, mut ln_p) = (D::from(0.25), D::from(0.0));
    for y in y {
        let square = (mu - *y) * (mu - *y);
        ln_p -= (variance.ln() + square / variance) * 0.5;
        variance = alpha0 + alpha1 * square + beta1 * variance;
    }
    ln_p
}

#[test]
fn a_garch_series_agrees_with_a_grid_over_its_four_parameters() {
    let mut rng = rng(23);
    let (mut y, mut variance) = (vec![], 0.25f64);
    for _ in 0..150 {
        let deviation = variance.sqrt() * rng.sample::<f64, _>(StandardNormal);
        y.push(5.0 + deviation);
        variance = 1.5 + 0.5 * deviation * deviation + 0.3 * variance;
    }
    // beta1 = (1 − alpha1) b keeps the triangle's edge on the grid's; alpha0 = e^a
    let point = |q: &[f64]| {
        let (alpha0, beta1) = (q[1].exp(), (1.0 - q[2]) * q[3]);
        let ln_p = by_squares(q[0], alpha0, q[2], beta1, &y) + q[1] + (1.0 - q[2]).ln();
        (vec![q[0], alpha0, q[2], beta1], ln_p)
    };
    let sides = [(4.2, 5.8), (-1.6, 2.2), (0.0, 1.0), (0.0, 1.0)];
    let (mean, sd) = grid_moments(&sides, 28, point);
    let data = column("y", &y);
    let twin = worst_error(&draws(&not_flat::NotFlat, None, &data, 1500), &mean, &sd);
    assert!(twin > 2.0 * LIMIT, "a prior that is not flat goes unseen: {twin}");
    assert_agrees(&draws(shipped("garch"), None, &data, 1500), (mean, sd));
}

#[test]
fn a_gaussian_process_agrees_with_a_grid_over_its_three_parameters() {
    let mut rng = rng(24);
    let x: Vec<f64> = (0..11).map(|i| 2.0 * f64::from(i) - 10.0).collect();
    let y: Vec<f64> = x
        .iter()
        .map(|x| 2.0 * (x / 4.0).sin() + 0.5 * rng.sample::<f64, _>(StandardNormal))
        .collect();
    let values = DVector::from_row_slice(&y);
    // logarithms of rho, alpha, sigma; their priors with the Jacobian
    let point = |q: &[f64]| {
        let [rho, alpha, sigma] = [q[0].exp(), q[1].exp(), q[2].exp()];
        let covariance = DMatrix::from_fn(11, 11, |i, j| {
            let noise = if i == j { sigma * sigma } else { 0.0 };
            alpha * alpha * (-0.5 * ((x[i] - x[j]) / rho).powi(2)).exp() + noise
        });
        let factor = covariance.cholesky().unwrap();
        let half_ln_det: f64 = factor.l().diagonal().iter().map(|d| d.ln()).sum();
        let ln_p = -0.5 * values.dot(&factor.solve(&values)) - half_ln_det;
        let prior =
            25.0 * q[0] - 4.0 * rho - alpha * alpha / 8.0 + q[1] - sigma * sigma / 2.0 + q[2];
        (vec![rho, alpha, sigma], ln_p + prior)
    };
    let exact = grid_moments(&[(0.4, 3.0), (-2.5, 2.5), (-4.0, 1.8)], 40, point);
    let row = |i: usize| format!("{},{}", x[i], y[i]);
    let data = table("x,y", &(0..11).map(row).collect::<Vec<_>>());
    assert_agrees(&draws(&models::curve::Curve, None, &data, 1500), exact);
}

/// A reading in the noise counts by its probability, Φ((floor − level)/noise), whatever is written there.
#[test]
fn censored_voltages_of_two_catheters_agree_with_a_grid() {
    const FLOOR: f64 = 0.1;
    const N: usize = 40;
    let mut rng = rng(31);
    let noise = [0.05, 0.15];
    let mut reading = |i: usize| {
        let y = 0.12 + noise[i % 2] * rng.sample::<f64, _>(StandardNormal);
        if y > FLOOR { y } else { 0.05 * (i % 3) as f64 }
    };
    let y: Vec<f64> = (0..2 * N).map(&mut reading).collect();
    let n_low = y.iter().filter(|y| **y <= FLOOR).count();
    assert!((25..45).contains(&n_low), "{n_low} of 80 in the noise");
    let point = |q: &[f64]| {
        let ln_row = |(i, y): (usize, &f64)| {
            let (level, sd) = (q[0], q[1 + i % 2]);
            if *y > FLOOR {
                -0.5 * ((y - level) / sd).powi(2) - sd.ln()
            } else {
                (0.5 * libm::erfc((level - FLOOR) / sd * std::f64::consts::FRAC_1_SQRT_2)).ln()
            }
        };
        let prior = -0.5 * ((q[0] / 2.0).powi(2) + q[1] * q[1] + q[2] * q[2]);
        (q.to_vec(), prior + y.iter().enumerate().map(ln_row).sum::<f64>())
    };
    let exact = grid_moments(&[(0.06, 0.18), (0.02, 0.12), (0.06, 0.36)], 48, point);
    let row = |i: usize| format!("{},{}", y[i], ["lasso", "grid"][i % 2]);
    let data = table("bipolar,catheter", &(0..2 * N).map(row).collect::<Vec<_>>());
    let twin = draws(&models::uncensored::Uncensored, None, &data, 1500);
    let twin = worst_error(&twin, &exact.0, &exact.1);
    assert!(twin > 5.0 * LIMIT, "readings in the noise taken as they stand go unseen: {twin}");
    assert_agrees(&draws(&models::censored::CensoredVoltage, None, &data, 1500), exact);
}

/// Concentrations by the midpoint rule in fine steps.
fn concentrations([k_a, k_m, v_m]: [f64; 3], time: &[f64]) -> Vec<f64> {
    const STEP: f64 = 0.0125;
    let slope = |t: f64, c: f64| 15.0 * k_a * (-k_a * t).exp() - 0.5 * v_m * c / (k_m + c);
    let (mut t, mut c, mut out) = (0.0, 0.0, vec![]);
    for end in time {
        while t < end - 0.5 * STEP {
            let half = c + 0.5 * STEP * slope(t, c);
            c += STEP * slope(t + 0.5 * STEP, half);
            t += STEP;
        }
        out.push(c);
    }
    out
}

#[test]
fn a_compartment_agrees_with_a_grid_over_its_four_parameters() {
    let mut rng = rng(25);
    let time: Vec<f64> = (1..=20).map(|i| 0.5 * f64::from(i)).collect();
    let seen: Vec<f64> = concentrations([0.75, 0.25, 1.0], &time)
        .iter()
        .map(|c| c * (0.1 * rng.sample::<f64, _>(StandardNormal)).exp())
        .collect();
    let cauchy = |ln_x: f64| ln_x - (2.0 * ln_x).exp().ln_1p();
    // logarithms of k_a, k_m and v_m/(k_m + 10), which is what is seen; sigma is summed over
    let point = |q: &[f64]| {
        let ln_v_m = q[2] + (q[1].exp() + 10.0).ln();
        let c = concentrations([q[0].exp(), q[1].exp(), ln_v_m.exp()], &time);
        let rss: f64 = seen.iter().zip(&c).map(|(seen, c)| (seen / c).ln().powi(2)).sum();
        let of_sigma = |i: i32| {
            let ln_sigma = -3.2 + 0.04 * f64::from(i);
            let ln_p = -20.0 * ln_sigma - 0.5 * rss * (-2.0 * ln_sigma).exp();
            (ln_sigma, (ln_p - 40.0 + cauchy(ln_sigma)).exp())
        };
        let sums = (0..60)
            .map(of_sigma)
            .fold([0.0; 3], |s, (x, p)| [s[0] + p, s[1] + p * x, s[2] + p * x * x]);
        let ln_p = sums[0].ln() + cauchy(q[0]) + cauchy(q[1]) + cauchy(ln_v_m);
        (vec![q[0], q[1], ln_v_m, sums[1] / sums[0], sums[2] / sums[0]], ln_p)
    };
    let (mut mean, mut sd) = grid_moments(&[(-1.0, 0.4), (-9.0, 6.0), (-4.0, -1.0)], 44, point);
    // of ln sigma: its mean square given the others stood in the last place
    sd[3] = (mean[4] - mean[3] * mean[3]).sqrt();
    mean.pop();
    sd.pop();
    let row = |(t, c): (&f64, &f64)| format!("{t},{c}");
    let data = table("time,concentration", &time.iter().zip(&seen).map(row).collect::<Vec<_>>());
    // heavy tails: logarithms have moments that draws can tell
    let mut drawn = draws(shipped("one_compartment"), None, &data, 2500);
    drawn.iter_mut().flatten().flatten().for_each(|x| *x = x.ln());
    assert_agrees(&drawn, (mean, sd));
}

#[test]
fn shares_with_their_own_concentrations_are_conjugate() {
    let (prior, n) = ([1.0, 2.0, 4.0], [7.0, 2.0, 5.0]);
    let total: f64 = prior.iter().chain(&n).sum();
    let mean: Vec<f64> = prior.iter().zip(&n).map(|(a, n)| (a + n) / total).collect();
    let sd = mean.iter().map(|m| (m * (1.0 - m) / (total + 1.0)).sqrt()).collect();
    let drawn = draws(&models::shares::Shares, None, &column("n", &n), 1500);
    assert_agrees(&drawn, (mean, sd));
}

#[test]
fn ordered_answers_agree_with_a_grid_over_slope_and_cuts() {
    let mut rng = rng(26);
    let rows: Vec<(f64, usize)> = (0..40)
        .map(|_| {
            let (x, p): (f64, f64) = (rng.random_range(-2.0..2.0), rng.random());
            let above = |cut: f64| p < 1.0 / (1.0 + (cut - 0.8 * x).exp());
            (x, usize::from(above(-0.5)) + usize::from(above(1.0)))
        })
        .collect();
    let logistic = |z: f64| 1.0 / (1.0 + (-z).exp());
    let point = |q: &[f64]| {
        let (beta, cuts) = (q[0], [q[1], q[1] + q[2].exp()]);
        let likelihood = |&(x, y): &(f64, usize)| {
            let above = [1.0, logistic(beta * x - cuts[0]), logistic(beta * x - cuts[1]), 0.0];
            (above[y] - above[y + 1]).ln()
        };
        let prior = -beta.abs() - (cuts[0].powi(2) + cuts[1].powi(2)) / 8.0 + q[2];
        (vec![beta, cuts[0], cuts[1]], prior + rows.iter().map(likelihood).sum::<f64>())
    };
    let exact = grid_moments(&[(-1.0, 4.0), (-5.0, 3.0), (-3.0, 3.0)], 70, point);
    let lines: Vec<String> = rows.iter().map(|(x, y)| format!("{x},{y}")).collect();
    let data = table("x,answer", &lines);
    assert_agrees(&draws(&models::answers::Answers, None, &data, 1500), exact);
}

#[test]
fn terms_belong_to_the_last_rows_and_are_measurements() {
    let data = column("y", &[0.1, 0.2, 0.3, 0.4, 0.5]);
    let model = Model::new(&models::autoregression::Autoregression, None, &data).unwrap();
    let measured: Vec<_> = model.measured().collect();
    assert_eq!(measured, [("series", &[2, 3, 4][..])]);
    assert_eq!(model.observed().flatten().collect::<Vec<_>>(), [0.3, 0.4, 0.5]);
    let (mut tape, mut terms) = (model.tape(), vec![]);
    let mut gradient = vec![0.0; 4];
    let ln_p = model.ln_density(&mut tape, &[0.1, 0.5, -0.2, 0.3], &mut gradient);
    model.pointwise(&tape, &mut terms);
    // flat priors: what is left is the Jacobian of sigma
    assert!((ln_p - 0.3 - terms.iter().sum::<f64>()).abs() < 1e-12);
    assert!(draws_of_the_prior(&models::shares::Shares, &column("n", &[1.0, 2.0, 3.0])).is_ok());
}

fn draws_of_the_prior(model: &dyn Declare, data: &Measurements) -> Result<(), String> {
    let settings = eplat::infer::Settings { draws: 2, ..Default::default() };
    let model = Model::new(model, None, data).map_err(|e| e.to_string())?;
    model.prior_draws(&settings).map(|_| ()).map_err(|e| e.to_string())
}

mod wrong {
    use eplat::prelude::*;
    pub(crate) mod terms {
        use super::*;
        model! {
            model Terms;
            column y;
            param mu ~ Normal(0.0, 1.0);
            density twice(data) = twice(mu, data.y);
        }
        fn twice<D: Real>(mu: D, y: &[f64]) -> Vec<D> {
            y.iter().chain(y).map(|y| Normal(mu, 1.0).ln_likelihood(y)).collect()
        }
    }
    pub(crate) mod length {
        use super::*;
        model! {
            model Length;
            param share(4) ~ Dirichlet([1.0, 2.0, 4.0]);
        }
    }
    pub(crate) mod penalty {
        use super::*;
        model! {
            model Penalty;
            param mu ~ Normal(0.0, 1.0);
            density penalty = mu.powi(4) * -1.0;
        }
    }
}

#[test]
fn what_is_wrong_with_a_density_is_said() {
    let message = |model: &dyn Declare, data: &Measurements| {
        Model::new(model, None, data).unwrap_err().to_string()
    };
    insta::assert_snapshot!(message(&wrong::terms::Terms, &column("y", &[1.0, 2.0])));
    insta::assert_snapshot!(message(&wrong::length::Length, &column("y", &[1.0])));
    insta::assert_snapshot!(message(shipped("garch"), &column("Y", &[1.0])));
    let missing = table("y,z", &["1,2".into(), ",3".into()]);
    insta::assert_snapshot!(message(shipped("garch"), &missing));
    let elsewhere = table("protocol,y", &["other,2".into()]);
    insta::assert_snapshot!(message(shipped("garch"), &elsewhere));
    let said = draws_of_the_prior(&wrong::penalty::Penalty, &column("y", &[1.0])).unwrap_err();
    assert!(
        said.starts_with("density penalty: draws from the priors would leave it out"),
        "{said}"
    );
}
