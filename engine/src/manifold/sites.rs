//! Where to measure: sites spread over a surface, away from its openings.
//!
//! Knows nothing of what is measured.

use super::laplacian::{dot, subtract};
use super::{Geodesic, ManifoldError};
use crate::mesh::TriMesh;
use crate::random::procedure;
use rand::{RngExt, seq::index};

/// Sweeps of the exchange before it is stopped; a few are usual.
const MAX_SWEEPS: usize = 50;

/// Random designs the paper's rule compares.
const DRAWS: usize = 100_000;

/// `n_sites` vertices whose smallest geodesic distance to one another is large.
///
/// Vertices within `exclude_mm` of an opening in a straight line are left out, so every site is at
/// least as far from it along the surface.  Farthest-point start from
/// a vertex chosen by `seed`, then exchange: each site in turn moves to the vertex farthest from
/// the others, until none gains.
///
/// # Errors
/// [`ManifoldError::TooFewVertices`], [`ManifoldError::ExcludedBand`], and those of [`Geodesic::new`].
pub fn maximin(
    mesh: &TriMesh,
    n_sites: usize,
    exclude_mm: f64,
    seed: u64,
) -> Result<Vec<u32>, ManifoldError> {
    let geodesic = Geodesic::new(mesh)?;
    let eligible = eligible(mesh, n_sites, exclude_mm)?;
    if n_sites == 0 {
        return Ok(vec![]);
    }
    let first = eligible[procedure(seed).random_range(0..eligible.len())];
    let mut design =
        Design { geodesic: &geodesic, eligible: &eligible, sites: vec![], fields: vec![] };
    design.push(first);
    while design.sites.len() < n_sites {
        let (site, _) = design.farthest(None);
        design.push(site);
    }
    for _ in 0..MAX_SWEEPS {
        if !design.exchange() {
            break;
        }
    }
    Ok(design.sites)
}

/// The paper's rule: the best of 100,000 random draws of `n_sites` vertices.
///
/// Best is the largest smallest distance between two sites.  Differs from the paper: the text does
/// not say which distance; straight lines are used here, for 100,000 draws meet all pairs of vertices.
///
/// # Errors
/// Those of [`maximin`].
///
/// # Source
/// Coveney et al. 2022, Methods, "Synthetic experiments": a maximin design excluding sites within
/// 0.6 cm of the boundaries.
pub fn random_maximin(
    mesh: &TriMesh,
    n_sites: usize,
    exclude_mm: f64,
    seed: u64,
) -> Result<Vec<u32>, ManifoldError> {
    let eligible = eligible(mesh, n_sites, exclude_mm)?;
    let places: Vec<[f64; 3]> = eligible.iter().map(|&v| mesh.vertices()[v as usize]).collect();
    let mut random = procedure(seed);
    let (mut best, mut best_squared) = (vec![], -1.0);
    for _ in 0..DRAWS {
        let draw = index::sample(&mut random, eligible.len(), n_sites).into_vec();
        let squared = smallest_squared_distance(&draw, &places);
        if squared > best_squared {
            (best, best_squared) = (draw, squared);
        }
    }
    Ok(best.into_iter().map(|index| eligible[index]).collect())
}

/// The vertex nearest to `point` in a straight line, and how far it is, mm.
pub fn nearest_vertex(mesh: &TriMesh, point: [f64; 3]) -> (u32, f64) {
    let mut nearest = (0, f64::INFINITY);
    for (vertex, &place) in mesh.vertices().iter().enumerate() {
        let squared = squared_distance(place, point);
        if squared < nearest.1 {
            nearest = (vertex as u32, squared);
        }
    }
    (nearest.0, nearest.1.sqrt())
}

/// Sites chosen so far, each with the geodesic distance of every vertex to it.
struct Design<'a> {
    geodesic: &'a Geodesic,
    eligible: &'a [u32],
    sites: Vec<u32>,
    fields: Vec<Vec<f64>>,
}

impl Design<'_> {
    fn push(&mut self, site: u32) {
        self.sites.push(site);
        self.fields.push(self.geodesic.distance(&[site]));
    }

    /// Distance of a vertex to the nearest site other than number `left_out`, mm.
    fn gap(&self, vertex: u32, left_out: Option<usize>) -> f64 {
        let others = self.fields.iter().enumerate().filter(|&(site, _)| Some(site) != left_out);
        others.map(|(_, field)| field[vertex as usize]).fold(f64::INFINITY, f64::min)
    }

    /// The eligible vertex, not yet a site, farthest from the sites other than `left_out`; its gap.
    fn farthest(&self, left_out: Option<usize>) -> (u32, f64) {
        let mut best = (self.eligible[0], -1.0);
        for &vertex in self.eligible.iter().filter(|vertex| !self.sites.contains(vertex)) {
            let gap = self.gap(vertex, left_out);
            if gap > best.1 {
                best = (vertex, gap);
            }
        }
        best
    }

    /// Moves each site once, if that widens its gap; whether any moved.
    fn exchange(&mut self) -> bool {
        let mut moved = false;
        for site in 0..self.sites.len() {
            let (vertex, gap) = self.farthest(Some(site));
            if gap > self.gap(self.sites[site], Some(site)) {
                self.sites[site] = vertex;
                self.fields[site] = self.geodesic.distance(&[vertex]);
                moved = true;
            }
        }
        moved
    }
}

/// Vertices at least `exclude_mm` from every opening, at least `n_sites` of them.
fn eligible(mesh: &TriMesh, n_sites: usize, exclude_mm: f64) -> Result<Vec<u32>, ManifoldError> {
    if !(exclude_mm.is_finite() && exclude_mm >= 0.0) {
        return Err(ManifoldError::ExcludedBand { exclude_mm });
    }
    let place = |vertex: u32| mesh.vertices()[vertex as usize];
    let openings: Vec<[f64; 3]> = boundary_vertices(mesh).into_iter().map(place).collect();
    let is_clear = |&vertex: &u32| {
        openings
            .iter()
            .all(|&edge| squared_distance(edge, place(vertex)) >= exclude_mm * exclude_mm)
    };
    let eligible: Vec<u32> = (0..mesh.n_vertices() as u32).filter(is_clear).collect();
    if eligible.len() < n_sites {
        return Err(ManifoldError::TooFewVertices {
            n_sites,
            available: eligible.len(),
            exclude_mm,
        });
    }
    Ok(eligible)
}

/// Vertices of edges that belong to one triangle only, ascending.
fn boundary_vertices(mesh: &TriMesh) -> Vec<u32> {
    let mut edges: Vec<[u32; 2]> = mesh
        .triangles()
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    let single = edges.chunk_by(|a, b| a == b).filter(|copies| copies.len() == 1);
    let mut vertices: Vec<u32> = single.flat_map(|copies| copies[0]).collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

fn smallest_squared_distance(draw: &[usize], places: &[[f64; 3]]) -> f64 {
    let mut smallest = f64::INFINITY;
    for (position, &one) in draw.iter().enumerate() {
        for &other in &draw[..position] {
            smallest = smallest.min(squared_distance(places[one], places[other]));
        }
    }
    smallest
}

fn squared_distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let offset = subtract(a, b);
    dot(offset, offset)
}

#[cfg(test)]
mod tests {
    use super::super::test_meshes::{icosphere, rectangle};
    use super::*;

    /// Smallest geodesic distance between two of `sites`, mm.
    fn spread(mesh: &TriMesh, sites: &[u32]) -> f64 {
        let geodesic = Geodesic::new(mesh).unwrap();
        let mut smallest = f64::INFINITY;
        for &one in sites {
            let distance = geodesic.distance(&[one]);
            for &other in sites.iter().filter(|&&other| other != one) {
                smallest = smallest.min(distance[other as usize]);
            }
        }
        smallest
    }

    #[test]
    fn two_sites_on_a_sphere_are_antipodal() {
        let mesh = icosphere(3, 10.0);
        let sites = maximin(&mesh, 2, 6.0, 1).unwrap();
        let [a, b] = [0, 1].map(|i| mesh.vertices()[sites[i] as usize]);
        assert!(dot(a, b) < -0.97 * 100.0, "{a:?} {b:?}");
    }

    #[test]
    fn four_sites_on_a_square_reach_its_corners_or_stay_off_its_edge() {
        let mesh = rectangle(40, 40, 1.0);
        let mut corners = maximin(&mesh, 4, 0.0, 3).unwrap();
        corners.sort_unstable();
        assert_eq!(corners, [0, 40, 40 * 41, 40 * 41 + 40]);
        for site in maximin(&mesh, 4, 6.0, 3).unwrap() {
            let [x, y, _] = mesh.vertices()[site as usize];
            let inset = x.min(y).min(40.0 - x).min(40.0 - y);
            assert!((6.0..7.5).contains(&inset), "{inset} mm from the edge");
        }
    }

    #[test]
    fn exchange_beats_the_papers_random_draws() {
        let mesh = icosphere(3, 30.0);
        let ours = spread(&mesh, &maximin(&mesh, 10, 6.0, 1).unwrap());
        let paper = spread(&mesh, &random_maximin(&mesh, 10, 6.0, 1).unwrap());
        assert!(ours > 1.1 * paper, "{ours} mm against {paper} mm");
        // One draw alone is far worse than the best of 100,000: the comparison does something.
        let single: Vec<u32> = (0..10).map(|i| i * 37).collect();
        assert!(paper > 1.5 * spread(&mesh, &single));
    }

    #[test]
    fn every_eligible_vertex_can_be_a_site_but_no_more() {
        let mesh = rectangle(4, 4, 5.0);
        let mut all = maximin(&mesh, 25, 0.0, 0).unwrap();
        all.sort_unstable();
        assert_eq!(all, (0..25).collect::<Vec<u32>>());
        let error = maximin(&mesh, 10, 6.0, 0).unwrap_err();
        assert!(matches!(error, ManifoldError::TooFewVertices { n_sites: 10, .. }), "{error}");
        assert!(random_maximin(&mesh, 26, 0.0, 0).is_err());
        for width in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(maximin(&mesh, 2, width, 0), Err(ManifoldError::ExcludedBand { .. })));
        }
    }

    #[test]
    fn the_seed_decides_and_repeats() {
        let mesh = icosphere(3, 10.0);
        assert_eq!(maximin(&mesh, 5, 0.0, 7).unwrap(), maximin(&mesh, 5, 0.0, 7).unwrap());
        assert_ne!(maximin(&mesh, 5, 0.0, 7).unwrap(), maximin(&mesh, 5, 0.0, 8).unwrap());
        let draw = random_maximin(&mesh, 5, 0.0, 7).unwrap();
        assert_eq!(draw, random_maximin(&mesh, 5, 0.0, 7).unwrap());
    }

    #[test]
    fn the_nearest_vertex_and_its_distance() {
        let mesh = rectangle(4, 4, 1.0);
        let (vertex, distance) = nearest_vertex(&mesh, [2.1, 3.0, 2.0]);
        assert_eq!(vertex, 3 * 5 + 2);
        assert!((distance - 0.1_f64.hypot(2.0)).abs() < 1e-14);
    }
}
