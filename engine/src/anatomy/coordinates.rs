//! Universal atrial coordinates of a left atrium: two numbers from 0 to 1 at each of its points, which are the same at
//! the same place of another atrium.
//!
//! The first says where a point lies from the right wall (0) to the left wall (1). The second goes from the mitral valve
//! behind (0) over the roof (½) to the valve in front (1). Each is harmonic in the posterior and in the anterior half,
//! between these values:
//!
//! ```text
//!                      first                      second
//! right, left seam     0, 1                       free
//! valve                free                       0 behind, 1 in front
//! roof                 free                       ½
//! superior veins       half an ellipse each: their posterior halves on the roof, the anterior ones in front of it
//! inferior veins       circles, at the angle at which the veins lie without them
//! ```
//! Places and sizes of the veins are those of an atlas (Roney et al. 2019), in which the walls are landmarks set by hand.

use super::AnatomyError;
use super::openings::{Opening, Openings};
use super::patch::Patch;
use super::seams::Seams;
use super::tubes::{Rim, tubes, turn_mouth};
use super::ways::{Ways, lengths};
use crate::manifold::{Geodesic, harmonic};
use crate::mesh::TriMesh;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// The middle of the left inferior vein; that of the right one is its mirror image.
const INFERIOR: [f64; 2] = [0.87, 0.315];
/// And its radius.
const RADIUS: f64 = 0.02;
/// Half the width of the left superior vein along the roof, which it meets at the wall.
const WIDTH: f64 = 0.115;
/// How far a superior vein reaches in front of the roof.
const HEIGHT: f64 = 0.11;

/// Radius of the rim about the tip of an appendage, as a share of the tip's distance from the openings.
const TIP: f64 = 0.3;

/// Universal atrial coordinates, and others in the veins and the appendage, where these are too coarse.
#[derive(Clone, Debug)]
pub struct Coordinates {
    /// The posterior and the anterior half.
    pub(super) halves: [Patch; 2],
    /// The veins in the order of [`Opening::ALL`], and the appendage if there is one.
    pub(super) tubes: Vec<Patch>,
    n_vertices: usize,
}

impl Coordinates {
    /// Of the left atrium with these openings.
    ///
    /// # Errors
    /// [`AnatomyError`] if the lines between the openings do not divide the surface in two, or a half has no
    /// coordinates.
    pub fn new(mesh: &TriMesh, openings: &Openings) -> Result<Self, AnatomyError> {
        let ways = Ways::new(mesh);
        let seams = Seams::new(mesh, &ways, openings)?;
        let (posterior, [lipv, ripv]) = posterior(mesh, &ways, openings, &seams)?;
        let halves = [posterior, anterior(mesh, &ways, openings, &seams)?];
        let superior = |side: usize| {
            let [behind, before] = &seams.sides[side].arcs;
            let half = |arc: &[u32], turn: f64| -> Vec<(u32, f64)> {
                arc.iter()
                    .copied()
                    .zip(shares(&ways, arc).into_iter().map(|part| turn * PI * part))
                    .collect()
            };
            let inner = before.len() - 1;
            Rim([half(behind, 1.0), half(before, -1.0)[1..inner].to_vec()].concat())
        };
        let mut rims = vec![superior(0), lipv, superior(1), ripv];
        let appendage = appendage(mesh, &ways, openings, &halves[1])?;
        let has_appendage = appendage.is_some();
        rims.extend(appendage);
        let mut tubes = tubes(mesh, openings, &rims)?;
        if let Some(last) = tubes.last_mut().filter(|_| has_appendage) {
            turn_mouth(last, &halves[1]);
        }
        Ok(Self { halves, tubes, n_vertices: mesh.n_vertices() })
    }

    /// Both coordinates at each vertex (n_vertices each). On a seam the second is that of the posterior half.
    pub fn at_vertices(&self) -> [Vec<f64>; 2] {
        [0, 1].map(|k| {
            let mut all = vec![f64::NAN; self.n_vertices];
            for half in self.halves.iter().rev() {
                for (v, x) in half.vertices.iter().zip(&half.at[k]) {
                    all[*v as usize] = *x;
                }
            }
            all
        })
    }
}

/// Values that are known at vertices of the whole surface.
#[derive(Default)]
struct Known(BTreeMap<u32, f64>);

impl Known {
    fn set(&mut self, line: &[u32], value: impl Fn(usize) -> f64) {
        self.0.extend(line.iter().enumerate().map(|(i, v)| (*v, value(i))));
    }
}

/// What the seams, the valve and the roof say of the half with this number.
fn known(openings: &Openings, seams: &Seams, number: u8) -> [Known; 2] {
    let [mut first, mut second] = <[Known; 2]>::default();
    second.set(openings.of(Opening::Mv), |_| f64::from(number));
    second.set(&seams.roof, |_| 0.5);
    for (wall, side) in [1.0, 0.0].into_iter().zip(&seams.sides) {
        first.set(&side.seam, |_| wall);
    }
    [first, second]
}

/// The first coordinate at this distance from the left wall (side 0) or the right one (side 1).
fn from_wall(side: usize, x: f64) -> f64 {
    if side == 0 { 1.0 - x } else { x }
}

/// The posterior half, and both inferior veins.
fn posterior(
    mesh: &TriMesh,
    ways: &Ways,
    openings: &Openings,
    seams: &Seams,
) -> Result<(Patch, [Rim; 2]), AnatomyError> {
    let [mut first, mut second] = known(openings, seams, 0);
    for (side, of) in seams.sides.iter().enumerate() {
        let part = shares(ways, &of.arcs[0]);
        first.set(&of.arcs[0], |i| from_wall(side, 2.0 * WIDTH * part[i]));
        second.set(&of.arcs[0], |_| 0.5);
    }
    let mut half = Patch::new(mesh, seams.halves[0].clone())?;
    solve(&mut half, [&first, &second])?;
    let veins = [(Opening::Lipv, INFERIOR[0]), (Opening::Ripv, 1.0 - INFERIOR[0])];
    let rims = veins.map(|(opening, _)| Rim::turned(ways, openings.of(opening), &half));
    for (rim, (_, middle)) in rims.iter().zip(veins) {
        for (v, angle) in &rim.0 {
            first.set(&[*v], |_| middle + RADIUS * angle.cos());
            second.set(&[*v], |_| INFERIOR[1] + RADIUS * angle.sin());
        }
    }
    solve(&mut half, [&first, &second])?;
    Ok((half, rims))
}

fn anterior(
    mesh: &TriMesh,
    ways: &Ways,
    openings: &Openings,
    seams: &Seams,
) -> Result<Patch, AnatomyError> {
    let [mut first, mut second] = known(openings, seams, 1);
    for (side, of) in seams.sides.iter().enumerate() {
        let part = shares(ways, &of.arcs[1]);
        first.set(&of.arcs[1], |i| from_wall(side, WIDTH * (1.0 - (PI * part[i]).cos())));
        second.set(&of.arcs[1], |i| 0.5 + HEIGHT * (PI * part[i]).sin());
    }
    let mut half = Patch::new(mesh, seams.halves[1].clone())?;
    solve(&mut half, [&first, &second])?;
    Ok(half)
}

fn solve(half: &mut Patch, known: [&Known; 2]) -> Result<(), AnatomyError> {
    for (at, known) in half.at.iter_mut().zip(known) {
        let own = (0u32..).zip(&half.vertices).filter_map(|(i, v)| Some((i, *known.0.get(v)?)));
        let (vertices, values): (Vec<u32>, Vec<f64>) = own.unzip();
        *at = harmonic(&half.mesh, &vertices, &[values])?.swap_remove(0);
    }
    Ok(())
}

/// A rim about the tip of the appendage: of the point that is farthest from all openings, if that lies on the left in
/// front.
fn appendage(
    mesh: &TriMesh,
    ways: &Ways,
    openings: &Openings,
    anterior: &Patch,
) -> Result<Option<Rim>, AnatomyError> {
    let all: Vec<u32> = Opening::ALL.iter().flat_map(|o| openings.of(*o)).copied().collect();
    let distance = Geodesic::distance_once(mesh, &all)?;
    let tip = (0..distance.len()).max_by(|a, b| distance[*a].total_cmp(&distance[*b]));
    let tip = tip.unwrap_or(0) as u32;
    let is_left =
        anterior.vertices.iter().position(|v| *v == tip).is_some_and(|i| anterior.at[0][i] > 0.5);
    if !is_left {
        return Ok(None);
    }
    let from_tip = Geodesic::distance_once(mesh, &[tip])?;
    let is_near = |corners: &[u32; 3]| {
        corners.iter().all(|v| from_tip[*v as usize] < TIP * distance[tip as usize])
    };
    let near: Vec<u32> =
        (0u32..).zip(mesh.triangles()).filter(|(_, c)| is_near(c)).map(|(t, _)| t).collect();
    if near.is_empty() {
        return Ok(None);
    }
    let cap = Patch::new(mesh, near)?;
    let rim = cap.mesh.boundary_loops().into_iter().max_by_key(Vec::len).unwrap_or_default();
    let rim: Vec<u32> = rim.into_iter().map(|i| cap.vertices[i as usize]).collect();
    Ok(Some(Rim::even(ways, &rim)))
}

/// Which share of a line lies before each of its vertices.
fn shares(ways: &Ways, line: &[u32]) -> Vec<f64> {
    let lengths = lengths(ways, line);
    let all = lengths.last().copied().unwrap_or(0.0).max(f64::MIN_POSITIVE);
    lengths.iter().map(|l| l / all).collect()
}
