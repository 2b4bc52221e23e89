//! Finite elements on the strip, folded about its middle column.
//!
//! An odd number of columns of nodes, every square cut into two triangles by the diagonal that joins
//! the nodes with i + j even.  This mesh is its own mirror image, and so is every solution the
//! protocol can reach; a column and its mirror image are therefore one unknown.  With P the map from
//! the folded columns to all, the folded matrices are Pᵀ M P and Pᵀ K P: each triangle is added under
//! its folded node numbers.  Nodes are numbered along the folded columns first (outermost column 0),
//! which gives half-bandwidth `columns + 1`; a cable of one column has half-bandwidth 1.

use super::Grid;

/// A symmetric matrix of half-bandwidth `B`.
#[derive(Debug, Clone)]
pub(super) struct Banded<const B: usize> {
    pub(super) diagonal: Vec<f64>,
    /// `above[i][o]` is the entry (i, i + 1 + o).
    pub(super) above: Vec<[f64; B]>,
}

impl<const B: usize> Banded<B> {
    fn zeros(n: usize) -> Self {
        Self { diagonal: vec![0.0; n], above: vec![[0.0; B]; n] }
    }

    fn add<const N: usize>(&mut self, node: [usize; N], element: &[[f64; N]; N]) {
        for (k, row) in element.iter().enumerate() {
            for (l, value) in row.iter().enumerate() {
                if node[l] == node[k] {
                    self.diagonal[node[k]] += value;
                } else if node[l] > node[k] {
                    self.above[node[k]][node[l] - node[k] - 1] += value;
                }
            }
        }
    }
}

/// Consistent mass (over spacing² on a strip, over spacing on a cable) and stiffness (times spacing on
/// a cable) of a folded strip.
#[derive(Debug)]
pub(super) struct Matrices<const B: usize> {
    pub(super) mass: Banded<B>,
    pub(super) stiffness: Banded<B>,
}

impl<const B: usize> Matrices<B> {
    pub(super) fn assemble(grid: &Grid) -> Self {
        let columns = grid.columns();
        let mut mass = Banded::zeros(columns * grid.n_along);
        let mut stiffness = mass.clone();
        for j in 0..if grid.n_across == 1 { grid.n_along - 1 } else { 0 } {
            mass.add([j, j + 1], &CABLE_MASS);
            stiffness.add([j, j + 1], &CABLE_STIFFNESS);
        }
        for triangle in triangles(grid.n_along, grid.n_across) {
            let node = triangle.map(|(i, j)| columns * j + i.min(grid.n_across - 1 - i));
            mass.add(node, &ELEMENT_MASS);
            stiffness.add(node, &ELEMENT_STIFFNESS);
        }
        Self { mass, stiffness }
    }
}

/// Mass of a cable's element of unit length.
const CABLE_MASS: [[f64; 2]; 2] = [[1.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 1.0 / 3.0]];

/// Stiffness of a cable's element of unit length.
const CABLE_STIFFNESS: [[f64; 2]; 2] = [[1.0, -1.0], [-1.0, 1.0]];

/// Mass of a right triangle with unit legs: area/6 on the diagonal, area/12 elsewhere.
const ELEMENT_MASS: [[f64; 3]; 3] = {
    const D: f64 = 1.0 / 12.0;
    const O: f64 = 1.0 / 24.0;
    [[D, O, O], [O, D, O], [O, O, D]]
};

/// Stiffness of a right triangle with equal legs, its right angle at node 0.
const ELEMENT_STIFFNESS: [[f64; 3]; 3] = [[1.0, -0.5, -0.5], [-0.5, 0.5, 0.0], [-0.5, 0.0, 0.5]];

/// Corners (across, along) of every triangle, the right angle first.
fn triangles(n_along: usize, n_across: usize) -> Vec<[(usize, usize); 3]> {
    let mut list = Vec::new();
    for j in 0..n_along - 1 {
        for i in 0..n_across - 1 {
            let (p, q, r, t) = ((i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1));
            // The diagonal joins the nodes with i + j even: p and t, or q and r.
            let halves =
                if (i + j) % 2 == 0 { [[q, p, t], [r, p, t]] } else { [[p, q, r], [t, q, r]] };
            list.extend(halves);
        }
    }
    list
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    fn dense<const B: usize>(banded: &Banded<B>) -> DMatrix<f64> {
        let n = banded.diagonal.len();
        DMatrix::from_fn(n, n, |r, c| match r.abs_diff(c) {
            0 => banded.diagonal[r],
            o => banded.above[r.min(c)].get(o - 1).copied().unwrap_or_default(),
        })
    }

    /// The matrices of all columns, assembled densely and independently from node coordinates.
    fn unfolded(n_along: usize, n_across: usize) -> (DMatrix<f64>, DMatrix<f64>) {
        let n = n_across * n_along;
        let (mut mass, mut stiffness) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for t in triangles(n_along, n_across) {
            let xy = t.map(|(i, j)| (i as f64, j as f64));
            let side = |a: usize, b: usize| (xy[b].0 - xy[a].0, xy[b].1 - xy[a].1);
            let cross = side(0, 1).0 * side(0, 2).1 - side(0, 1).1 * side(0, 2).0;
            let area = 0.5 * cross.abs();
            for k in 0..3 {
                for l in 0..3 {
                    // ∇φ_k is the opposite side turned by 90°, over twice the area.
                    let (a, b) = (side((k + 1) % 3, (k + 2) % 3), side((l + 1) % 3, (l + 2) % 3));
                    let (row, col) = (t[k].1 * n_across + t[k].0, t[l].1 * n_across + t[l].0);
                    stiffness[(row, col)] += (a.0 * b.0 + a.1 * b.1) / (4.0 * area);
                    mass[(row, col)] += area / if k == l { 6.0 } else { 12.0 };
                }
            }
        }
        (mass, stiffness)
    }

    fn folding_is_exact<const B: usize>(n_across: usize) {
        let grid = Grid { n_along: 6, n_across, ..Grid::default() };
        let (n, columns) = (grid.n_along, grid.columns());
        let (mass, stiffness) = unfolded(n, n_across);
        let mut fold = DMatrix::zeros(n_across * n, columns * n);
        for j in 0..n {
            for i in 0..n_across {
                fold[(n_across * j + i, columns * j + i.min(n_across - 1 - i))] = 1.0;
            }
        }
        let folded = Matrices::<B>::assemble(&grid);
        for (full, banded) in [(mass, &folded.mass), (stiffness, &folded.stiffness)] {
            let difference = fold.transpose() * &full * &fold - dense(banded);
            assert!(difference.amax() < 1e-14);
            // A folded vector stays symmetric under the full matrix: mirrored rows agree.
            let image = &full * &fold;
            for j in 0..n {
                let outer = [n_across * j, n_across * j + n_across - 1];
                assert!((image.row(outer[0]) - image.row(outer[1])).amax() < 1e-14);
            }
        }
    }

    #[test]
    fn folding_is_exact_because_the_mesh_is_symmetric() {
        folding_is_exact::<3>(3);
        folding_is_exact::<4>(5);
        folding_is_exact::<6>(9);
    }

    #[test]
    fn mass_sums_to_the_area_and_constants_have_no_stiffness() {
        let m = Matrices::<3>::assemble(&Grid::default());
        assert!((dense(&m.mass).sum() - 2.0 * 80.0).abs() < 1e-10);
        assert!(dense(&m.stiffness).column_sum().amax() < 1e-12);
        let m = Matrices::<1>::assemble(&Grid { n_across: 1, ..Grid::default() });
        assert!((dense(&m.mass).sum() - 80.0).abs() < 1e-10);
        assert!(dense(&m.stiffness).column_sum().amax() < 1e-12);
    }
}
