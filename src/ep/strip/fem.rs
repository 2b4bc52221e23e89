//! Finite elements on the strip, folded about its middle column.
//!
//! Three columns of nodes, every square cut into two triangles by the diagonal that joins the nodes
//! with i + j even.  This mesh is its own mirror image, and so is every solution the protocol can
//! reach; the two outer columns are therefore one unknown.  With P the map from two columns to three,
//! the folded matrices are Pᵀ M P and Pᵀ K P: each triangle is added under its folded node numbers.
//! Nodes are numbered `2 j + column` (0 outer, 1 middle), which gives half-bandwidth 3.

/// Half-bandwidth of the folded matrices.
pub(super) const BAND: usize = 3;

/// Columns of the mesh before folding.
const N_ACROSS: usize = 3;

/// Entries `(i, i + offset)` of a symmetric banded matrix, `offset` 0 to [`BAND`]; one row per node.
pub(super) type Banded = Vec<[f64; BAND + 1]>;

/// Consistent mass (over spacing²) and stiffness of a folded strip with `n_along` rows.
#[derive(Debug)]
pub(super) struct Matrices {
    pub(super) mass: Banded,
    pub(super) stiffness: Banded,
}

impl Matrices {
    pub(super) fn assemble(n_along: usize) -> Self {
        let mut mass = vec![[0.0; BAND + 1]; 2 * n_along];
        let mut stiffness = mass.clone();
        for triangle in triangles(n_along) {
            let node = triangle.map(|(i, j)| 2 * j + i % 2);
            add_element(&mut mass, node, &ELEMENT_MASS);
            add_element(&mut stiffness, node, &ELEMENT_STIFFNESS);
        }
        Self { mass, stiffness }
    }
}

/// Mass of a right triangle with unit legs: area/6 on the diagonal, area/12 elsewhere.
const ELEMENT_MASS: [[f64; 3]; 3] = {
    const D: f64 = 1.0 / 12.0;
    const O: f64 = 1.0 / 24.0;
    [[D, O, O], [O, D, O], [O, O, D]]
};

/// Stiffness of a right triangle with equal legs, its right angle at node 0.
const ELEMENT_STIFFNESS: [[f64; 3]; 3] = [[1.0, -0.5, -0.5], [-0.5, 0.5, 0.0], [-0.5, 0.0, 0.5]];

/// Corners (across, along) of every triangle, the right angle first.
fn triangles(n_along: usize) -> Vec<[(usize, usize); 3]> {
    let mut list = Vec::new();
    for j in 0..n_along - 1 {
        for i in 0..N_ACROSS - 1 {
            let (p, q, r, t) = ((i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1));
            // The diagonal joins the nodes with i + j even: p and t, or q and r.
            let halves =
                if (i + j) % 2 == 0 { [[q, p, t], [r, p, t]] } else { [[p, q, r], [t, q, r]] };
            list.extend(halves);
        }
    }
    list
}

fn add_element(matrix: &mut Banded, node: [usize; 3], element: &[[f64; 3]; 3]) {
    for (k, row) in element.iter().enumerate() {
        for (l, value) in row.iter().enumerate() {
            if node[l] >= node[k] {
                matrix[node[k]][node[l] - node[k]] += value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    fn dense(banded: &Banded) -> DMatrix<f64> {
        let n = banded.len();
        DMatrix::from_fn(n, n, |r, c| {
            banded[r.min(c)].get(r.abs_diff(c)).copied().unwrap_or_default()
        })
    }

    /// The three-column matrices, assembled densely and independently from node coordinates.
    fn unfolded(n_along: usize) -> (DMatrix<f64>, DMatrix<f64>) {
        let n = N_ACROSS * n_along;
        let (mut mass, mut stiffness) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        for t in triangles(n_along) {
            let xy = t.map(|(i, j)| (i as f64, j as f64));
            let side = |a: usize, b: usize| (xy[b].0 - xy[a].0, xy[b].1 - xy[a].1);
            let cross = side(0, 1).0 * side(0, 2).1 - side(0, 1).1 * side(0, 2).0;
            let area = 0.5 * cross.abs();
            for k in 0..3 {
                for l in 0..3 {
                    // ∇φ_k is the opposite side turned by 90°, over twice the area.
                    let (a, b) = (side((k + 1) % 3, (k + 2) % 3), side((l + 1) % 3, (l + 2) % 3));
                    let (row, col) = (t[k].1 * N_ACROSS + t[k].0, t[l].1 * N_ACROSS + t[l].0);
                    stiffness[(row, col)] += (a.0 * b.0 + a.1 * b.1) / (4.0 * area);
                    mass[(row, col)] += area / if k == l { 6.0 } else { 12.0 };
                }
            }
        }
        (mass, stiffness)
    }

    #[test]
    fn folding_is_exact_because_the_mesh_is_symmetric() {
        let n_along = 6;
        let (mass, stiffness) = unfolded(n_along);
        let mut fold = DMatrix::zeros(3 * n_along, 2 * n_along);
        for j in 0..n_along {
            for i in 0..3 {
                fold[(3 * j + i, 2 * j + i % 2)] = 1.0;
            }
        }
        let folded = Matrices::assemble(n_along);
        for (full, banded) in [(mass, &folded.mass), (stiffness, &folded.stiffness)] {
            let difference = fold.transpose() * &full * &fold - dense(banded);
            assert!(difference.amax() < 1e-14);
            // A folded vector stays symmetric under the full matrix: outer rows agree.
            let image = &full * &fold;
            for j in 0..n_along {
                assert!((image.row(3 * j) - image.row(3 * j + 2)).amax() < 1e-14);
            }
        }
    }

    #[test]
    fn mass_sums_to_the_area_and_constants_have_no_stiffness() {
        let m = Matrices::assemble(81);
        assert!((dense(&m.mass).sum() - 2.0 * 80.0).abs() < 1e-10);
        assert!(dense(&m.stiffness).column_sum().amax() < 1e-12);
    }
}
