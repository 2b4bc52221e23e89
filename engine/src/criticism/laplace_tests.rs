//! A linear model with normal errors, where Laplace is exact: against the closed form.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::*;
use crate::model::Model;
use crate::prelude::*;
use crate::table::Measurements;

model! {
    /// A level, seen with a known error.
    model Level;
    param level [ms] ~ Normal(3.0, 10.0);
    let shown(row) [ms] = level;
    observe y(row): Number [ms] ~ Normal(shown(row), 2.0);
}

const SITE: [usize; 7] = [0, 0, 1, 1, 1, 2, 3];
const Y: [f64; 7] = [1.0, 2.5, -3.0, -2.0, -4.5, 6.0, 0.5];
const DOSE: [f64; 7] = [0.0, 1.0, -1.0, 2.0, 0.5, 1.5, -0.5];

fn engine() -> Engine {
    let header = ["site", "y"].map(String::from).to_vec();
    let cells = SITE.iter().zip(Y).map(|(s, y)| vec![s.to_string(), y.to_string()]).collect();
    let table = Measurements::from_cells("test", header, cells).unwrap();
    let on = vec!["shown".to_owned()];
    let model = Model::with_offsets(&Level, None, &table, &on).unwrap();
    let dose = TriedTerm { on: on.clone(), design: DOSE.to_vec(), n: 1, sd: Some(1.5) };
    Engine::new(model, &on, &SITE, &[], vec![dose])
}

fn outer(ln_site: f64) -> Outer {
    Outer { other: vec![], ln_site, ln_noise: 0.3, ln_unit: None, outliers: None, scatter: vec![] }
}

/// Covariance of the measurements at a site sd, with or without the dose.
fn covariance(site: f64, with_dose: bool) -> DMatrix<f64> {
    let variance = 4.0 + (2.0 * 0.3f64).exp();
    DMatrix::from_fn(7, 7, |i, j| {
        let same = |yes: bool, x: f64| if yes { x } else { 0.0 };
        100.0
            + same(SITE[i] == SITE[j], site * site)
            + same(i == j, variance)
            + same(with_dose, 2.25 * DOSE[i] * DOSE[j])
    })
}

#[test]
fn scatter_multiplies_the_error_of_each_row() {
    let mut engine = engine();
    let scatter = TriedTerm { on: vec![], design: DOSE.to_vec(), n: 1, sd: None };
    engine.terms = vec![std::sync::Arc::new(scatter)];
    let (y, mean) = (DVector::from_row_slice(&Y), DVector::from_element(7, 3.0));
    for slope in [0.0, 0.4, -0.7] {
        let outer = Outer { scatter: vec![vec![slope]], ..outer(1.0f64.ln()) };
        let fit = engine.fit(&outer, &[0], None).unwrap();
        let mut covariance = covariance(1.0, false);
        for (i, dose) in DOSE.iter().enumerate() {
            covariance[(i, i)] += (2.0 * (0.3 + slope * dose)).exp() - 0.6f64.exp();
        }
        let exact = ln_normal(&y, &mean, &covariance);
        assert!((fit.ln_evidence - exact).abs() < 1e-6, "{slope}: {} {exact}", fit.ln_evidence);
    }
}

fn ln_normal(y: &DVector<f64>, mean: &DVector<f64>, covariance: &DMatrix<f64>) -> f64 {
    let factor = Cholesky::new(covariance.clone()).unwrap();
    let d = y - mean;
    let ln_det = 2.0 * factor.l().diagonal().map(f64::ln).sum();
    -0.5 * (d.dot(&factor.solve(&d)) + ln_det + y.len() as f64 * std::f64::consts::TAU.ln())
}

#[test]
fn the_evidence_is_that_of_the_closed_form() {
    let engine = engine();
    let (y, mean) = (DVector::from_row_slice(&Y), DVector::from_element(7, 3.0));
    for site in [0.01, 1.0, 4.0] {
        for active in [vec![], vec![0]] {
            let fit = engine.fit(&outer(f64::ln(site)), &active, None).unwrap();
            let exact = ln_normal(&y, &mean, &covariance(site, !active.is_empty()));
            assert!(
                (fit.ln_evidence - exact).abs() < 1e-6,
                "{site} {active:?}: {}",
                fit.ln_evidence
            );
        }
    }
}

/// Mean and covariance of the rows `unseen` given all others, without their own errors.
fn given_others(unseen: &[usize], site: f64) -> (DVector<f64>, DMatrix<f64>) {
    let all = covariance(site, true);
    let seen: Vec<usize> = (0..7).filter(|i| !unseen.contains(i)).collect();
    let pick =
        |a: &[usize], b: &[usize]| DMatrix::from_fn(a.len(), b.len(), |i, j| all[(a[i], b[j])]);
    let factor = Cholesky::new(pick(&seen, &seen)).unwrap();
    let across = pick(unseen, &seen);
    let d = DVector::from_fn(seen.len(), |i, _| Y[seen[i]] - 3.0);
    let error = 4.0 + (2.0 * 0.3f64).exp();
    let own = pick(unseen, unseen) - DMatrix::identity(unseen.len(), unseen.len()) * error;
    (
        (&across * factor.solve(&d)).add_scalar(3.0),
        own - &across * factor.solve(&across.transpose()),
    )
}

#[test]
fn a_cavity_is_the_prediction_from_all_other_rows() {
    let engine = engine();
    let fit = engine.fit(&outer(f64::ln(1.3)), &[0], None).unwrap();
    for rows in [vec![0, 1], vec![2, 3, 4], vec![6], vec![3]] {
        let cavity = fit.cavity(&engine, &rows).unwrap();
        let (mean, covariance) = given_others(&rows, 1.3);
        // a row's scalars are the level and the offset on it: what is shown is their sum
        let shown =
            DMatrix::from_fn(rows.len(), cavity.mean.len(), |r, c| f64::from(u8::from(c / 2 == r)));
        assert!((&shown * &cavity.mean - mean).amax() < 1e-6, "{rows:?}");
        let own = &shown * &cavity.covariance * shown.transpose();
        assert!((own - covariance).amax() < 1e-6, "{rows:?}");
    }
}

#[test]
fn hidden_rows_have_no_say() {
    let engine = engine();
    let fit = engine.fit_without(&[2, 3, 4], &outer(f64::ln(1.3)), &[0], None).unwrap();
    let whole = engine.fit(&outer(f64::ln(1.3)), &[0], None).unwrap();
    let (hidden, cavity) = (fit.cavity(&engine, &[2, 3, 4]), whole.cavity(&engine, &[2, 3, 4]));
    assert!((hidden.unwrap().mean - cavity.unwrap().mean).amax() < 1e-6);
}
