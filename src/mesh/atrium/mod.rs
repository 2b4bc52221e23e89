//! A procedural left atrium: body with mitral opening, four open pulmonary veins and an appendage.
//!
//! A blended distance field is triangulated, cut open at five planes and remeshed to the wanted edge
//! length.  Deterministic: no random numbers, and the same for any number of threads.

mod connectivity;
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

/// The left atrium with edges of about `edge_mm` (1.5 gives 5,000 vertices, 0.3 gives 110,000).
///
/// # Panics
/// If `edge_mm` is not in [`Atrium::EDGE_RANGE`].
pub fn left_atrium(edge_mm: f64) -> Atrium {
    assert!(Atrium::EDGE_RANGE.contains(&edge_mm), "edge length {edge_mm} mm is out of range");
    let shape = Shape::left_atrium();
    let mut soup = polygonise::polygonise(&shape, ROUGH);
    keep_first_piece(&mut soup);
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

/// Rounds of remeshing at the final edge length.
const N_PASSES: usize = 7;

/// Drops crumbs the cuts may leave beyond the openings' reach.
fn keep_first_piece(soup: &mut polygonise::Soup) {
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
        for (region, name) in (0..).zip(REGION_NAMES) {
            let vertices = atrium.region.iter().filter(|&&r| r == region);
            assert!(vertices.collect::<Vec<_>>().len() > 100, "{name}");
        }
    }
}
