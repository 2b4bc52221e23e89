//! A procedural left atrium: body with mitral opening, four open pulmonary veins and an appendage.
//!
//! A blended distance field is triangulated, cut open at five planes and remeshed to the wanted edge
//! length.  Deterministic: no random numbers, and the same for any number of threads.

mod polygonise;
mod remesh;
mod shape;

use super::{TriMesh, topology};
use remesh::Remesher;
use shape::Shape;
use std::ops::RangeInclusive;

/// Names of the regions; [`Atrium::region`] holds indices of this list.
pub const REGION_NAMES: [&str; 7] = ["body", "LSPV", "LIPV", "RSPV", "RIPV", "LAA", "mitral rim"];

/// A left atrium with five openings (four veins, mitral valve), mm.
#[derive(Clone, Debug)]
pub struct Atrium {
    /// The surface: one piece, Euler characteristic −3, triangles oriented outwards.
    pub mesh: TriMesh,
    /// For each vertex an index of [`REGION_NAMES`].
    pub region: Vec<u8>,
}

impl Atrium {
    /// Edge lengths [`left_atrium`] can make, mm: longer ones no longer resolve the veins.
    pub const EDGE_RANGE: RangeInclusive<f64> = 0.2..=3.0;
}

/// Edge of the first, rough triangulation, mm: fine enough for the thinnest part (4 mm).
const ROUGH: f64 = 2.5;
/// Rounds of remeshing at the final edge length.
const N_PASSES: usize = 7;

/// The left atrium with edges of about `edge_mm` (1.5 gives 5,200 vertices, 0.3 gives 124,000).
///
/// # Panics
/// If `edge_mm` is not in [`Atrium::EDGE_RANGE`].
pub fn left_atrium(edge_mm: f64) -> Atrium {
    assert!(Atrium::EDGE_RANGE.contains(&edge_mm), "edge length {edge_mm} mm is out of range");
    let shape = Shape::left_atrium();
    let mut soup = polygonise::polygonise(&shape, ROUGH);
    keep_largest_piece(&mut soup);
    let mut remesher = Remesher::new(&shape, soup);
    let mut edge = edge_mm.max(1.5);
    remesher.pass(edge);
    while edge > edge_mm {
        edge = edge_mm.max(0.6 * edge);
        remesher.pass(edge);
    }
    for _ in 0..N_PASSES {
        remesher.pass(edge);
    }
    for _ in 0..4 {
        remesher.smooth();
    }
    remesher.project(5);
    let (positions, triangles) = remesher.finish();
    let region = positions.iter().map(|p| shape.region(p)).collect();
    let vertices = positions.into_iter().map(Into::into).collect();
    #[allow(clippy::expect_used, reason = "the remesher keeps a manifold of finite positions")]
    let mesh = TriMesh::new(vertices, triangles).expect("a valid surface");
    Atrium { mesh, region }
}

/// Drops crumbs the cuts may leave beyond the openings' reach.
fn keep_largest_piece(soup: &mut polygonise::Soup) {
    let piece = topology::pieces(soup.positions.len(), &soup.triangles);
    let mut sizes = vec![0; soup.positions.len()];
    for triangle in &soup.triangles {
        sizes[piece[triangle[0] as usize] as usize] += 1;
    }
    let largest = (0..sizes.len()).max_by_key(|&p| sizes[p]);
    soup.triangles.retain(|t| Some(piece[t[0] as usize] as usize) == largest);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(edge_mm: f64) -> Atrium {
        let atrium = left_atrium(edge_mm);
        let mesh = &atrium.mesh;
        println!(
            "edge {edge_mm}: {} vertices, mean edge {:.3} mm, area {:.1} cm², min angle {:.1}°",
            mesh.n_vertices(),
            mesh.mean_edge_length(),
            mesh.area() / 100.0,
            mesh.min_angle()
        );
        assert_eq!(mesh.n_components(), 1);
        assert_eq!(mesh.euler_characteristic(), -3);
        assert_eq!(mesh.boundary_loops().len(), 5);
        assert!(mesh.min_angle() >= 20.0, "smallest angle {}", mesh.min_angle());
        assert!((mesh.mean_edge_length() / edge_mm - 1.0).abs() < 0.1);
        atrium
    }

    #[test]
    fn default_atrium_has_the_right_topology_size_and_quality() {
        let atrium = check(1.5);
        assert!((4_500..5_500).contains(&atrium.mesh.n_vertices()));
        // A left atrium measures 80 to 130 cm².
        assert!((80.0..130.0).contains(&(atrium.mesh.area() / 100.0)));
    }

    #[test]
    fn every_edge_length_allowed_works_at_the_coarse_end() {
        check(3.0);
        check(2.1);
        check(1.0);
    }

    #[test]
    #[ignore = "0.3 mm: 6 s in release; run with `cargo test --release --lib atrium -- --ignored`"]
    fn fine_atrium_has_the_right_topology_size_and_quality() {
        let atrium = check(0.3);
        assert!((100_000..130_000).contains(&atrium.mesh.n_vertices()));
    }

    #[test]
    fn four_loops_are_veins_and_one_is_the_mitral_valve() {
        let atrium = left_atrium(1.5);
        let loops = atrium.mesh.boundary_loops();
        let mut regions: Vec<u8> = loops.iter().map(|l| atrium.region[l[0] as usize]).collect();
        regions.sort_unstable();
        let names: Vec<&str> = regions.iter().map(|&r| REGION_NAMES[usize::from(r)]).collect();
        assert_eq!(names, ["LSPV", "LIPV", "RSPV", "RIPV", "mitral rim"]);
        for opening in &loops {
            let region = atrium.region[opening[0] as usize];
            assert!(opening.iter().all(|&v| atrium.region[v as usize] == region));
        }
    }

    #[test]
    fn triangles_run_alike_and_face_outwards() {
        let mesh = left_atrium(2.0).mesh;
        let sides = topology::sides(mesh.triangles());
        assert!(topology::edges(&sides).all(|e| e.len() == 1 || e[0].forward != e[1].forward));
        // Gauss: the flux of x through a closed outward surface is three times its volume, > 0.
        let flux: f64 = mesh
            .triangles()
            .iter()
            .map(|t| {
                let corners = t.map(|v| super::super::vector(mesh.vertices()[v as usize]));
                corners[0].dot(&super::super::area_vector(corners))
            })
            .sum();
        assert!(flux > 0.0);
    }

    #[test]
    fn the_same_for_any_number_of_threads() {
        let with_threads = |n| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
            pool.install(|| left_atrium(2.5))
        };
        let (one, three) = (with_threads(1), with_threads(3));
        assert_eq!(one.mesh, three.mesh);
        assert_eq!(one.region, three.region);
    }

    #[test]
    fn every_region_has_its_vertices() {
        let atrium = left_atrium(1.5);
        for (region, name) in (0..).zip(REGION_NAMES) {
            let vertices: Vec<_> = atrium.region.iter().filter(|&&r| r == region).collect();
            assert!(vertices.len() > 100, "{name}");
        }
    }
}
