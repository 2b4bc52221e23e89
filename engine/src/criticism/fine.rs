//! Finer fields: what the model's modes leave out of its own fields.
//!
//! Sites may differ by more than the model says because its truncated expansion cannot follow its
//! own fields. Such differences are alike at neighbouring sites. Differences that come from a cause
//! that no column tells are not.
//!
//! Two kinds are used. Fields with the modes beyond the model's alone ([`finer_fields`]) say whether
//! the model has too few. Smooth fields with all modes ([`smooth_fields`]) are what sites are
//! compared with. The first would not do for that: their lengthscale is the distance between sites,
//! so that they are hardly alike at neighbours, and take up what sites differ by.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, SymmetricEigen};

use super::engine::TriedTerm;
use crate::field::{Kernel as _, Matern52};
use crate::manifold::Basis;
use crate::model::Model;
use crate::table::Measurements;

/// Number of modes that finer fields have, in multiples of the model's.
pub const FINER: usize = 4;

/// Standard deviations of finer fields that are tried, in protocol steps. What is larger is no
/// detail of a field but something that the model lacks.
const SIZES: [f64; 2] = [0.25, 0.5];

/// Terms with further modes of every field, once for each of [`SIZES`]. Their lengthscale is the
/// distance between sites. `field_sd` has, for each field, the change that moves what is observed
/// by one step. Empty for a model without fields, or if `basis` has no further modes.
pub(super) fn finer_fields(
    model: &Model,
    basis: Option<&Basis>,
    table: &Measurements,
    n_sites: usize,
    field_sd: &BTreeMap<String, f64>,
) -> Vec<Vec<TriedTerm>> {
    let Some(basis) = basis else { return vec![] };
    let (first, n_modes) = (model.n_modes(), basis.n_modes().min(FINER * model.n_modes()));
    if first >= n_modes {
        return vec![];
    }
    let area = basis.at(0)[0].powi(-2);
    let kernel = Matern52((area / n_sites as f64).sqrt());
    let weight = |lambda: &f64| kernel.sqrt_density(lambda.max(0.0).sqrt());
    let weights: Vec<f64> = basis.eigenvalues[first..n_modes].iter().map(weight).collect();
    let modes = |row: usize| {
        let at = basis.at(table.vertex(row).map_or(0, |vertex| vertex as usize));
        at[first..].iter().zip(&weights).map(|(phi, weight)| phi * weight)
    };
    let mut design: Vec<f64> = (0..table.len()).flat_map(modes).collect();
    let variance = design.iter().map(|z| z * z).sum::<f64>() / table.len() as f64;
    for z in &mut design {
        *z /= variance.sqrt();
    }
    let term = |size: f64, (field, sd): (&String, &f64)| TriedTerm {
        on: vec![field.clone()],
        design: design.clone(),
        n: n_modes - first,
        sd: Some(size * sd),
    };
    SIZES.map(|size| field_sd.iter().map(|field| term(size, field)).collect()).into()
}

/// Lengthscale of smooth fields, in distances between sites, and their sd, in protocol steps.
const SMOOTH: (f64, f64) = (2.0, 1.5);
/// Directions in which a field varies less than this, relative to its variance, are left out.
const NEGLIGIBLE: f64 = 1e-4;

/// Terms with a smooth field beside every field of the model: as wide as fields usually are, and
/// with all modes that are there. Empty for a model without fields.
pub(super) fn smooth_fields(
    model: &Model,
    basis: Option<&Basis>,
    table: &Measurements,
    n_sites: usize,
    field_sd: &BTreeMap<String, f64>,
) -> Vec<TriedTerm> {
    let Some(basis) = basis else { return vec![] };
    let n_modes = basis.n_modes().min(FINER * model.n_modes());
    if n_modes < 2 {
        return vec![];
    }
    let of_row = |row: usize| table.vertex(row).map_or(0, |vertex| vertex as usize);
    let mut places: Vec<usize> = (0..table.len()).map(of_row).collect();
    places.sort_unstable();
    places.dedup();
    let (times, size) = SMOOTH;
    let area = basis.at(0)[0].powi(-2);
    let kernel = Matern52(times * (area / n_sites as f64).sqrt());
    // the first mode is the mean, which the model has
    let weight = |lambda: &f64| kernel.sqrt_density(lambda.max(0.0).sqrt());
    let weights: Vec<f64> = basis.eigenvalues[1..n_modes].iter().map(weight).collect();
    let z = DMatrix::from_fn(places.len(), weights.len(), |place, k| {
        weights[k] * basis.at(places[place])[k + 1]
    });
    let z = &z / (z.norm_squared() / places.len() as f64).sqrt();
    let z = few_columns(z);
    let at = |row: usize| z.row(places.binary_search(&of_row(row)).unwrap_or(0));
    let design: Vec<f64> =
        (0..table.len()).flat_map(|row| at(row).iter().copied().collect::<Vec<_>>()).collect();
    let term = |(field, sd): (&String, &f64)| TriedTerm {
        on: vec![field.clone()],
        design: design.clone(),
        n: z.ncols(),
        sd: Some(size * sd),
    };
    field_sd.iter().map(term).collect()
}

/// A matrix with the same product `Z Zᵀ` (the rows' covariance), and as few columns as it needs.
fn few_columns(z: DMatrix<f64>) -> DMatrix<f64> {
    let wide = z.ncols() > z.nrows();
    let SymmetricEigen { eigenvalues, eigenvectors } =
        SymmetricEigen::new(if wide { &z * z.transpose() } else { z.tr_mul(&z) });
    let kept: Vec<usize> =
        (0..eigenvalues.len()).filter(|k| eigenvalues[*k] > NEGLIGIBLE).collect();
    let mut columns = eigenvectors.select_columns(&kept);
    if wide {
        for (mut column, k) in columns.column_iter_mut().zip(&kept) {
            column *= eigenvalues[*k].sqrt();
        }
        return columns;
    }
    z * columns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fewer_columns_give_the_same_covariance() {
        let entry = |i: usize, k: usize| ((i * 7 + k * 3) % 11) as f64 - 5.0;
        for (rows, columns) in [(4, 9), (9, 4)] {
            let mut z = DMatrix::from_fn(rows, columns, entry);
            z.set_column(1, &(2.0 * z.column(0)));
            let few = few_columns(z.clone());
            assert!(few.ncols() <= rows.min(columns), "{}", few.ncols());
            let wrong = (&few * few.transpose() - &z * z.transpose()).norm();
            assert!(wrong < 1e-9, "{wrong}");
        }
    }
}
