//! The medium of each triangle, and how long its sides are in ms.
//!
//! ```text
//! s, r, φ    means of the corners' slowness, ratio and angle
//! f, g       the fibre, turned by φ, and across it
//! |d|² = s² ((f·d)² + r² (g·d)²)      time along the displacement d, squared
//! ```
//! `(s f·d, s r g·d)` is `d` in coordinates in which time is the usual length: the *timed* plane.

use super::Medium;
use super::geometry::{Geometry, Triangle};

/// Medium of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tissue {
    /// ms/mm
    pub(super) slowness: f64,
    pub(super) ratio: f64,
    /// Cosine and sine of the angle.
    pub(super) turn: [f64; 2],
}

/// Lengths of a triangle in the timed plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Timed {
    /// The side opposite each corner, ms.
    pub(super) sides: [f64; 3],
    /// Twice the area, ms².
    pub(super) area: f64,
}

impl Tissue {
    pub(super) fn of(medium: &Medium<'_>, triangle: &Triangle) -> Self {
        let mean = |values: &[f64]| triangle.mean(values);
        let turn = medium.angle.map_or([1.0, 0.0], |angle| {
            let (sin, cos) = mean(angle).sin_cos();
            [cos, sin]
        });
        let ratio = medium.ratio.map_or(1.0, mean);
        Self { slowness: mean(medium.slowness), ratio, turn }
    }

    /// A displacement in the timed plane, ms.
    pub(super) fn timed(&self, d: [f64; 2]) -> [f64; 2] {
        let [cos, sin] = self.turn;
        let (along, across) = (cos * d[0] + sin * d[1], cos * d[1] - sin * d[0]);
        [self.slowness * along, self.slowness * self.ratio * across]
    }

    /// Derivatives of the time along a displacement of 1 ms in the direction `n` of the timed plane, by
    /// slowness, ratio and angle.
    ///
    /// ```text
    /// ½ nᵀ dM n = ds/s + n_g² dr/r + n_f n_g (1 − r²)/r dφ
    /// ```
    pub(super) fn derivative(&self, n: [f64; 2]) -> [f64; 3] {
        let Self { slowness, ratio, .. } = *self;
        let by_angle = n[0] * n[1] * (1.0 - ratio * ratio) / ratio;
        [1.0 / slowness, n[1] * n[1] / ratio, by_angle]
    }
}

impl Timed {
    pub(super) fn of(triangle: &Triangle, tissue: &Tissue) -> Self {
        let [p, q, r] = triangle.points;
        let length = |from: [f64; 2], to: [f64; 2]| {
            let [x, y] = tissue.timed([to[0] - from[0], to[1] - from[1]]);
            (x * x + y * y).sqrt()
        };
        let area = tissue.slowness * tissue.slowness * tissue.ratio * triangle.area;
        Self { sides: [length(q, r), length(r, p), length(p, q)], area }
    }
}

/// Both for every triangle, into vectors that are used again.
pub(super) fn measure(
    geometry: &Geometry,
    medium: &Medium<'_>,
    tissue: &mut Vec<Tissue>,
    timed: &mut Vec<Timed>,
) {
    tissue.clear();
    tissue.extend(geometry.triangles.iter().map(|t| Tissue::of(medium, t)));
    timed.clear();
    timed.extend(geometry.triangles.iter().zip(&*tissue).map(|(t, tissue)| Timed::of(t, tissue)));
}

/// Changes both to this slowness (n_vertices).
pub(super) fn slow_down(
    geometry: &Geometry,
    slowness: &[f64],
    tissue: &mut [Tissue],
    timed: &mut [Timed],
) {
    for (triangle, (tissue, timed)) in geometry.triangles.iter().zip(tissue.iter_mut().zip(timed)) {
        let times = triangle.mean(slowness) / tissue.slowness;
        tissue.slowness *= times;
        timed.sides = timed.sides.map(|side| side * times);
        timed.area *= times * times;
    }
}
