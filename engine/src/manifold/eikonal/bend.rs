//! By how much a front is slower for spreading.
//!
//! ```text
//! slowing = div(θ M⁻¹ ∇T)      θ the thickness, T the arrivals of fronts that bend at no cost
//! ```
//! M⁻¹∇T is the velocity of activation, and its divergence the rate at which a piece of the front grows. It is computed
//! with linear elements, as a mean over the vertices of the triangles at each vertex: the divergence at one alone is
//! rough. Those at the border of the surface are left out, for what lies beyond would be needed. Where fronts meet T
//! has a kink, and at a source a corner, so slowing is kept within [`LIMITS`].
//!
//! # Source
//! Keener, "An eikonal-curvature equation for action potential propagation in myocardium", J. Math. Biol. 29 (1991).

use super::geometry::{Geometry, Triangle};
use super::metric::Tissue;
use super::way::NONE;
use super::{Medium, MediumBar};

/// What slowing is kept within.
const LIMITS: std::ops::RangeInclusive<f64> = -0.05..=1.0;

/// Arrivals as a linear function in one triangle, and what flows there.
struct Piece<'a> {
    corners: [usize; 3],
    tissue: &'a Tissue,
    /// Gradient of the function that is 1 at a corner and 0 at the others, 1/mm.
    slopes: &'a [[f64; 2]; 3],
    /// mm²
    area: f64,
}

impl<'a> Piece<'a> {
    fn new(triangle: &'a Triangle, tissue: &'a Tissue) -> Self {
        Self {
            corners: triangle.corners.map(|v| v as usize),
            tissue,
            slopes: &triangle.slopes,
            area: 0.5 * triangle.area,
        }
    }

    fn mean(&self, values: &[f64]) -> f64 {
        self.corners.iter().map(|v| values[*v]).sum::<f64>() / 3.0
    }

    fn gradient(&self, values: &[f64]) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for (v, slope) in self.corners.iter().zip(self.slopes) {
            (0..2).for_each(|k| sum[k] += values[*v] * slope[k]);
        }
        sum
    }
}

/// Dot products with the fibre and with the direction across it.
fn along_and_across(tissue: &Tissue, x: [f64; 2]) -> [f64; 2] {
    let [cos, sin] = tissue.turn;
    [cos * x[0] + sin * x[1], cos * x[1] - sin * x[0]]
}

/// aᵀ M⁻¹ b
fn flow(tissue: &Tissue, a: [f64; 2], b: [f64; 2]) -> f64 {
    let [a, b] = [a, b].map(|x| along_and_across(tissue, x));
    let Tissue { slowness, ratio, .. } = tissue;
    (a[0] * b[0] + a[1] * b[1] / (ratio * ratio)) / (slowness * slowness)
}

/// Derivatives of aᵀ M⁻¹ b by slowness, ratio and angle.
fn flow_by_medium(tissue: &Tissue, a: [f64; 2], b: [f64; 2]) -> [f64; 3] {
    let [p, q] = [a, b].map(|x| along_and_across(tissue, x));
    let Tissue { slowness, ratio, .. } = tissue;
    let (fast, slow) = (slowness.powi(-2), (slowness * ratio).powi(-2));
    let across = p[1] * q[1] * slow;
    [
        -2.0 / slowness * (p[0] * q[0] * fast + across),
        -2.0 / ratio * across,
        (fast - slow) * (p[0] * q[1] + p[1] * q[0]),
    ]
}

/// Where the surface has no border, and the areas of which a vertex takes the mean.
#[derive(Clone, Debug)]
pub(super) struct Patches {
    /// 0 at the border, 1 elsewhere.
    inner: Vec<f64>,
    /// 1 over the sum of the areas, mm⁻²; 0 where no vertex is inside (n_vertices).
    inverse: Vec<f64>,
}

impl Patches {
    pub(super) fn new(geometry: &Geometry) -> Self {
        let mut inner = vec![1.0; geometry.n_vertices()];
        for triangle in &geometry.triangles {
            for side in (0..3).filter(|side| triangle.beyond[*side] == NONE) {
                for k in 1..3 {
                    inner[triangle.corners[(side + k) % 3] as usize] = 0.0;
                }
            }
        }
        let mut areas = vec![0.0; inner.len()];
        for triangle in &geometry.triangles {
            for v in triangle.corners.map(|v| v as usize) {
                areas[v] += inner[v] * triangle.area / 6.0;
            }
        }
        let sum = |area: &f64| if *area > 0.0 { area.recip() } else { 0.0 };
        let inverse = sums(geometry, &areas).iter().map(sum).collect();
        Self { inner, inverse }
    }
}

/// At each vertex the sum over the corners of its triangles. As a matrix this is symmetric.
fn sums(geometry: &Geometry, values: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; values.len()];
    for triangle in &geometry.triangles {
        let corners = triangle.corners.map(|v| v as usize);
        let sum: f64 = corners.iter().map(|v| values[*v]).sum();
        for v in corners {
            out[v] += sum;
        }
    }
    out
}

/// Slowing of the fronts that arrive at `arrival`.
#[derive(Clone, Copy)]
pub(super) struct Bend<'a> {
    pub(super) geometry: &'a Geometry,
    pub(super) patches: &'a Patches,
    /// Of each triangle.
    pub(super) tissue: &'a [Tissue],
    /// θ, ms (n_vertices)
    pub(super) thickness: &'a [f64],
    /// ms (n_vertices)
    pub(super) arrival: &'a [f64],
}

impl Bend<'_> {
    /// Those with a thickness that are reached.
    fn pieces(&self) -> impl Iterator<Item = Piece<'_>> {
        let all = self.geometry.triangles.iter().zip(self.tissue);
        all.map(|(triangle, tissue)| Piece::new(triangle, tissue))
            .filter(|piece| piece.corners.iter().all(|v| self.arrival[*v].is_finite()))
    }

    /// At each vertex the mean over the vertices of its triangles. Given are, at each vertex, values times areas.
    fn mean(&self, of: &[f64]) -> Vec<f64> {
        let mut means = sums(self.geometry, of);
        means.iter_mut().zip(&self.patches.inverse).for_each(|(mean, inverse)| *mean *= inverse);
        means
    }

    /// At each vertex (n_vertices).
    pub(super) fn slowing(&self) -> Vec<f64> {
        let mut out = vec![0.0; self.arrival.len()];
        for piece in self.pieces() {
            let gradient = piece.gradient(self.arrival);
            let weight = piece.mean(self.thickness) * piece.area;
            for (v, slope) in piece.corners.iter().zip(piece.slopes) {
                out[*v] -= weight * self.patches.inner[*v] * flow(piece.tissue, *slope, gradient);
            }
        }
        let mut slowing = self.mean(&out);
        for x in &mut slowing {
            *x = x.clamp(*LIMITS.start(), *LIMITS.end());
        }
        slowing
    }

    /// Change of the slowing (n_vertices) with the medium and the arrivals.
    pub(super) fn push(&self, slowing: &[f64], change: &Medium<'_>, arrival: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; slowing.len()];
        for piece in self.pieces() {
            let (gradient, moved) = (piece.gradient(self.arrival), piece.gradient(arrival));
            let mean = |values: Option<&[f64]>| values.map_or(0.0, |values| piece.mean(values));
            let d = [mean(Some(change.slowness)), mean(change.ratio), mean(change.angle)];
            let (thickness, thicker) = (piece.mean(self.thickness), mean(change.thickness));
            for (v, slope) in piece.corners.iter().zip(piece.slopes) {
                let by = flow_by_medium(piece.tissue, *slope, gradient);
                let by_medium = (0..3).map(|k| by[k] * d[k]).sum::<f64>();
                let change = thicker * flow(piece.tissue, *slope, gradient)
                    + thickness * (flow(piece.tissue, *slope, moved) + by_medium);
                out[*v] -= piece.area * self.patches.inner[*v] * change;
            }
        }
        let mut out = self.mean(&out);
        for (out, slowing) in out.iter_mut().zip(slowing) {
            *out *= free(*slowing);
        }
        out
    }

    /// Adds the adjoint of medium and arrivals for the adjoint `bar` of the slowing (n_vertices).
    pub(super) fn pull(
        &self,
        slowing: &[f64],
        bar: &[f64],
        into: &mut MediumBar<'_>,
        arrival: &mut [f64],
    ) {
        let Patches { inner, inverse } = self.patches;
        let of = |v: usize| free(slowing[v]) * bar[v] * inverse[v];
        let mut bar = sums(self.geometry, &(0..slowing.len()).map(of).collect::<Vec<f64>>());
        bar.iter_mut().zip(inner).for_each(|(bar, inner)| *bar *= inner);
        for piece in self.pieces() {
            let (gradient, pulled) = (piece.gradient(self.arrival), piece.gradient(&bar));
            let weight = piece.mean(self.thickness) * piece.area;
            for (v, slope) in piece.corners.iter().zip(piece.slopes) {
                arrival[*v] -= weight * flow(piece.tissue, *slope, pulled);
            }
            let by = flow_by_medium(piece.tissue, pulled, gradient).map(|by| -weight * by / 3.0);
            let thicker = -piece.area * flow(piece.tissue, pulled, gradient) / 3.0;
            into.add(piece.corners, by);
            if let Some(thickness) = &mut into.thickness {
                piece.corners.iter().for_each(|v| thickness[*v] += thicker);
            }
        }
    }
}

/// 1 where a slowing lies between its limits and changes with what it depends on, else 0.
fn free(slowing: f64) -> f64 {
    f64::from(u8::from(*LIMITS.start() < slowing && slowing < *LIMITS.end()))
}
