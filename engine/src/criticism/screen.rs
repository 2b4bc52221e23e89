//! How covariates go together with what a fit leaves over, with its fields, and with each other.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::engine::{Engine, RowAt};
use super::fit::LaplaceFit;
use super::observable::readable;

/// p-value of an F-test: of one value for each group of rows, on the means of a design over these
/// groups.
pub(super) fn f_test(engine: &Engine, groups: &[(f64, Vec<usize>)], term: usize) -> f64 {
    let term = &engine.terms[term];
    let n = groups.len();
    let y = DVector::from_iterator(n, groups.iter().map(|(value, _)| *value));
    let mut x = DMatrix::from_element(n, term.n + 1, 1.0);
    for (g, (_, rows)) in groups.iter().enumerate() {
        for k in 0..term.n {
            let z = |r: &usize| engine.design(term, *r)[k];
            x[(g, k + 1)] = rows.iter().map(z).sum::<f64>() / rows.len() as f64;
        }
    }
    let total = y.add_scalar(-y.mean()).norm_squared();
    let svd = x.svd(true, true);
    let rank = svd.rank(1e-9);
    let Some(u) = &svd.u else { return 1.0 };
    let explained: f64 =
        (0..rank).map(|k| u.column(k).dot(&y).powi(2)).sum::<f64>() - n as f64 * y.mean().powi(2);
    let (d1, d2) = ((rank - 1) as f64, (n - rank) as f64);
    if d1 < 1.0 || d2 < 1.0 {
        return 1.0;
    }
    // F/(F + d2/d1) is Beta(d1/2, d2/2)
    crate::diagnostics::beta_above(explained / total, 0.5 * d1, 0.5 * d2)
}

/// Mean residual of each site, with its rows.
pub(super) fn of_sites(engine: &Engine, residual: &[f64]) -> Vec<(f64, Vec<usize>)> {
    let mean = |rows: &Vec<usize>| {
        (rows.iter().map(|r| residual[*r]).sum::<f64>() / rows.len() as f64, rows.clone())
    };
    engine.sites.iter().filter(|rows| !rows.is_empty()).map(mean).collect()
}

/// Random effect of each unit, with its rows.
pub(super) fn of_units(engine: &Engine, fit: &LaplaceFit) -> Vec<(f64, Vec<usize>)> {
    let Some(term) = fit.unit_term(engine) else { return vec![] };
    let own = |k: usize| {
        let is_own = |r: &usize| engine.design(term, *r)[k] > 0.0;
        (fit.x[engine.split.linear.len() + k], (0..engine.rows.len()).filter(is_own).collect())
    };
    (0..term.n).map(own).filter(|(_, rows): &(f64, Vec<usize>)| !rows.is_empty()).collect()
}

/// The share of a term's variance over the rows that a smooth function of the model's fields could
/// take up.
pub(super) fn r_squared_on_fields(
    engine: &Engine,
    fit: &LaplaceFit,
    term: usize,
    step: f64,
) -> f64 {
    let n = engine.rows.len();
    let Some(slopes) = slopes(engine, fit) else { return 0.0 };
    let outer = &fit.outer;
    let variance = (2.0 * outer.ln_site).exp() + (2.0 * outer.ln_noise).exp() + step * step / 12.0;
    // θ = F x, x ~ N(0, I): the smoother is F Fᵀ (F Fᵀ + variance)⁻¹
    let covariance = &slopes * slopes.transpose();
    let noisy = &covariance + DMatrix::identity(n, n) * variance;
    let Some(factor) = nalgebra::Cholesky::new(noisy) else { return 0.0 };
    let term = &engine.terms[term];
    let (mut left, mut total) = (0.0, 0.0);
    for k in 0..term.n {
        let z = DVector::from_fn(n, |r, _| engine.design(term, r)[k]);
        let z = z.add_scalar(-z.mean());
        let rest = &z - &covariance * factor.solve(&z);
        left += rest.norm_squared();
        total += z.norm_squared();
    }
    if total > 0.0 { 1.0 - left / total } else { 0.0 }
}

/// The share of a term's variance over the rows that the design of another term explains.
pub(super) fn r_squared(engine: &Engine, term: usize, by: usize) -> f64 {
    if engine.terms[term].n == 0 || engine.terms[by].n == 0 {
        return 0.0; // outliers have no design
    }
    let n = engine.rows.len();
    let [y, x] = [term, by].map(|t| {
        let term = &engine.terms[t];
        let design = DMatrix::from_fn(n, term.n, |r, k| engine.design(term, r)[k]);
        let means = design.row_mean();
        DMatrix::from_fn(n, term.n, |r, k| design[(r, k)] - means[k])
    });
    let svd = x.svd(true, false);
    let rank = svd.rank(1e-9);
    let Some(u) = &svd.u else { return 0.0 };
    let explained = (u.columns(0, rank).transpose() * &y).norm_squared();
    explained / y.norm_squared()
}

/// Derivative of a row's predicted value in each of its scalars.
fn of_row(engine: &Engine, fit: &LaplaceFit, row: &RowAt) -> Option<Vec<f64>> {
    engine.model.row_location_slopes(row.id, &fit.locals[row.first..][..row.n])
}

/// Slope of every row's predicted value in the standard normal coefficients of the fields,
/// (rows, coefficients); `None` for a model without fields.
fn slopes(engine: &Engine, fit: &LaplaceFit) -> Option<DMatrix<f64>> {
    let etas: Vec<usize> =
        (0..engine.split.is_eta.len()).filter(|k| engine.split.is_eta[*k]).collect();
    if etas.is_empty() {
        return None;
    }
    let mut slopes = DMatrix::zeros(engine.rows.len(), etas.len());
    for (r, row) in engine.rows.iter().enumerate() {
        for (l, slope) in of_row(engine, fit, row)?.into_iter().enumerate() {
            for (k, eta) in etas.iter().enumerate() {
                slopes[(r, k)] += slope * fit.design_row(row.first + l)[*eta];
            }
        }
    }
    Some(slopes)
}

/// The change of each field that moves what is observed by one protocol step. It comes from the rms
/// slope over the rows of a fit. Fields on which nothing observed depends are left out.
pub(super) fn field_sd(engine: &Engine, fit: &LaplaceFit, step: f64) -> BTreeMap<String, f64> {
    let mut found = BTreeMap::new();
    for field in engine.model.field_names() {
        let (mut squares, mut n) = (0.0, 0.0);
        for row in &engine.rows {
            let Some(local) = engine.model.local_of(row.id, field) else { continue };
            if let Some(slopes) = of_row(engine, fit, row) {
                squares += slopes[local].powi(2);
                n += 1.0;
            }
        }
        if squares > 0.0 {
            found.insert(field.to_string(), readable(step / (squares / n).sqrt()));
        }
    }
    found
}
