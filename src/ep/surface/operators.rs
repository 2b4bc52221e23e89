//! Mass and stiffness of a triangle mesh, rows in patches of neighbours.

use crate::ep::cell::Tissue;
use crate::ep::precision::Precision;
use crate::mesh::TriMesh;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// `A = M + ½ dt K` and `dt K` by rows: M the consistent mass (mm²), K the stiffness with the diffusivity
/// in it (mm²/ms).
#[derive(Debug)]
pub(super) struct Operators<F> {
    /// The mesh's vertex behind each row.
    pub(super) vertex: Vec<u32>,
    /// Where each row begins; one more than there are rows.
    start: Vec<u32>,
    column: Vec<u32>,
    /// Entries of A and of `dt K`.
    entry: Vec<[F; 2]>,
    /// 1 / A(i, i).
    pub(super) inverse_diagonal: Vec<F>,
}

impl<F: Precision> Operators<F> {
    /// For isotropic diffusion; a triangle has the mean diffusivity of its corners.
    pub(super) fn assemble(mesh: &TriMesh, tissue: &[Tissue], dt: f64) -> Self {
        let vertex = patches(mesh);
        let mut row_of = vec![0; vertex.len()];
        for (row, v) in vertex.iter().enumerate() {
            row_of[*v as usize] = row as u32;
        }
        let mut rows: Vec<BTreeMap<u32, [f64; 2]>> = vec![BTreeMap::new(); vertex.len()];
        for corners in mesh.triangles() {
            let node = corners.map(|v| row_of[v as usize]);
            let diffusivity =
                corners.map(|v| tissue[v as usize].diffusivity).iter().sum::<f64>() / 3.0;
            let (mass, stiffness) = element(corners.map(|v| mesh.vertices()[v as usize]));
            for k in 0..3 {
                for l in 0..3 {
                    let entry = rows[node[k] as usize].entry(node[l]).or_default();
                    entry[0] += mass[k][l];
                    entry[1] += diffusivity * stiffness[k][l];
                }
            }
        }
        let (mut start, mut column, mut entry) = (vec![0], vec![], vec![]);
        let mut inverse_diagonal = vec![];
        for (i, row) in rows.iter().enumerate() {
            for (j, [mass, stiffness]) in row {
                let a = mass + 0.5 * dt * stiffness;
                column.push(*j);
                entry.push([F::of(a), F::of(dt * stiffness)]);
                if *j as usize == i {
                    inverse_diagonal.push(F::of(1.0 / a));
                }
            }
            start.push(column.len() as u32);
        }
        Self { vertex, start, column, entry, inverse_diagonal }
    }

    /// Columns and entries of row `i`.
    #[inline(always)]
    fn row(&self, i: usize) -> impl Iterator<Item = (usize, [F; 2])> {
        let range = self.start[i] as usize..self.start[i + 1] as usize;
        self.column[range.clone()]
            .iter()
            .map(|j| *j as usize)
            .zip(self.entry[range].iter().copied())
    }

    /// Row `i` of `A x`.
    #[inline(always)]
    pub(super) fn implicit(&self, i: usize, x: &[F]) -> F {
        self.row(i).fold(F::zero(), |sum, (j, [a, _])| sum + a * x[j])
    }

    /// Row `i` of `−dt K v − A x`.
    #[inline(always)]
    pub(super) fn residual(&self, i: usize, v: &[F], x: &[F]) -> F {
        self.row(i).fold(F::zero(), |sum, (j, [a, k])| sum - (k * v[j] + a * x[j]))
    }

    /// The blocks of `size` rows that each block's rows refer to.
    pub(super) fn neighbours(&self, size: usize) -> Vec<Vec<usize>> {
        let of_block = |rows: &[u32]| {
            let ends = [rows[0] as usize, rows[rows.len() - 1] as usize];
            let columns = self.column[ends[0]..ends[1]].iter().map(|j| *j as usize / size);
            let mut blocks: Vec<usize> = columns.collect();
            blocks.sort_unstable();
            blocks.dedup();
            blocks
        };
        let n = self.vertex.len();
        (0..n).step_by(size).map(|i| of_block(&self.start[i..=(i + size).min(n)])).collect()
    }
}

/// Mass and stiffness (of unit diffusivity) of a triangle.
fn element(corners: [[f64; 3]; 3]) -> ([[f64; 3]; 3], [[f64; 3]; 3]) {
    let p = corners.map(Vector3::from);
    let side = [p[2] - p[1], p[0] - p[2], p[1] - p[0]];
    let area = 0.5 * side[0].cross(&side[1]).norm();
    let entries = |of: &dyn Fn(usize, usize) -> f64| {
        std::array::from_fn(|k| std::array::from_fn(|l| of(k, l)))
    };
    let mass = entries(&|k, l| area / if k == l { 6.0 } else { 12.0 });
    // ∇φ_k is the opposite side turned by 90°, over twice the area
    (mass, entries(&|k, l| side[k].dot(&side[l]) / (4.0 * area)))
}

/// Vertices along a Z-order curve (Morton 1966): stretches of it are compact patches, so that a front
/// touches few of them.
fn patches(mesh: &TriMesh) -> Vec<u32> {
    let [low, high] = mesh.bounding_box();
    let extent = (0..3).map(|k| high[k] - low[k]).fold(f64::MIN_POSITIVE, f64::max);
    let code = |v: &u32| -> u64 {
        let p = mesh.vertices()[*v as usize];
        let cell = |k: usize| ((p[k] - low[k]) / extent * 1_048_575.0) as u64;
        let cells = [cell(0), cell(1), cell(2)];
        let bit =
            |b: u32| (0..3).map(move |k| (cells[k as usize] >> b & 1) << (3 * b + k)).sum::<u64>();
        (0..20).map(bit).sum()
    };
    let mut order: Vec<u32> = (0..mesh.n_vertices() as u32).collect();
    order.sort_by_cached_key(code);
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ep::Parameters;
    use crate::mesh::left_atrium;

    #[test]
    fn mass_sums_to_the_area_and_constants_do_not_diffuse() {
        let mesh = left_atrium(3.0).mesh;
        let tissue = Parameters::from_array([0.7, 0.05, 10.0, 120.0, 200.0]).tissue();
        let operators = Operators::<f64>::assemble(&mesh, &vec![tissue; mesh.n_vertices()], 0.1);
        let n = mesh.n_vertices();
        let (ones, zeros) = (vec![1.0; n], vec![0.0; n]);
        let total: f64 = (0..n).map(|i| operators.implicit(i, &ones)).sum();
        assert!((total / mesh.area() - 1.0).abs() < 1e-12);
        assert!((0..n).all(|i| operators.residual(i, &ones, &zeros).abs() < 1e-12));
    }

    #[test]
    fn the_order_is_a_permutation_in_compact_patches() {
        let mesh = left_atrium(1.0).mesh;
        let order = patches(&mesh);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..mesh.n_vertices() as u32));
        // a disc of 512 vertices of 1 mm edges has a diameter of some 24 mm
        let diameter = |patch: &[u32]| {
            let points = patch.iter().map(|v| mesh.vertices()[*v as usize]);
            let box_of = |k: usize| {
                points
                    .clone()
                    .map(move |p| p[k])
                    .fold([f64::MAX, f64::MIN], |b, x| [b[0].min(x), b[1].max(x)])
            };
            (0..3).map(|k| box_of(k)[1] - box_of(k)[0]).fold(0.0, f64::max)
        };
        let diameters: Vec<f64> = order.chunks(512).map(diameter).collect();
        let mean = diameters.iter().sum::<f64>() / diameters.len() as f64;
        assert!(mean < 40.0, "{mean}");
    }
}
