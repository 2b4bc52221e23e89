//! From a triangle mesh to the rows of its mass and stiffness.

use nalgebra::Vector3;

use super::Substrate;
use crate::mesh::TriMesh;

/// Columns (vertices) and entries (mass, mm²; stiffness with the diffusivity in it, mm²/ms) of a row.
pub(super) type Row = Vec<(u32, [f64; 2])>;

/// The rows of all vertices, by vertex. A triangle has the mean diffusivity, or tensor, of its corners.
pub(super) fn rows(substrate: &Substrate<'_>) -> Vec<Row> {
    let Substrate { mesh, tissue, .. } = substrate;
    let mut rows: Vec<Row> = vec![Vec::with_capacity(8); mesh.n_vertices()];
    for corners in mesh.triangles() {
        let points = corners.map(|v| Vector3::from(mesh.vertices()[v as usize]));
        let diffusivity = corners.map(|v| tissue[v as usize].diffusivity);
        let (mass, stiffness) = element(points, diffusivity, substrate.fibres_at(*corners));
        for k in 0..3 {
            let row = &mut rows[corners[k] as usize];
            for l in 0..3 {
                let at = row.iter().position(|(j, _)| *j == corners[l]).unwrap_or(row.len());
                if at == row.len() {
                    row.push((corners[l], [0.0; 2]));
                }
                row[at].1[0] += mass[k][l];
                row[at].1[1] += stiffness[k][l];
            }
        }
    }
    rows
}

/// Mass and stiffness of a triangle; with fibres, the diffusivity along them at its corners, their unit
/// vectors and D across over D along.
///
/// ```text
/// M_kl = area (1 + δ_kl)/12
/// K_kl = area ∇φ_k · T ∇φ_l,   T = mean over the corners of D_across I + (D_along − D_across) f fᵀ
/// ```
/// with f laid into the triangle.
fn element(
    corner: [Vector3<f64>; 3],
    diffusivity: [f64; 3],
    fibres: Option<([Vector3<f64>; 3], f64)>,
) -> ([[f64; 3]; 3], [[f64; 3]; 3]) {
    let side = [corner[2] - corner[1], corner[0] - corner[2], corner[1] - corner[0]];
    let twice = side[0].cross(&side[1]);
    let area = 0.5 * twice.norm();
    let entries = |of: &dyn Fn(usize, usize) -> f64| {
        std::array::from_fn(|k| std::array::from_fn(|l| of(k, l)))
    };
    let mass = entries(&|k, l| area / if k == l { 6.0 } else { 12.0 });
    // ∇φ_k is the opposite side turned by 90°, over twice the area
    let isotropic = |k: usize, l: usize| side[k].dot(&side[l]) / (4.0 * area);
    let mean = diffusivity.iter().sum::<f64>() / 3.0;
    let Some((fibres, across)) = fibres else {
        return (mass, entries(&|k, l| mean * isotropic(k, l)));
    };
    let normal = twice / (2.0 * area);
    // f · ∇φ_k √area, at each corner
    let slopes = fibres.map(|fibre| {
        let fibre = (fibre - normal * fibre.dot(&normal)).normalize();
        side.map(|side| fibre.dot(&normal.cross(&side)) / (2.0 * area.sqrt()))
    });
    let extra = |k: usize, l: usize| {
        let of_corner = slopes.iter().zip(diffusivity).map(|(s, d)| d * s[k] * s[l]);
        (1.0 - across) * of_corner.sum::<f64>() / 3.0
    };
    (mass, entries(&|k, l| across * mean * isotropic(k, l) + extra(k, l)))
}

/// Vertices along a Z-order curve (Morton 1966): stretches of it are compact patches, so that a front
/// touches few of them.
pub(super) fn patches(mesh: &TriMesh) -> Vec<u32> {
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
    use crate::mesh::left_atrium;

    /// The stiffness of one triangle against `∫ ∇φ_k · T ∇φ_l` of a hand-written tensor.
    #[test]
    fn a_triangle_has_the_stiffness_of_its_tensor() {
        let corner = [[0.0; 3], [2.0, 0.0, 0.0], [0.5, 1.5, 0.0]].map(Vector3::from);
        let angle = 0.4_f64;
        let fibre = Vector3::new(angle.cos(), angle.sin(), 0.0);
        let (along, across) = (0.3, 0.25);
        let (_, stiffness) = element(corner, [along; 3], Some(([fibre, -fibre, fibre], across)));
        let (c, s) = (angle.cos(), angle.sin());
        let t = |a: f64, b: f64| along * (a * b + across * (1.0 - a * b));
        let off = along * (1.0 - across) * c * s;
        let (txx, tyy) = (t(c, c), t(s, s));
        // gradients of the hat functions, from their plane equations
        let gradient = [[-0.5, -0.5], [0.5, -1.0 / 6.0], [0.0, 2.0 / 3.0]];
        for (k, a) in gradient.iter().enumerate() {
            for (l, b) in gradient.iter().enumerate() {
                let form =
                    txx * a[0] * b[0] + tyy * a[1] * b[1] + off * (a[0] * b[1] + a[1] * b[0]);
                assert!((stiffness[k][l] - 1.5 * form).abs() < 1e-14, "{k} {l}");
            }
        }
    }

    #[test]
    fn fibres_of_ratio_one_change_no_bit() {
        let corner = [[0.0, 0.1, 0.7], [2.0, 0.0, 0.0], [0.5, 1.5, 0.3]].map(Vector3::from);
        let fibre = Vector3::new(0.6, 0.8, 0.0);
        let with = element(corner, [0.1, 0.2, 0.4], Some(([fibre; 3], 1.0)));
        assert_eq!(with, element(corner, [0.1, 0.2, 0.4], None));
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
