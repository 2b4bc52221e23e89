//! Straight lines from a source over the unfolded triangles around it.
//!
//! A front starts at a point, where no linear arrival fits.  So the vertices near a source are reached by the straight
//! lines to them: the time along one is the sum over the triangles it crosses.  Which triangles these are is a matter of
//! the surface alone, so that the time changes smoothly with the medium.  What a bent way would gain there, where the
//! medium changes within the radius, is left out.

use super::geometry::{Blade, Geometry, Triangle};
use super::metric::Tissue;
use super::way::NONE;
use std::sync::Arc;

/// Radius in which vertices are reached straight, in mean edges at the source.
const RADIUS: f64 = 5.0;
/// No line crosses more triangles: on thin ones it would take long, and gain nothing.
const MOST_CROSSED: usize = 30;
/// Parts of a line that are shorter than this part of it are left out.
const LEAST: f64 = 1e-12;

/// Straight lines from all sources.
#[derive(Debug, Default)]
pub(super) struct Rays {
    /// What they were traced on, unless there are none.
    geometry: Option<Arc<Geometry>>,
    /// The vertices they begin at.
    sources: Vec<u32>,
    /// The number of each source, or [`NONE`] if a neighbour of it is a source, too: together they are a line or a
    /// region. Lines lead out of a region only.
    pub(super) own: Vec<u32>,
    all: Vec<Ray>,
    pieces: Vec<Piece>,
    /// The last line to each vertex, or [`NONE`].
    last: Vec<u32>,
    chain: Vec<Link>,
}

/// One line from a source to a vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) source: u32,
    pub(super) to: u32,
    /// The line to the same vertex before this one, or [`NONE`].
    before: u32,
    /// Its parts.
    start: u32,
    end: u32,
}

/// The part of a line within one triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    pub(super) triangle: u32,
    /// In the triangle's frame, mm.
    pub(super) step: [f64; 2],
}

impl Piece {
    /// ms
    fn time(&self, tissue: &[Tissue]) -> f64 {
        norm(tissue[self.triangle as usize].timed(self.step))
    }
}

/// What a front is later by for its thickness θ on a part of its line, `θ ln((end + θ)/(begin + θ))`, and the
/// derivatives of this; that by the beginning without its sign.
struct Late {
    by: f64,
    by_begin: f64,
    by_end: f64,
    by_thickness: f64,
}

impl Late {
    fn new(begin: f64, end: f64, thickness: f64) -> Self {
        if thickness <= 0.0 {
            return Self { by: 0.0, by_begin: 0.0, by_end: 0.0, by_thickness: 0.0 };
        }
        let [by_begin, by_end] = [begin, end].map(|tau| thickness / (tau + thickness));
        let ln = ((end + thickness) / (begin + thickness)).ln();
        Self { by: thickness * ln, by_begin, by_end, by_thickness: ln + by_end - by_begin }
    }
}

/// A triangle laid into the plane of the source's, the source at (0, 0).
#[derive(Clone, Copy, Debug)]
struct Link {
    triangle: u32,
    /// Ends of the side that it is entered through.
    side: [[f64; 2]; 2],
    /// Unit vectors along that side and on into the triangle: in the plane, and in its own frame.
    in_plane: [[f64; 2]; 2],
    own: [[f64; 2]; 2],
}

/// A side that a source sees through those before it, from right to left.
#[derive(Clone, Copy)]
struct Window {
    /// The triangle beyond.
    beyond: u32,
    ends: [u32; 2],
    at: [[f64; 2]; 2],
    /// Directions between which the source sees.
    wedge: [[f64; 2]; 2],
}

/// Where lines begin, and how long they may be, mm.
#[derive(Clone, Copy)]
struct Source {
    number: u32,
    radius: f64,
}

impl Rays {
    /// From these vertices.
    pub(super) fn new(geometry: &Arc<Geometry>, sources: Vec<u32>) -> Self {
        let mut sorted = sources.clone();
        sorted.sort_unstable();
        let mut new = Self { last: vec![NONE; geometry.n_vertices()], ..Self::default() };
        for (number, vertex) in (0..).zip(&sources) {
            let neighbours = geometry.fan(*vertex).iter().flat_map(|blade| blade.others);
            let mut are_sources = neighbours.map(|v| sorted.binary_search(&v).is_ok());
            let (is_lone, is_inner) = (!are_sources.clone().any(|is| is), are_sources.all(|is| is));
            new.own.push(if is_lone { number } else { NONE });
            new.trace(geometry, *vertex, number, !is_inner);
        }
        Self { geometry: Some(Arc::clone(geometry)), sources, ..new }
    }

    /// Whether they are those from these vertices.
    pub(super) fn are_from(&self, geometry: &Arc<Geometry>, sources: &[u32]) -> bool {
        self.geometry.as_ref().is_some_and(|own| Arc::ptr_eq(own, geometry))
            && self.sources == sources
    }

    pub(super) fn len(&self) -> u32 {
        self.all.len() as u32
    }

    pub(super) fn ray(&self, index: u32) -> &Ray {
        &self.all[index as usize]
    }

    /// A line to `vertex`, if there is one.
    pub(super) fn first_to(&self, vertex: u32) -> Option<u32> {
        Some(self.last[vertex as usize]).filter(|&index| index != NONE)
    }

    /// Another line to the vertex that line `index` leads to.
    pub(super) fn next_to(&self, index: u32) -> Option<u32> {
        Some(self.ray(index).before).filter(|&index| index != NONE)
    }

    /// The parts of a line.
    pub(super) fn pieces(&self, ray: &Ray) -> &[Piece] {
        &self.pieces[ray.start as usize..ray.end as usize]
    }

    /// Time along a line, ms.
    pub(super) fn time(&self, ray: &Ray, tissue: &[Tissue]) -> f64 {
        self.pieces(ray).iter().map(|piece| piece.time(tissue)).sum()
    }

    /// The same of a front with a `thickness` θ (of each triangle, ms): after a time τ it grows at the rate 1/τ, and is
    /// that much later, `dT = dτ + θ/(τ + θ) dτ`, where θ in the sum ends what no front can be, a point.
    pub(super) fn late_time(&self, ray: &Ray, tissue: &[Tissue], thickness: &[f64]) -> f64 {
        let (mut tau, mut late) = (0.0, 0.0);
        for piece in self.pieces(ray) {
            let (from, thickness) = (tau, thickness[piece.triangle as usize]);
            tau += piece.time(tissue);
            late += Late::new(from, tau, thickness).by;
        }
        tau + late
    }

    /// Tells `visit` of each part of a line, and of the derivatives of [`Self::late_time`] by the time along it and by
    /// the thickness there.
    pub(super) fn late_slopes(
        &self,
        ray: &Ray,
        tissue: &[Tissue],
        thickness: &[f64],
        mut visit: impl FnMut(&Piece, f64, f64),
    ) {
        let (mut until, mut beyond) = (self.time(ray, tissue), 1.0);
        for piece in self.pieces(ray).iter().rev() {
            let from = until - piece.time(tissue);
            let late = Late::new(from.max(0.0), until, thickness[piece.triangle as usize]);
            visit(piece, beyond + late.by_end, late.by_thickness);
            beyond += late.by_end - late.by_begin;
            until = from;
        }
    }

    /// Adds the line without parts from `vertex`, which is source number `number`, to itself, and all others if
    /// `is_all`.
    fn trace(&mut self, geometry: &Geometry, vertex: u32, number: u32, is_all: bool) {
        let fan = geometry.fan(vertex);
        let edges = fan.iter().flat_map(|blade| {
            let points = &geometry.triangles[blade.triangle as usize].points;
            let i = blade.corner as usize;
            [1, 2].map(|k| norm(minus(points[(i + k) % 3], points[i])))
        });
        let radius = RADIUS * edges.sum::<f64>() / (2 * fan.len()) as f64;
        let source = Source { number, radius };
        self.chain.clear();
        self.add(source, vertex, [0.0; 2]);
        if !is_all {
            return;
        }
        for &Blade { triangle: t, corner, .. } in fan {
            let (triangle, i) = (&geometry.triangles[t as usize], corner as usize);
            let place = |k: usize| minus(triangle.points[k], triangle.points[i]);
            let mut ends = [(i + 1) % 3, (i + 2) % 3];
            if cross(place(ends[0]), place(ends[1])) < 0.0 {
                ends.swap(0, 1);
            }
            let at = ends.map(place);
            let axes = [[1.0, 0.0], [0.0, 1.0]];
            self.chain.clear();
            self.chain.push(Link { triangle: t, side: at, in_plane: axes, own: axes });
            for k in 0..2 {
                self.add(source, triangle.corners[ends[k]], at[k]);
            }
            let ends = ends.map(|k| triangle.corners[k]);
            let window = Window { beyond: triangle.beyond[i], ends, at, wedge: at };
            self.look(geometry, source, window);
        }
    }

    /// Adds the lines to what is seen through a window.
    fn look(&mut self, geometry: &Geometry, source: Source, window: Window) {
        let Window { beyond, ends, at, wedge } = window;
        if beyond == NONE || self.chain.len() > MOST_CROSSED || window.distance() > source.radius {
            return;
        }
        let triangle = &geometry.triangles[beyond as usize];
        let corner = |v: u32| triangle.corners.iter().position(|&c| c == v).unwrap_or(0);
        let [right, left] = ends.map(corner);
        let top = 3 - right - left;
        let (link, place) = unfold(triangle, beyond, [right, left, top], at);
        self.chain.push(link);
        let is_seen = cross(wedge[0], place) >= 0.0 && cross(place, wedge[1]) >= 0.0;
        if is_seen && norm(place) <= source.radius {
            self.add(source, triangle.corners[top], place);
        }
        let apex = triangle.corners[top];
        let to_right = Window {
            beyond: triangle.beyond[left],
            ends: [ends[0], apex],
            at: [at[0], place],
            wedge: [wedge[0], if cross(place, wedge[1]) > 0.0 { place } else { wedge[1] }],
        };
        let to_left = Window {
            beyond: triangle.beyond[right],
            ends: [apex, ends[1]],
            at: [place, at[1]],
            wedge: [if cross(wedge[0], place) > 0.0 { place } else { wedge[0] }, wedge[1]],
        };
        for window in [to_right, to_left] {
            if cross(window.wedge[0], window.wedge[1]) > 0.0 {
                self.look(geometry, source, window);
            }
        }
        self.chain.pop();
    }

    /// Adds the line to vertex `to`, which lies at `place` in the plane, through all triangles of the chain.
    fn add(&mut self, source: Source, to: u32, place: [f64; 2]) {
        let start = self.pieces.len() as u32;
        let mut from = 0.0;
        for (k, link) in self.chain.iter().enumerate() {
            // entered at the share τ of the line: τ place = right + μ (left − right)
            let until = self.chain.get(k + 1).map_or(1.0, |next| {
                let [right, left] = next.side;
                cross(right, left) / cross(place, minus(left, right))
            });
            if until - from < LEAST {
                continue; // through a corner
            }
            let [x, y] = link.in_plane.map(|axis| (until - from) * dot(axis, place));
            let step = [0, 1].map(|i| x * link.own[0][i] + y * link.own[1][i]);
            self.pieces.push(Piece { triangle: link.triangle, step });
            from = until;
        }
        let end = self.pieces.len() as u32;
        let before = std::mem::replace(&mut self.last[to as usize], self.all.len() as u32);
        self.all.push(Ray { source: source.number, to, before, start, end });
    }
}

impl Window {
    /// From the source to the nearest point seen in the window, mm.
    fn distance(&self) -> f64 {
        let [right, left] = self.at;
        let along = minus(left, right);
        // right + μ along is in the direction d where cross(right, d) + μ cross(along, d) = 0
        let meets = |d: [f64; 2]| -cross(right, d) / cross(along, d);
        let (low, high) = (meets(self.wedge[0]), meets(self.wedge[1]));
        let nearest = -dot(right, along) / dot(along, along);
        let share = nearest.max(low).min(high);
        norm([right[0] + share * along[0], right[1] + share * along[1]])
    }
}

/// Lays the triangle `index` down beyond the side `at`, and says where its third corner comes to lie;
/// `corners` are those at the side's right and left end, and the third.
fn unfold(
    triangle: &Triangle,
    index: u32,
    corners: [usize; 3],
    at: [[f64; 2]; 2],
) -> (Link, [f64; 2]) {
    let [right, left, top] = corners.map(|k| triangle.points[k]);
    let (along, _) = unit(minus(left, right));
    let rise = minus(top, right);
    let x = dot(rise, along);
    let (into, y) = unit([rise[0] - x * along[0], rise[1] - x * along[1]]);
    let (plane_along, _) = unit(minus(at[1], at[0]));
    let away = [plane_along[1], -plane_along[0]];
    let place = [0, 1].map(|k| at[0][k] + x * plane_along[k] + y * away[k]);
    let in_plane = [plane_along, away];
    (Link { triangle: index, side: at, in_plane, own: [along, into] }, place)
}

fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn norm(a: [f64; 2]) -> f64 {
    dot(a, a).sqrt()
}

/// A vector's direction and length.
fn unit(a: [f64; 2]) -> ([f64; 2], f64) {
    let length = norm(a);
    (a.map(|x| x / length), length)
}
