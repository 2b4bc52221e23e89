//! Fibres: directions along which a surface conducts faster than across.

use nalgebra::Vector3;
use thiserror::Error;

use crate::mesh::TriMesh;

/// More than this out of the surface, and a fibre is no direction in it: the sine of 45°.
const MOST_OUT: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Directions and how much faster they conduct.
#[derive(Debug, Clone, PartialEq)]
pub struct Fibres {
    directions: Vec<[f64; 3]>,
    ratio: f64,
    tilt: f64,
}

/// Fibres that a surface cannot have.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum FibreError {
    /// Not a direction for each vertex.
    #[error(
        "the mesh has {vertices} vertices, but there are {got} fibre directions\nhelp: give one for each vertex"
    )]
    Length {
        /// Vertices of the mesh.
        vertices: usize,
        /// Directions.
        got: usize,
    },
    /// A vector of no length, or of none that can be told.
    #[error(
        "the fibre at vertex {vertex} is {fibre:?}, which is no direction ({of_them} such vertices)\n\
         help: give every vertex a direction, for instance the mean of its neighbours'"
    )]
    NoDirection {
        /// The first such vertex.
        vertex: usize,
        /// What is there.
        fibre: [f64; 3],
        /// How many there are.
        of_them: usize,
    },
    /// A direction that leaves the surface.
    #[error(
        "the fibre at vertex {vertex} leaves the surface at {degrees:.0}°\n\
         help: fibres lie in the surface: were mesh and fibres turned or mirrored apart?"
    )]
    OutOfSurface {
        /// The worst vertex.
        vertex: usize,
        /// Its angle to the surface.
        degrees: f64,
    },
    /// A ratio that is none.
    #[error(
        "an anisotropy of {0} is no ratio of conduction velocities\nhelp: give CV along over CV across the fibres, 1 or more; atria have 1.5 to 4"
    )]
    Ratio(f64),
}

impl Fibres {
    /// Of `mesh`: `directions` (n_vertices), whose lengths and signs mean nothing, and `ratio`, CV along
    /// over CV across, so that D across is D along over its square. What points out of the surface is
    /// projected onto it.
    ///
    /// # Errors
    /// [`FibreError`].
    pub fn new(mesh: &TriMesh, directions: &[[f64; 3]], ratio: f64) -> Result<Self, FibreError> {
        let (vertices, got) = (mesh.n_vertices(), directions.len());
        if vertices != got {
            return Err(FibreError::Length { vertices, got });
        }
        if !(ratio >= 1.0 && ratio.is_finite()) {
            return Err(FibreError::Ratio(ratio));
        }
        let length = |fibre: &[f64; 3]| Vector3::from(*fibre).norm();
        let has_none = |fibre: &[f64; 3]| !(length(fibre) > 1e-12 && length(fibre).is_finite());
        if let Some(vertex) = directions.iter().position(has_none) {
            let of_them = directions.iter().filter(|fibre| has_none(fibre)).count();
            return Err(FibreError::NoDirection { vertex, fibre: directions[vertex], of_them });
        }
        let (mut tilt, mut worst) = (0.0, 0);
        let mut project = |(vertex, (fibre, normal)): (usize, (&[f64; 3], Vector3<f64>))| {
            let unit = Vector3::from(*fibre).normalize();
            let out = unit.dot(&normal);
            if out.abs() > tilt {
                (tilt, worst) = (out.abs(), vertex);
            }
            (unit - normal * out).normalize().into()
        };
        let along = directions.iter().zip(normals(mesh)).enumerate();
        let directions: Vec<[f64; 3]> = along.map(&mut project).collect();
        let tilt_degrees = tilt.asin().to_degrees();
        if tilt > MOST_OUT {
            return Err(FibreError::OutOfSurface { vertex: worst, degrees: tilt_degrees });
        }
        Ok(Self { directions, ratio, tilt: tilt_degrees })
    }

    /// Unit vectors in the surface (n_vertices).
    pub fn directions(&self) -> &[[f64; 3]] {
        &self.directions
    }

    /// Most that a given direction pointed out of the surface, degrees.
    pub fn tilt(&self) -> f64 {
        self.tilt
    }

    /// D across over D along.
    pub(super) fn across(&self) -> f64 {
        1.0 / (self.ratio * self.ratio)
    }
}

/// Unit normals of the vertices, each the mean of its triangles' weighted by area.
fn normals(mesh: &TriMesh) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); mesh.n_vertices()];
    for corners in mesh.triangles() {
        let [a, b, c] = corners.map(|v| Vector3::from(mesh.vertices()[v as usize]));
        let normal = (b - a).cross(&(c - a));
        for v in corners {
            // orientations may differ from triangle to triangle
            let sum: &mut Vector3<f64> = &mut normals[*v as usize];
            *sum += if sum.dot(&normal) < 0.0 { -normal } else { normal };
        }
    }
    normals.into_iter().map(|normal| normal.normalize()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::left_atrium;

    fn triangle() -> TriMesh {
        let vertices = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        TriMesh::new(vertices, vec![[0, 1, 2]]).unwrap()
    }

    #[test]
    fn directions_are_laid_into_the_surface() {
        let given = [[3.0, 0.0, 0.0], [0.0, -2.0, 1.0], [1.0, 1.0, 0.0]];
        let fibres = Fibres::new(&triangle(), &given, 2.0).unwrap();
        assert_eq!(fibres.directions()[..2], [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]);
        assert!((fibres.tilt() - 0.5_f64.atan().to_degrees()).abs() < 1e-9);
        assert!((fibres.across() - 0.25).abs() < 1e-15);
    }

    #[test]
    fn what_is_no_fibre_is_named() {
        let said = |directions: &[[f64; 3]], ratio: f64| {
            Fibres::new(&triangle(), directions, ratio).unwrap_err().to_string()
        };
        let x = [1.0, 0.0, 0.0];
        assert!(said(&[x], 2.0).contains("3 vertices, but there are 1"));
        assert!(
            said(&[x, [0.0; 3], [f64::NAN; 3]], 2.0).contains("at vertex 1 is [0.0, 0.0, 0.0]")
        );
        assert!(said(&[x, [0.0; 3], [f64::NAN; 3]], 2.0).contains("(2 such vertices)"));
        assert!(said(&[x, x, [1.0, 0.0, 2.0]], 2.0).contains("vertex 2 leaves the surface at 63°"));
        assert!(said(&[x; 3], 0.5).contains("anisotropy of 0.5"));
        assert!(said(&[x; 3], f64::NAN).contains("anisotropy"));
    }

    #[test]
    fn normals_do_not_depend_on_the_orientation_of_triangles() {
        let mesh = left_atrium(3.0).mesh;
        let mut turned = mesh.triangles().to_vec();
        turned.iter_mut().step_by(2).for_each(|t| t.swap(0, 1));
        let turned = TriMesh::new(mesh.vertices().to_vec(), turned).unwrap();
        for (a, b) in normals(&mesh).into_iter().zip(normals(&turned)) {
            assert!(a.dot(&b).abs() > 0.99);
        }
    }
}
