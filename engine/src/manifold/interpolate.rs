//! Interpolation on a surface by inverse biharmonic distance.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use rayon::prelude::*;

use super::Basis;
use super::distance::BIHARMONIC_MODES;

/// Vertices that one matrix product serves.
const BLOCK: usize = 64;

/// Values of `fields` (each n_vertices) at the vertices `to`, as averages over the vertices `from`
/// weighted by 1/d⁴, d the biharmonic distance: for each of `to` one value per field.
///
/// All distances are one matrix product, `d² = |x|² + |y|² − 2 x·y` with `x_k = φ_k/λ_k`: 50,000 by
/// 70,000 vertices take seconds.
///
/// # Source
/// Coveney et al. 2022, Methods, "Parameter samples"
pub fn interpolate_biharmonic(
    basis: &Basis,
    fields: &[Vec<f64>],
    from: &[usize],
    to: &[usize],
) -> Vec<Vec<f64>> {
    let (sources, source_norms) = embedding(basis, from);
    let values = Mat::from_fn(from.len(), fields.len(), |i, field| fields[field][from[i]]);
    let block = |to: &[usize]| -> Vec<Vec<f64>> {
        let (targets, target_norms) = embedding(basis, to);
        let mut weights = Mat::<f64>::zeros(from.len(), to.len());
        matmul(&mut weights, Accum::Replace, &sources, targets.transpose(), -2.0, Par::Seq);
        let mut totals = vec![0.0; to.len()];
        for (j, total) in totals.iter_mut().enumerate() {
            let column = weights.col_as_slice_mut(j);
            for (weight, norm) in column.iter_mut().zip(&source_norms) {
                // rounding may leave a coincident pair a hair below zero
                let squared = (*weight + norm + target_norms[j]).max(f64::MIN_POSITIVE.sqrt());
                *weight = 1.0 / (squared * squared);
                *total += *weight;
            }
        }
        let mut sums = Mat::<f64>::zeros(to.len(), fields.len());
        matmul(&mut sums, Accum::Replace, weights.transpose(), &values, 1.0, Par::Seq);
        let at = |j: usize| (0..fields.len()).map(|field| sums[(j, field)] / totals[j]).collect();
        (0..to.len()).map(at).collect()
    };
    to.par_chunks(BLOCK).flat_map_iter(block).collect()
}

/// `φ_k/λ_k` for k ≥ 1, one row per vertex, and the squared length of each row.
fn embedding(basis: &Basis, vertices: &[usize]) -> (Mat<f64>, Vec<f64>) {
    let n_modes = basis.n_modes().min(BIHARMONIC_MODES);
    let entry = |i: usize, k: usize| basis.at(vertices[i])[k + 1] / basis.eigenvalues[k + 1];
    let rows = Mat::from_fn(vertices.len(), n_modes - 1, entry);
    let norms = (0..vertices.len()).map(|i| rows.row(i).iter().map(|x| x * x).sum()).collect();
    (rows, norms)
}

#[cfg(test)]
mod tests {
    use super::super::test_meshes::icosphere;
    use super::super::{biharmonic, eigenpairs};
    use super::*;

    #[test]
    fn equals_the_average_with_distances_one_by_one() {
        let mesh = icosphere(3, 20.0);
        let basis = eigenpairs(&mesh, 40).unwrap();
        let fields: Vec<Vec<f64>> =
            [0, 2].map(|axis| mesh.vertices().iter().map(|x| x[axis]).collect()).into();
        let (to, from): (Vec<usize>, Vec<usize>) =
            (0..mesh.n_vertices()).partition(|v| mesh.vertices()[*v][2] > 12.0);
        let found = interpolate_biharmonic(&basis, &fields, &from, &to);
        assert_eq!(found.len(), to.len());
        for (&vertex, values) in to.iter().zip(&found) {
            let distance = biharmonic(&basis, vertex);
            let weights: Vec<f64> = from.iter().map(|v| distance[*v].powi(-4)).collect();
            let total: f64 = weights.iter().sum();
            for (field, value) in fields.iter().zip(values) {
                let sum: f64 = from.iter().zip(&weights).map(|(v, w)| w * field[*v]).sum();
                assert!((sum / total - value).abs() < 1e-9, "{vertex}: {} {value}", sum / total);
            }
        }
    }
}
