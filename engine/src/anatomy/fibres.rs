//! Fibres carried from one atrium to another by their coordinates.

use super::{coordinates::Coordinates, patch::Patch};
use crate::manifold::Gradient;
use nalgebra::{Matrix2, Vector2, Vector3};
use rayon::prelude::*;

/// Squares along each coordinate in which triangles are looked up.
const SQUARES: usize = 128;
/// Least squared sine of the angle between the directions in which the two coordinates grow. Below it fibres cannot be
/// carried.
const FLAT: f64 = 1e-3;

/// The fibres of an atrium (one for each triangle), carried to the triangles of another: the direction along which the
/// coordinates change as they do along the fibre at the same place. Unit vectors; 0 where there is none.
pub fn carry_fibres(from: &Coordinates, fibres: &[[f64; 3]], to: &Coordinates) -> Vec<[f64; 3]> {
    let n: usize = to.halves.iter().map(|half| half.triangles.len()).sum();
    let mut carried = vec![[0.0; 3]; n];
    // tubes last: they know better
    let pairs = from.halves.iter().zip(&to.halves).chain(from.tubes.iter().zip(&to.tubes));
    for (from, to) in pairs {
        let (there, here) = (Chart::new(from), Chart::new(to));
        let squares = Squares::new(&there.middles);
        let one = |t: usize| {
            let source = squares.nearest(&there.middles, here.middles[t]);
            let fibre = Vector3::from(fibres[from.triangles[source] as usize]);
            here.back(t, there.along(source, fibre)).unwrap_or_else(Vector3::zeros)
        };
        let all: Vec<Vector3<f64>> = (0..to.triangles.len()).into_par_iter().map(one).collect();
        for (t, fibre) in to.triangles.iter().zip(all) {
            carried[*t as usize] = fibre.into();
        }
    }
    carried
}

/// The coordinates of a patch, triangle by triangle.
struct Chart {
    /// In the middle of each.
    middles: Vec<[f64; 2]>,
    /// How both grow, mm⁻¹: the mean over the corners, each of which has the mean over its triangles.
    gradients: Vec<[Vector3<f64>; 2]>,
}

impl Chart {
    fn new(half: &Patch) -> Self {
        let gradient = Gradient::new(&half.mesh);
        let at_vertex: [Vec<Vector3<f64>>; 2] = half.at.each_ref().map(|values| {
            (0..half.mesh.n_vertices()).map(|v| gradient.at(v, values).into()).collect()
        });
        let one = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|v| Vector3::from(half.mesh.vertices()[v as usize]));
            let normal = (b - a).cross(&(c - a)).normalize();
            at_vertex.each_ref().map(|of| {
                let sum: Vector3<f64> = corners.iter().map(|v| of[*v as usize]).sum();
                (sum - normal * sum.dot(&normal)) / 3.0
            })
        };
        let middle = |corners: &[u32; 3]| {
            half.at.each_ref().map(|of| corners.iter().map(|v| of[*v as usize]).sum::<f64>() / 3.0)
        };
        let triangles = half.mesh.triangles();
        Self {
            middles: triangles.iter().map(middle).collect(),
            gradients: triangles.iter().map(one).collect(),
        }
    }

    /// How the coordinates change along a direction.
    fn along(&self, triangle: usize, direction: Vector3<f64>) -> Vector2<f64> {
        let [first, second] = &self.gradients[triangle];
        Vector2::new(first.dot(&direction), second.dot(&direction))
    }

    /// The unit vector in a triangle along which the coordinates change in these proportions.
    fn back(&self, triangle: usize, change: Vector2<f64>) -> Option<Vector3<f64>> {
        let [first, second] = &self.gradients[triangle];
        let products = Matrix2::new(
            first.norm_squared(),
            first.dot(second),
            first.dot(second),
            second.norm_squared(),
        );
        let flat = FLAT * products.m11 * products.m22;
        let weights = Some(products).filter(|p| p.determinant() > flat)?.try_inverse()? * change;
        (first * weights.x + second * weights.y).try_normalize(0.0)
    }
}

/// Points by the square in which they lie.
struct Squares(Vec<Vec<u32>>);

impl Squares {
    fn new(points: &[[f64; 2]]) -> Self {
        let mut squares = vec![vec![]; SQUARES * SQUARES];
        for (i, point) in (0u32..).zip(points) {
            let [x, y] = point.map(square_of);
            squares[x * SQUARES + y].push(i);
        }
        Self(squares)
    }

    /// The nearest of the points: of those in the squares up to some distance, once one is no farther than that.
    fn nearest(&self, points: &[[f64; 2]], at: [f64; 2]) -> usize {
        let [x, y] = at.map(square_of);
        let square = |i: u32| {
            let [a, b] = points[i as usize];
            (a - at[0]).powi(2) + (b - at[1]).powi(2)
        };
        let mut best: Option<(f64, u32)> = None;
        for reach in 0..SQUARES {
            let range = |i: usize| i.saturating_sub(reach)..=(i + reach).min(SQUARES - 1);
            for (i, j) in range(x).flat_map(|i| range(y).map(move |j| (i, j))) {
                if i.abs_diff(x).max(j.abs_diff(y)) == reach {
                    let all = self.0[i * SQUARES + j].iter().map(|own| (square(*own), *own));
                    best = all.chain(best).min_by(|a, b| a.0.total_cmp(&b.0));
                }
            }
            let sure = reach as f64 / SQUARES as f64;
            if best.is_some_and(|(square, _)| square <= sure * sure) {
                break;
            }
        }
        best.map_or(0, |(_, i)| i as usize)
    }
}

fn square_of(x: f64) -> usize {
    ((x * SQUARES as f64) as usize).min(SQUARES - 1)
}
