//! How steep functions on a surface are.

use super::laplacian::{cross, dot, subtract};
use crate::mesh::TriMesh;

/// The gradient of functions on a surface: at each vertex the mean over its triangles, by area, in each of which
/// functions are linear.
///
/// Its error falls with the edges; on a flat sheet a linear function has none.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// The first of each vertex' entries, and their number at the end (n_vertices + 1).
    first: Vec<u32>,
    /// A vertex, and what a unit there adds to the gradient, mm⁻¹.
    entries: Vec<(u32, [f64; 3])>,
}

impl Gradient {
    /// Prepares a surface.
    pub fn new(mesh: &TriMesh) -> Self {
        let mut own: Vec<Vec<(u32, [f64; 3])>> = vec![vec![]; mesh.n_vertices()];
        let mut area = vec![0.0; mesh.n_vertices()];
        for corners in mesh.triangles() {
            let [p, q, r] = corners.map(|v| mesh.vertices()[v as usize]);
            let normal = cross(subtract(q, p), subtract(r, p));
            let twice = dot(normal, normal).sqrt();
            // a triangle without area has no gradient
            if twice <= 0.0 {
                continue;
            }
            // twice its area times the gradient of the function that is 1 at this corner and 0 at the others
            let of_corner = [subtract(r, q), subtract(p, r), subtract(q, p)]
                .map(|opposite| cross(normal, opposite).map(|x| x / twice));
            for at in corners.map(|v| v as usize) {
                area[at] += twice;
                for (corner, slope) in corners.iter().zip(of_corner) {
                    match own[at].iter_mut().find(|(v, _)| v == corner) {
                        Some((_, sum)) => (0..3).for_each(|k| sum[k] += slope[k]),
                        None => own[at].push((*corner, slope)),
                    }
                }
            }
        }
        let (mut first, mut entries) = (vec![0], vec![]);
        for (own, area) in own.into_iter().zip(area) {
            entries.extend(own.into_iter().map(|(v, sum)| (v, sum.map(|x| x / area))));
            first.push(entries.len() as u32);
        }
        Self { first, entries }
    }

    /// Number of vertices of the surface.
    pub fn n_vertices(&self) -> usize {
        self.first.len() - 1
    }

    fn of(&self, vertex: usize) -> &[(u32, [f64; 3])] {
        &self.entries[self.first[vertex] as usize..self.first[vertex + 1] as usize]
    }

    /// The gradient of a function (n_vertices) at a vertex, its unit per mm.
    pub fn at(&self, vertex: usize, values: &[f64]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (v, slope) in self.of(vertex) {
            (0..3).for_each(|k| sum[k] += values[*v as usize] * slope[k]);
        }
        sum
    }

    /// The length of that gradient.
    pub fn length(&self, vertex: usize, values: &[f64]) -> f64 {
        let gradient = self.at(vertex, values);
        dot(gradient, gradient).sqrt()
    }

    /// The change of the length for a small `change` of the function (n_vertices); none where the function is flat,
    /// for there the length has a kink.
    pub fn push(&self, vertex: usize, values: &[f64], change: &[f64]) -> f64 {
        dot(self.direction(vertex, values), self.at(vertex, change))
    }

    /// Adds to `into` (n_vertices) the adjoint of the function, for that of the length.
    pub fn pull(&self, vertex: usize, values: &[f64], bar: f64, into: &mut [f64]) {
        let direction = self.direction(vertex, values);
        for (v, slope) in self.of(vertex) {
            into[*v as usize] += bar * dot(direction, *slope);
        }
    }

    /// The unit vector along the gradient, zero where there is none.
    fn direction(&self, vertex: usize, values: &[f64]) -> [f64; 3] {
        let gradient = self.at(vertex, values);
        let length = dot(gradient, gradient).sqrt();
        if length > 0.0 { gradient.map(|x| x / length) } else { [0.0; 3] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifold::test_meshes::{icosphere, rectangle};

    #[test]
    fn a_linear_function_on_a_sheet_has_its_own_slope() {
        let mesh = rectangle(12, 9, 0.7);
        let values: Vec<f64> = mesh.vertices().iter().map(|p| 2.0 * p[0] - 1.5 * p[1]).collect();
        let gradient = Gradient::new(&mesh);
        for vertex in 0..mesh.n_vertices() {
            let [x, y, z] = gradient.at(vertex, &values);
            assert!((x - 2.0).abs() + (y + 1.5).abs() + z.abs() < 1e-12, "{vertex}: {x} {y} {z}");
        }
    }

    /// Root mean square error of the slope of z on a sphere of radius 20 mm, which is the sine of the polar angle.
    fn error(level: usize) -> f64 {
        let mesh = icosphere(level, 20.0);
        let values: Vec<f64> = mesh.vertices().iter().map(|p| p[2]).collect();
        let gradient = Gradient::new(&mesh);
        let square = |(v, p): (usize, &[f64; 3])| {
            let exact = (1.0 - (p[2] / 20.0).powi(2)).max(0.0).sqrt();
            (gradient.length(v, &values) - exact).powi(2)
        };
        let sum: f64 = mesh.vertices().iter().enumerate().map(square).sum();
        (sum / mesh.n_vertices() as f64).sqrt()
    }

    #[test]
    fn on_a_sphere_the_error_falls_with_the_edges() {
        let [coarse, fine] = [3, 4].map(error);
        println!("{coarse} {fine}");
        assert!(coarse < 0.02 && fine < 0.6 * coarse, "{coarse} {fine}");
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let mesh = icosphere(2, 10.0);
        let gradient = Gradient::new(&mesh);
        let n = mesh.n_vertices();
        let wave = |k: f64| move |p: &[f64; 3]| (k * p[0]).sin() + (0.3 * k * p[1] * p[2]).cos();
        let values: Vec<f64> = mesh.vertices().iter().map(wave(0.2)).collect();
        let change: Vec<f64> = mesh.vertices().iter().map(wave(0.31)).collect();
        for vertex in (0..n).step_by(7) {
            let moved = |by: f64| -> Vec<f64> {
                values.iter().zip(&change).map(|(x, d)| x + by * d).collect()
            };
            let difference = (gradient.length(vertex, &moved(1e-5))
                - gradient.length(vertex, &moved(-1e-5)))
                / 2e-5;
            let pushed = gradient.push(vertex, &values, &change);
            let mut bar = vec![0.0; n];
            gradient.pull(vertex, &values, 1.0, &mut bar);
            let pulled: f64 = bar.iter().zip(&change).map(|(b, d)| b * d).sum();
            assert!((pushed - difference).abs() < 1e-8, "{vertex}: {pushed} {difference}");
            assert!((pulled - pushed).abs() < 1e-12, "{vertex}: {pulled} {pushed}");
        }
    }
}
