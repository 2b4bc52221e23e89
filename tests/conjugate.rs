//! The posterior that NUTS draws from, against the exact one where linear algebra gives it.
//!
//! Every mean and standard deviation must agree within 4 Monte Carlo standard errors of this very
//! run; the same check refuses a model with another prior.

#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use eplat::manifold::Basis;
use eplat::model::Declare;
use eplat::table::Measurements;
use nalgebra::{DMatrix, DVector};
use support::{basis, oracle, table};

/// Known measurement error of every model here.
const SD: f64 = 2.0;

mod normal {
    use eplat::prelude::*;
    model! {
        model KnownSd;
        param mu ~ Normal(1.0, 1.5);
        observe y(row): Number ~ Normal(mu, 2.0);
    }
}

/// The broken twin: a prior twice as wide.
mod wrong_prior {
    use eplat::prelude::*;
    model! {
        model WrongPrior;
        param mu ~ Normal(1.0, 3.0);
        observe y(row): Number ~ Normal(mu, 2.0);
    }
}

mod field {
    use eplat::prelude::*;
    model! {
        model KnownField;
        field f(x) = m + 3.0 * gp(Rbf(Num::from(20.0)), K = 6) where { m ~ Flat; }
        observe y(x): Number ~ Normal(f(x), 2.0);
    }
}

/// Worst disagreement with the exact means and standard deviations, in Monte Carlo standard errors.
fn worst_error(
    model: &dyn Declare,
    basis: Option<&Basis>,
    data: &Measurements,
    mean: &[f64],
    sd: &[f64],
) -> f64 {
    oracle::worst_error(&oracle::draws(model, basis, data, 4000), mean, sd)
}

/// Mean and standard deviations of coefficients with prior precision `prior` (diagonal) about
/// `centre`, measured as `x · coefficients` with error [`SD`].
fn exact(x: &DMatrix<f64>, y: &[f64], prior: &[f64], centre: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let prior = DMatrix::from_diagonal(&DVector::from_row_slice(prior));
    let precision = x.transpose() * x / (SD * SD) + &prior;
    let covariance = precision.try_inverse().unwrap();
    let pull = x.transpose() * DVector::from_row_slice(y) / (SD * SD)
        + prior * DVector::from_row_slice(centre);
    let mean = &covariance * pull;
    (mean.iter().copied().collect(), covariance.diagonal().iter().map(|v| v.sqrt()).collect())
}

#[test]
fn a_normal_mean_with_known_error() {
    let y = [3.1, 0.4, 5.2, 2.9, 4.4];
    let rows: Vec<String> = y.iter().map(ToString::to_string).collect();
    let data = table("y", &rows);
    let x = DMatrix::from_element(y.len(), 1, 1.0);
    let (mean, sd) = exact(&x, &y, &[1.0 / (1.5 * 1.5)], &[1.0]);
    let error = worst_error(&normal::KnownSd, None, &data, &mean, &sd);
    assert!(error < 4.0, "{error} Monte Carlo standard errors");
    let broken = worst_error(&wrong_prior::WrongPrior, None, &data, &mean, &sd);
    assert!(broken > 8.0, "a prior of twice the width goes unseen: {broken}");
}

#[test]
fn a_field_with_known_hyperparameters() {
    let basis = basis(200, 6);
    let y: Vec<f64> =
        (0..12).map(|i| 10.0 + f64::from(i * 7 % 5) - 2.0 * f64::from(i % 2)).collect();
    let rows: Vec<String> = y.iter().enumerate().map(|(i, y)| format!("{},{y}", 15 * i)).collect();
    let mut data = table("vertex,y", &rows);
    data.place_at_indices(200).unwrap();
    // Columns: the mean, then 3 √S(√λ_k) φ_k(x) with S = 2π ℓ² exp(−ℓ² λ/2), ℓ = 20 mm.
    let column = |i: usize, k: usize| {
        let density = std::f64::consts::TAU * 400.0 * (-200.0 * basis.eigenvalues[k]).exp();
        3.0 * density.sqrt() * basis.at(15 * i)[k]
    };
    let x = DMatrix::from_fn(12, 7, |i, k| if k == 0 { 1.0 } else { column(i, k - 1) });
    let (mean, sd) = exact(&x, &y, &[0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0], &[0.0; 7]);
    let error = worst_error(&field::KnownField, Some(&basis), &data, &mean, &sd);
    assert!(error < 4.0, "{error} Monte Carlo standard errors");
    let wider: Vec<f64> = sd.iter().map(|sd| 1.1 * sd).collect();
    let broken = worst_error(&field::KnownField, Some(&basis), &data, &mean, &wider);
    assert!(broken > 4.0, "deviations wrong by a tenth go unseen: {broken}");
}
