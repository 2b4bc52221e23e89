//! Finer fields: what the model's modes leave out of its own fields.
//!
//! Sites may differ by more than the model says because its truncated expansion cannot follow its
//! own fields. Such differences are alike at neighbouring sites. Differences that come from a cause
//! that no column tells are not.

use std::collections::BTreeMap;

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
