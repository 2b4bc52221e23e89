//! Carries what is known of triangles to vertices, by area, and the other way round.
//!
//! Fibres have no sign: they are averaged as axes, through the sum of `w f fᵀ`.

use super::{Array, TriMesh, area_vector, vector};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// Most values of an array of whole numbers that are labels, not measurements.
const MOST_LABELS: usize = 64;

/// `cells` (one row per triangle) at the vertices of `mesh`: means weighted by area, or, for labels,
/// the label that has most of the area around a vertex.
///
/// An array of at most 64 different whole numbers is one of labels. NaN is left out; where all is NaN the
/// result is.
pub(super) fn to_vertices(mesh: &TriMesh, cells: &Array) -> Array {
    let around = triangles_around(mesh);
    let areas: Vec<f64> = (0..mesh.n_triangles()).map(|t| mesh.triangle_area(t)).collect();
    let carry = if are_labels(cells) { largest_share } else { mean };
    let values = around.iter().flat_map(|triangles| {
        (0..cells.width()).map(|k| {
            let all = triangles.iter().map(|&t| (cells.row(t as usize)[k], areas[t as usize]));
            let mut known: Vec<_> = all.filter(|(value, _)| !value.is_nan()).collect();
            carry(&mut known)
        })
    });
    Array::new(cells.width(), values.collect())
}

fn triangles_around(mesh: &TriMesh) -> Vec<Vec<u32>> {
    let mut around = vec![vec![]; mesh.n_vertices()];
    for (t, triangle) in (0u32..).zip(mesh.triangles()) {
        for &v in triangle {
            around[v as usize].push(t);
        }
    }
    around
}

/// Whether an array is one of labels: at most 64 different whole numbers.
pub(super) fn are_labels(array: &Array) -> bool {
    let mut seen: Vec<u64> = vec![];
    array.width() == 1
        && array.values().iter().all(|value| {
            let bits = value.to_bits();
            if !value.is_nan() && !seen.contains(&bits) {
                seen.push(bits);
            }
            value.is_nan() || value.fract() == 0.0 && seen.len() <= MOST_LABELS
        })
}

fn mean(known: &mut [(f64, f64)]) -> f64 {
    let (sum, area) = known.iter().fold((0.0, 0.0), |(s, a), (x, w)| (s + x * w, a + w));
    if area > 0.0 { sum / area } else { f64::NAN }
}

/// The value with most area; of equals the smallest.
fn largest_share(known: &mut [(f64, f64)]) -> f64 {
    known.sort_by(|a, b| a.0.total_cmp(&b.0));
    let shares = known.chunk_by(|a, b| a.0.total_cmp(&b.0).is_eq());
    let shares = shares.map(|same| (same[0].0, same.iter().map(|(_, area)| area).sum::<f64>()));
    shares.fold((f64::NAN, 0.0), |best, next| if next.1 > best.1 { next } else { best }).0
}

/// Fibres of triangles at the vertices: the axis that is nearest to those around, weighted by area, of
/// length 1; 0 where none is known. It is not projected: how far fibres point out of a surface tells
/// whether they are its own, and who uses them looks at that first.
pub(super) fn fibres_to_vertices(mesh: &TriMesh, cells: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let units: Vec<Vector3<f64>> = cells.iter().map(|f| unit(vector(*f))).collect();
    let weighted = |t: &u32| (mesh.triangle_area(*t as usize), units[*t as usize]);
    let around = triangles_around(mesh);
    around.iter().map(|triangles| axis(triangles.iter().map(weighted)).into()).collect()
}

/// Fibres of vertices in the triangles: the axis nearest to the three corners', in the plane.
pub(crate) fn fibres_to_triangles(mesh: &TriMesh, vertices: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let corners = |t: usize| mesh.triangles()[t].into_iter().map(|v| vertices[v as usize]);
    (0..mesh.n_triangles()).map(|t| mean_fibre(mesh, t, corners(t))).collect()
}

/// The axis nearest to these in the plane of triangle `t`; 0 if none has a part there.
pub(super) fn mean_fibre(
    mesh: &TriMesh,
    t: usize,
    fibres: impl Iterator<Item = [f64; 3]>,
) -> [f64; 3] {
    let n = normal(mesh, t);
    in_plane(axis(fibres.map(|f| (1.0, in_plane(vector(f), n)))), n).into()
}

/// Gives triangles without a fibre the axis of those around them, those beside others that have one first.  `fibres` has one
/// for each triangle, 0 where there is none.  Returns how many got one; a piece of the surface where no triangle has any
/// stays without.
pub fn continue_fibres(mesh: &TriMesh, fibres: &mut [[f64; 3]]) -> usize {
    let is_none = |fibre: &[f64; 3]| fibre.iter().all(|x| *x == 0.0);
    let mut n_continued = 0;
    loop {
        let around = fibres_to_triangles(mesh, &fibres_to_vertices(mesh, fibres));
        let without = fibres.iter_mut().zip(around).filter(|(own, _)| is_none(own));
        let mut found = 0;
        for (own, around) in without.filter(|(_, around)| !is_none(around)) {
            *own = around;
            found += 1;
        }
        if found == 0 {
            return n_continued;
        }
        n_continued += found;
    }
}

/// The triangle's normal, as long as twice its area.
fn normal(mesh: &TriMesh, t: usize) -> Vector3<f64> {
    area_vector(mesh.triangles()[t].map(|v| vector(mesh.vertices()[v as usize])))
}

/// The unit vector along `f` less its part along `n`; 0 if nothing is left.
fn in_plane(f: Vector3<f64>, n: Vector3<f64>) -> Vector3<f64> {
    let (f, n) = (unit(f), unit(n));
    let flat = f - n * f.dot(&n);
    if flat.norm() > 1e-9 { unit(flat) } else { Vector3::zeros() }
}

/// `f` with length 1; 0 if it has none, or is not finite.
fn unit(f: Vector3<f64>) -> Vector3<f64> {
    let length = f.norm();
    if length > 0.0 && length.is_finite() { f / length } else { Vector3::zeros() }
}

/// The axis with most of `Σ w f fᵀ`; 0 if all are.
fn axis(weighted: impl Iterator<Item = (f64, Vector3<f64>)>) -> Vector3<f64> {
    let tensor = weighted.fold(Matrix3::zeros(), |sum, (w, f)| sum + w * f * f.transpose());
    if tensor.norm() == 0.0 {
        return Vector3::zeros();
    }
    let eigen = SymmetricEigen::new(tensor);
    eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned()
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "small whole numbers")]
mod tests {
    use super::*;

    /// A sheet in the plane z = 0: areas 1, 1 and 2.
    fn sheet() -> TriMesh {
        let vertices =
            [[0.0, 0.0], [2.0, 0.0], [0.0, 1.0], [2.0, 1.0], [0.0, 3.0]].map(|[x, y]| [x, y, 0.0]);
        TriMesh::new(vertices.to_vec(), vec![[0, 1, 2], [1, 3, 2], [2, 3, 4]]).unwrap()
    }

    #[test]
    fn values_are_averaged_by_area_and_labels_win_by_area() {
        let mesh = sheet();
        let measured = to_vertices(&mesh, &vec![1.5, 3.0, 6.0].into());
        assert_eq!(measured.values(), [1.5, 2.25, (1.5 + 3.0 + 12.0) / 4.0, 5.0, 6.0]);
        let labels = to_vertices(&mesh, &vec![7.0, 7.0, 3.0].into());
        // Vertex 2 has equal areas of both.
        assert_eq!(labels.values(), [7.0, 7.0, 3.0, 3.0, 3.0]);
        let gaps = to_vertices(&mesh, &vec![f64::NAN, 0.5, f64::NAN].into());
        assert!(gaps.values()[0].is_nan() && gaps.values()[2] == 0.5);
    }

    #[test]
    fn fibres_have_no_sign() {
        let mesh = sheet();
        let cells = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [-2.0, 0.0, 0.0]];
        for f in fibres_to_vertices(&mesh, &cells) {
            assert!((f[0].abs() - 1.0).abs() < 1e-12 && f[1].abs() + f[2].abs() < 1e-12, "{f:?}");
        }
        // Vertex 3 has the second and, with twice its area, the third triangle.
        let f = fibres_to_vertices(&mesh, &[[0.0; 3], [1.0, 0.0, 0.0], [f64::NAN, 0.0, 0.0]]);
        assert_eq!((f[0], f[4], f[3][0].abs()), ([0.0; 3], [0.0; 3], 1.0));
        let f = fibres_to_vertices(&mesh, &[[0.0; 3], [0.0, 1.0, 0.0], [0.0, 0.0, -9.0]]);
        assert_eq!((f[3][1].abs(), f[3][2].abs()), (0.0, 1.0));
    }

    #[test]
    fn fibres_of_vertices_lie_in_the_triangles() {
        let vertices = [[1.0, 1.0, 1.0], [-1.0, -1.0, 0.0], [2.0, 2.0, 0.0], [0.0; 3], [0.0; 3]];
        for f in fibres_to_triangles(&sheet(), &vertices) {
            assert!((f[0] - f[1]).abs() < 1e-12 && (f[0].abs() - 0.5f64.sqrt()).abs() < 1e-12);
        }
    }

    /// Along a strip whose first triangles have fibres, into the rest; not into another piece.
    #[test]
    fn fibres_go_on_where_there_are_none() {
        let row = |y: f64| (0..5).map(move |x| [f64::from(x), y, 0.0]);
        let far = [[20.0, 0.0, 0.0], [21.0, 0.0, 0.0], [20.0, 1.0, 0.0]];
        let vertices = row(0.0).chain(row(1.0)).chain(far).collect();
        let strip = (0..4).flat_map(|i| [[i, i + 1, i + 5], [i + 1, i + 6, i + 5]]);
        let mesh = TriMesh::new(vertices, strip.chain([[10, 11, 12]]).collect()).unwrap();
        let slanting = [0.6, 0.8, 0.0];
        let mut fibres = vec![[0.0; 3]; 9];
        (fibres[0], fibres[1]) = (slanting, slanting.map(|x| -x));
        assert_eq!(continue_fibres(&mesh, &mut fibres), 6);
        for fibre in &fibres[2..8] {
            let cosine: f64 = fibre.iter().zip(slanting).map(|(a, b)| a * b).sum();
            assert!((cosine.abs() - 1.0).abs() < 1e-12, "{fibre:?}");
        }
        assert_eq!(fibres[8], [0.0; 3]);
        assert_eq!(continue_fibres(&mesh, &mut fibres), 0);
    }
}
