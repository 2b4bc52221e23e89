//! Coordinates in the veins and the appendage.
//!
//! A harmonic function that is given at the mouth of a tube falls off in it by a factor of e with every radius. So the
//! coordinates of the halves are too coarse there. A tube has its own: how far in a point lies, `u`, and at which angle,
//! both from functions that are harmonic on the whole surface:
//!
//! ```text
//!              u    c        s
//! its rim      1    cos a    sin a        a: the angle along the rim
//! other rims   0    0        0
//! ```
//! The point `u (c, s) / √(c² + s²)` lies in the unit circle. A tube reaches to where u is ½.

use super::AnatomyError;
use super::openings::{Opening, Openings};
use super::patch::Patch;
use super::ways::{Ways, lengths};
use crate::manifold::harmonic;
use crate::mesh::TriMesh;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Where tubes end.
const MOUTH: f64 = 0.5;
/// The points with so much more of `u` are those of the mouth.
const MOUTH_WIDTH: f64 = 0.1;

/// The rim of a tube: its vertices, and the angle of each.
#[derive(Clone, Debug)]
pub(super) struct Rim(pub(super) Vec<(u32, f64)>);

impl Rim {
    /// Angles as the coordinates of `half` have them on the whole, but evenly along the opening `ring`.
    pub(super) fn turned(ways: &Ways, ring: &[u32], half: &Patch) -> Self {
        let at = half.by_vertex();
        let even = even(ways, ring);
        let points = ring.iter().zip(&even).filter_map(|(v, even)| Some((*at.get(v)?, *even)));
        let (way, by) = least_turn(&points.collect::<Vec<_>>());
        Self(ring.iter().zip(even).map(|(v, even)| (*v, by + way * even)).collect())
    }

    /// Angles evenly along `ring`, from its first vertex on.
    pub(super) fn even(ways: &Ways, ring: &[u32]) -> Self {
        Self(ring.iter().copied().zip(even(ways, ring)).collect())
    }
}

fn even(ways: &Ways, ring: &[u32]) -> Vec<f64> {
    // the first follows the last
    let mut closed = ring.to_vec();
    closed.push(ring[0]);
    let lengths = lengths(ways, &closed);
    ring.iter().zip(&lengths).map(|(_, l)| TAU * l / lengths[ring.len()]).collect()
}

/// The sense (1 or −1) and the angle by which to turn the angles of these points so that they become those at which the
/// points lie about their middle, in units of their spread.
fn least_turn(points: &[([f64; 2], f64)]) -> (f64, f64) {
    let n = points.len() as f64;
    let mean = [0, 1].map(|k| points.iter().map(|(p, _)| p[k]).sum::<f64>() / n);
    let spread = [0, 1].map(|k| {
        let square = points.iter().map(|(p, _)| (p[k] - mean[k]).powi(2)).sum::<f64>() / n;
        square.sqrt().max(f64::MIN_POSITIVE)
    });
    let turned = |way: f64| {
        let gaps = points.iter().map(|(p, own)| {
            let [x, y] = [0, 1].map(|k| (p[k] - mean[k]) / spread[k]);
            y.atan2(x) - way * own
        });
        let [x, y] = gaps.fold([0.0; 2], |[x, y], gap| [x + gap.cos(), y + gap.sin()]);
        (x.hypot(y), way, y.atan2(x))
    };
    let (one, other) = (turned(1.0), turned(-1.0));
    let (_, way, by) = if one.0 > other.0 { one } else { other };
    (way, by)
}

/// Turns a tube so that at its mouth it has the angles of the coordinates of `half`.
pub(super) fn turn_mouth(tube: &mut Patch, half: &Patch) {
    let at = half.by_vertex();
    let [x, y] = &mut tube.at;
    let polar = |x: f64, y: f64| (2.0 * (x - 0.5).hypot(y - 0.5), (y - 0.5).atan2(x - 0.5));
    let points = x.iter().zip(&*y).zip(&tube.vertices).filter_map(|((x, y), v)| {
        let (u, angle) = polar(*x, *y);
        Some((*at.get(v).filter(|_| u < MOUTH + MOUTH_WIDTH)?, angle))
    });
    let (way, by) = least_turn(&points.collect::<Vec<_>>());
    for (x, y) in x.iter_mut().zip(y) {
        let (u, angle) = polar(*x, *y);
        let (sin, cos) = (by + way * angle).sin_cos();
        (*x, *y) = (0.5 + 0.5 * u * cos, 0.5 + 0.5 * u * sin);
    }
}

/// The tubes with these rims.
pub(super) fn tubes(
    mesh: &TriMesh,
    openings: &Openings,
    rims: &[Rim],
) -> Result<Vec<Patch>, AnatomyError> {
    let mut at: BTreeMap<u32, (usize, f64)> =
        openings.of(Opening::Mv).iter().map(|v| (*v, (rims.len(), 0.0))).collect();
    for (number, rim) in rims.iter().enumerate() {
        at.extend(rim.0.iter().map(|(v, angle)| (*v, (number, *angle))));
    }
    let known: Vec<u32> = at.keys().copied().collect();
    let own = |number: usize, of: fn(f64) -> f64| -> Vec<f64> {
        let one = |(rim, angle): &(usize, f64)| if *rim == number { of(*angle) } else { 0.0 };
        at.values().map(one).collect()
    };
    let parts: [fn(f64) -> f64; 3] = [|_| 1.0, f64::cos, f64::sin];
    let values: Vec<Vec<f64>> =
        (0..rims.len()).flat_map(|number| parts.map(|part| own(number, part))).collect();
    let found = harmonic(mesh, &known, &values)?;
    found.chunks_exact(3).map(|of| tube(mesh, &of[0], [&of[1], &of[2]])).collect()
}

fn tube(mesh: &TriMesh, u: &[f64], [c, s]: [&[f64]; 2]) -> Result<Patch, AnatomyError> {
    let is_inside =
        |corners: &[u32; 3]| corners.iter().map(|v| u[*v as usize]).sum::<f64>() > 3.0 * MOUTH;
    let inside = (0u32..).zip(mesh.triangles()).filter(|(_, corners)| is_inside(corners));
    let mut patch = Patch::new(mesh, inside.map(|(t, _)| t).collect())?;
    for (i, v) in patch.vertices.iter().map(|v| *v as usize).enumerate() {
        let scale = u[v] / c[v].hypot(s[v]).max(f64::MIN_POSITIVE);
        patch.at[0][i] = 0.5 + 0.5 * scale * c[v];
        patch.at[1][i] = 0.5 + 0.5 * scale * s[v];
    }
    Ok(patch)
}
