//! The sum of squared distances from planes, a quadratic function of place.

use super::area_vector;
use nalgebra::{Matrix3, Vector3};
use std::ops::{Add, AddAssign, Mul};

/// `xᵀ A x + 2 bᵀ x + c`, mm⁴.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Quadric {
    a: Matrix3<f64>,
    b: Vector3<f64>,
    c: f64,
}

impl Quadric {
    /// The squared distance from the triangle's plane times its area.
    pub(super) fn of_triangle(corners: [Vector3<f64>; 3]) -> Self {
        let normal = area_vector(corners);
        Self::of_plane(corners[0], normal, 0.5 * normal.norm())
    }

    /// The squared distance from the plane through side `k` that stands upright on the triangle, times the
    /// side's length squared.
    pub(super) fn of_wall(corners: [Vector3<f64>; 3], k: usize) -> Self {
        let side = corners[(k + 1) % 3] - corners[k];
        Self::of_plane(corners[k], side.cross(&area_vector(corners)), side.norm_squared())
    }

    fn of_plane(through: Vector3<f64>, normal: Vector3<f64>, weight: f64) -> Self {
        let n = normal.normalize();
        let d = -n.dot(&through);
        Self { a: n * n.transpose(), b: n * d, c: d * d } * weight
    }

    /// Its value.
    pub(super) fn at(&self, x: Vector3<f64>) -> f64 {
        (x.dot(&(self.a * x)) + 2.0 * self.b.dot(&x) + self.c).max(0.0)
    }
}

impl Add for Quadric {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { a: self.a + other.a, b: self.b + other.b, c: self.c + other.c }
    }
}

impl AddAssign for Quadric {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Mul<f64> for Quadric {
    type Output = Self;

    fn mul(self, weight: f64) -> Self {
        Self { a: self.a * weight, b: self.b * weight, c: self.c * weight }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_squared_and_weighted() {
        let corners = [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [0.0, 3.0, 1.0]].map(Vector3::from);
        let at = |q: Quadric, p: [f64; 3]| q.at(p.into());
        let plane = Quadric::of_triangle(corners);
        assert!((at(plane, [9.0, 9.0, 3.0]) - 3.0 * 4.0).abs() < 1e-12);
        let wall = Quadric::of_wall(corners, 0);
        assert!((at(wall, [5.0, 0.5, -7.0]) - 4.0 * 0.25).abs() < 1e-12);
        assert!((at(plane + wall * 2.0, [0.0, 1.0, 2.0]) - (3.0 + 8.0)).abs() < 1e-12);
    }
}
