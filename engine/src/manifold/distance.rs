//! Distances on a surface, mm: biharmonic from the eigenpairs, geodesic by the heat method.
//!
//! Knows nothing of measurement sites.

use super::cholesky::Cholesky;
use super::laplacian::{cross, dot, require_connected, subtract};
use super::{Basis, Laplacian, ManifoldError};
use crate::mesh::TriMesh;
use faer::MatMut;

/// Modes of the biharmonic distance: its terms fall like 1/λ².
pub(super) const BIHARMONIC_MODES: usize = 32;

/// Biharmonic distance from vertex `from` to every vertex `(n_vertices)`, mm.
///
/// ```text
/// d²(x, y) = Σ_{k ≥ 1} (φ_k(x) − φ_k(y))² / λ_k²     over the first 32 modes, or as many as there are
/// ```
/// Smooth, and a metric on the vertices that the modes tell apart.
///
/// # Panics
/// When `from` is not a vertex of the basis.
///
/// # Source
/// Lipman, Rustamov and Funkhouser 2010, Biharmonic distance.
pub fn biharmonic(basis: &Basis, from: usize) -> Vec<f64> {
    let n_modes = basis.n_modes().min(BIHARMONIC_MODES);
    let origin = basis.at(from);
    let squared = |vertex: usize| -> f64 {
        let here = basis.at(vertex);
        (1..n_modes).map(|k| ((here[k] - origin[k]) / basis.eigenvalues[k]).powi(2)).sum()
    };
    (0..basis.n_vertices()).map(|vertex| squared(vertex).sqrt()).collect()
}

/// Geodesic distances from any set of vertices, after one preparation of the surface.
///
/// ```text
/// (M + t K) u = M 1_sources,   √t = mean edge      heat after a short time
/// X = −∇u / |∇u|                                   per triangle
/// K d = div X                                      d shifted so that sources are at 0 on average
/// ```
/// Errors are a few per cent, more within a few edges of a source.  For one connected surface.
///
/// # Source
/// Crane, Weischedel and Wardetzky 2013, Geodesics in heat.
#[derive(Debug)]
pub struct Geodesic {
    /// `K + M/t`
    heat: Cholesky,
    /// `K`, shifted too little to matter.
    poisson: Cholesky,
    corners: Vec<Corners>,
    mass: Vec<f64>,
}

/// One triangle.
#[derive(Debug)]
struct Corners {
    vertices: [u32; 3],
    /// Gradient of each corner's hat function, mm⁻¹.
    gradients: [[f64; 3]; 3],
    /// mm²
    area: f64,
}

/// `K` is singular; this much of λ₁ moves the distances by as small a part.
const POISSON_SHIFT: f64 = 1e-8;

impl Geodesic {
    /// Factorises the two operators of the surface.
    ///
    /// # Errors
    /// [`ManifoldError::Disconnected`] and factorisation failures.
    pub fn new(mesh: &TriMesh) -> Result<Self, ManifoldError> {
        require_connected(mesh)?;
        let laplacian = Laplacian::new(mesh);
        Ok(Self {
            heat: Cholesky::new(&laplacian, diffusion_length(mesh).powi(-2))?,
            poisson: Cholesky::new(&laplacian, POISSON_SHIFT / laplacian.area())?,
            corners: mesh.triangles().iter().map(|&t| Corners::new(mesh, t)).collect(),
            mass: laplacian.mass,
        })
    }

    /// Distance of every vertex to the nearest of `sources` `(n_vertices)`, mm; infinite when there
    /// are no sources.
    ///
    /// # Panics
    /// When a source is not a vertex of the mesh.
    pub fn distance(&self, sources: &[u32]) -> Vec<f64> {
        if sources.is_empty() {
            return vec![f64::INFINITY; self.mass.len()];
        }
        let mut heat = heated(&self.mass, sources);
        self.heat.solve(column(&mut heat));
        let mut divergence = vec![0.0; self.mass.len()];
        for corners in &self.corners {
            corners.add_divergence(&heat, &mut divergence);
        }
        self.poisson.solve(column(&mut divergence));
        from_sources(divergence, sources)
    }

    /// As [`Geodesic::distance`] of a surface that is asked once. Only one operator is factorised at a time, which takes
    /// less than half of the memory.
    ///
    /// # Errors
    /// Those of [`Geodesic::new`].
    ///
    /// # Panics
    /// When a source is not a vertex of the mesh.
    pub fn distance_once(mesh: &TriMesh, sources: &[u32]) -> Result<Vec<f64>, ManifoldError> {
        require_connected(mesh)?;
        let laplacian = Laplacian::new(mesh);
        if sources.is_empty() {
            return Ok(vec![f64::INFINITY; laplacian.mass.len()]);
        }
        let mut heat = heated(&laplacian.mass, sources);
        Cholesky::new(&laplacian, diffusion_length(mesh).powi(-2))?.solve(column(&mut heat));
        let mut divergence = vec![0.0; laplacian.mass.len()];
        for triangle in mesh.triangles() {
            Corners::new(mesh, *triangle).add_divergence(&heat, &mut divergence);
        }
        let shift = POISSON_SHIFT / laplacian.area();
        Cholesky::new(&laplacian, shift)?.solve(column(&mut divergence));
        Ok(from_sources(divergence, sources))
    }
}

/// Heat at the sources, weighted by area, or the ends of a row of sources would be hotter than its middle.
fn heated(mass: &[f64], sources: &[u32]) -> Vec<f64> {
    let mut heat = vec![0.0; mass.len()];
    for &source in sources {
        heat[source as usize] = mass[source as usize];
    }
    heat
}

/// Shifted so that the sources are at 0 on average, and no distance is negative.
fn from_sources(distance: Vec<f64>, sources: &[u32]) -> Vec<f64> {
    let total: f64 = sources.iter().map(|&source| distance[source as usize]).sum();
    let start = total / sources.len() as f64;
    let mut distance: Vec<f64> = distance.into_iter().map(|d| (d - start).max(0.0)).collect();
    for &source in sources {
        distance[source as usize] = 0.0;
    }
    distance
}

impl Corners {
    fn new(mesh: &TriMesh, vertices: [u32; 3]) -> Self {
        let [a, b, c] = vertices.map(|v| mesh.vertices()[v as usize]);
        let normal = cross(subtract(b, a), subtract(c, a));
        let squared = dot(normal, normal);
        // ∇ of a hat function: the opposite edge turned by 90°, over twice the area.
        let gradients = [(b, c), (c, a), (a, b)]
            .map(|(p, q)| cross(normal, subtract(q, p)).map(|x| x / squared));
        Self { vertices, gradients, area: 0.5 * squared.sqrt() }
    }

    /// Adds `∫ X·∇(hat)` of this triangle, with `X` the unit field down the slope of `heat`.
    fn add_divergence(&self, heat: &[f64], divergence: &mut [f64]) {
        let values = self.vertices.map(|v| heat[v as usize]);
        // Heat falls exponentially: scaled, or its squared gradient underflows far from the source.
        let scale = values.iter().fold(0.0_f64, |largest, v| largest.max(v.abs()));
        if scale == 0.0 {
            return;
        }
        let mut downhill = [0.0; 3];
        for (value, gradient) in values.iter().zip(&self.gradients) {
            for axis in 0..3 {
                downhill[axis] -= value / scale * gradient[axis];
            }
        }
        let slope = norm(downhill);
        if slope > 0.0 {
            for (&vertex, &gradient) in self.vertices.iter().zip(&self.gradients) {
                divergence[vertex as usize] += self.area * dot(downhill, gradient) / slope;
            }
        }
    }
}

/// `√t` in mm: the mean edge, but at least 1/200 of the bounding box's diagonal, because heat falls
/// by e per diffusion length and must not underflow (after some 700) at the far end of a fine mesh.
fn diffusion_length(mesh: &TriMesh) -> f64 {
    let vertices = mesh.vertices();
    let edges = || {
        let corners = mesh.triangles().iter().map(|t| t.map(|v| vertices[v as usize]));
        corners.flat_map(|[a, b, c]| [subtract(b, a), subtract(c, b), subtract(a, c)])
    };
    let mean_edge = edges().map(norm).sum::<f64>() / edges().count() as f64;
    let extent = [0, 1, 2].map(|axis| {
        let along = vertices.iter().map(|v| v[axis]);
        along.clone().fold(f64::MIN, f64::max) - along.fold(f64::MAX, f64::min)
    });
    mean_edge.max(norm(extent) / 200.0)
}

fn column(values: &mut [f64]) -> MatMut<'_, f64> {
    let n = values.len();
    MatMut::from_column_major_slice_mut(values, n, 1)
}

fn norm(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::eigenpairs;
    use super::super::test_meshes::{icosphere, rectangle};
    use super::*;
    use std::f64::consts::PI;

    /// Largest and root-mean-square `|distance − exact| / exact` over vertices at least `from` mm away.
    fn relative_errors(distance: &[f64], exact: &[f64], from: f64) -> (f64, f64) {
        let errors: Vec<f64> = distance
            .iter()
            .zip(exact)
            .filter(|&(_, &e)| e >= from)
            .map(|(d, e)| (d / e - 1.0).abs())
            .collect();
        let squares: f64 = errors.iter().map(|e| e * e).sum();
        (errors.iter().copied().fold(0.0, f64::max), (squares / errors.len() as f64).sqrt())
    }

    #[test]
    fn great_circles_on_a_sphere() {
        let mesh = icosphere(4, 20.0);
        let distance = Geodesic::new(&mesh).unwrap().distance(&[0]);
        let exact: Vec<f64> = mesh
            .vertices()
            .iter()
            .map(|&v| 20.0 * (dot(v, mesh.vertices()[0]) / 400.0).clamp(-1.0, 1.0).acos())
            .collect();
        let (largest, typical) = relative_errors(&distance, &exact, 5.0);
        assert!(largest < 0.05 && typical < 0.02, "largest {largest}, rms {typical}");
        let furthest = distance.iter().copied().fold(0.0, f64::max);
        assert!((furthest / (20.0 * PI) - 1.0).abs() < 0.02, "antipode at {furthest}");
    }

    #[test]
    fn straight_lines_on_a_flat_square_from_a_point_and_from_an_edge() {
        let mesh = rectangle(60, 60, 0.5);
        let geodesic = Geodesic::new(&mesh).unwrap();
        let centre = 30 * 61 + 30;
        let exact: Vec<f64> =
            mesh.vertices().iter().map(|v| (v[0] - 15.0).hypot(v[1] - 15.0)).collect();
        let (largest, typical) = relative_errors(&geodesic.distance(&[centre]), &exact, 3.0);
        assert!(largest < 0.04 && typical < 0.02, "point: largest {largest}, rms {typical}");
        let left: Vec<u32> = (0..=60).map(|j| j * 61).collect();
        let exact: Vec<f64> = mesh.vertices().iter().map(|v| v[0]).collect();
        let (largest, typical) = relative_errors(&geodesic.distance(&left), &exact, 3.0);
        assert!(largest < 0.02 && typical < 0.01, "edge: largest {largest}, rms {typical}");
    }

    #[test]
    fn far_from_the_source_heat_underflows_but_distance_does_not() {
        // 900 edges: heat falls by some exp(−900).
        let mesh = rectangle(900, 2, 0.3);
        let distance = Geodesic::new(&mesh).unwrap().distance(&[900 + 1]);
        assert!((distance[2 * 901 - 1] / 270.0 - 1.0).abs() < 0.02, "{}", distance[2 * 901 - 1]);
    }

    #[test]
    fn sources_are_at_zero_and_no_source_is_infinitely_far() {
        let mesh = icosphere(2, 10.0);
        let geodesic = Geodesic::new(&mesh).unwrap();
        let distance = geodesic.distance(&[3, 40]);
        assert_eq!(Geodesic::distance_once(&mesh, &[3, 40]).unwrap(), distance);
        assert!(distance[3] == 0.0 && distance[40] == 0.0);
        assert!(distance.iter().all(|d| (0.0..10.0 * PI).contains(d)));
        assert!(geodesic.distance(&[]).iter().all(|&d| d == f64::INFINITY));
        assert_eq!(Geodesic::distance_once(&mesh, &[]).unwrap(), geodesic.distance(&[]));
    }

    #[test]
    fn biharmonic_distance_on_a_sphere_depends_on_the_angle_only() {
        // Addition theorem: Σ_m (Y(x) − Y(y))² = (2l+1)/(2π r²) (1 − P_l(cos γ)); 32 modes: l up to 4
        // complete (25) and 7 of l = 5; so compare with the 25.
        let radius = 20.0;
        let mesh = icosphere(4, radius);
        let basis = eigenpairs(&mesh, 25).unwrap();
        let distance = biharmonic(&basis, 0);
        for (vertex, &v) in mesh.vertices().iter().enumerate() {
            let x = dot(v, mesh.vertices()[0]) / (radius * radius);
            let legendre = [
                1.0,
                x,
                0.5 * (3.0 * x * x - 1.0),
                0.5 * (5.0 * x.powi(3) - 3.0 * x),
                0.125 * (35.0 * x.powi(4) - 30.0 * x * x + 3.0),
            ];
            let squared: f64 = (1..5)
                .map(|l| {
                    let (l_f, eigenvalue) = (l as f64, (l * (l + 1)) as f64 / (radius * radius));
                    (2.0 * l_f + 1.0) / (2.0 * PI * radius * radius) * (1.0 - legendre[l])
                        / eigenvalue.powi(2)
                })
                .sum();
            assert!((distance[vertex] - squared.max(0.0).sqrt()).abs() < 1e-3 * radius, "{vertex}");
        }
        assert!(distance[0] == 0.0);
    }
}
