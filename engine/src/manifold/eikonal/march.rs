//! First arrivals: the earliest vertex goes first, and goes again when it turns out to be reached earlier.
//!
//! What is sought is the fixed point: every vertex is reached at the least of its candidates, each computed from
//! the final arrivals of others.  With fibres a front may pass a vertex later than it has reached the next one, so
//! that no single order of the vertices will do; vertices are taken up again until nothing changes by more than
//! [`LEAST`].

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::front::Front;
use super::geometry::{Geometry, NONE};
use super::metric::{Timed, measure};
use super::step::Step;

/// A vertex that is reached earlier by less than this part of its arrival is not taken up again.
const LEAST: f64 = 1e-13;
/// After so many turns per vertex, fronts keep the birthplaces they have: then arrivals only fall, and end.
const TURNS: usize = 20;

/// How a vertex is reached.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Way {
    /// It is not.
    #[default]
    Never,
    /// It is this source.
    Source(u32),
    /// Along this straight line from a source.
    Ray(u32),
    /// Along a side of `triangle`, to its corner `to` from the end number `end` of the side opposite that.
    Along { triangle: u32, to: u8, end: u8 },
    /// Across the side opposite the corner `to`, with a round or a plane front.
    Across { triangle: u32, to: u8, is_round: bool },
}

/// A candidate for how a vertex is reached first.
#[derive(Clone, Copy)]
struct Candidate {
    arrival: f64,
    way: Way,
    /// The source that the front was born at; [`NONE`] where it is plane, or of several.
    origin: u32,
}

/// What has yet to be taken up: (order of the arrival, vertex), earliest first.
pub(super) type Heap = BinaryHeap<Reverse<(u64, u32)>>;

pub(super) struct March<'a> {
    geometry: &'a Geometry,
    sources: &'a [(u32, f64)],
    front: &'a mut Front,
    /// Whether births may still change.
    is_free: bool,
}

impl<'a> March<'a> {
    pub(super) fn new(
        geometry: &'a Geometry,
        medium: &super::Medium<'_>,
        sources: &'a [(u32, f64)],
        front: &'a mut Front,
    ) -> Self {
        let n = geometry.n_vertices();
        measure(geometry, medium, &mut front.tissue, &mut front.timed);
        front.arrival.clear();
        front.arrival.resize(n, f64::INFINITY);
        front.ways.clear();
        front.ways.resize(n, Way::Never);
        front.origins.clear();
        front.origins.resize(n, NONE);
        front.has_changed.clear();
        front.has_changed.resize(n, false);
        front.births.clear();
        front.births.extend(sources.iter().map(|&(_, onset)| onset));
        front.heap.clear();
        Self { geometry, sources, front, is_free: true }
    }

    /// From the sources to the last vertex.
    pub(super) fn run(mut self) {
        self.begin();
        let mut turns = TURNS * self.geometry.n_vertices();
        while let Some(Reverse((order, v))) = self.front.heap.pop() {
            if order != order_of(self.front.arrival[v as usize]) {
                continue;
            }
            turns = turns.saturating_sub(1);
            self.is_free = turns > 0;
            self.spread(v);
        }
    }

    /// Sources, and what is reached straight from them.
    fn begin(&mut self) {
        self.front.rays.clear();
        for (number, &(vertex, onset)) in (0..).zip(self.sources) {
            let way = Way::Source(number);
            self.offer(vertex, Candidate { arrival: onset, way, origin: number });
            self.front.rays.trace(self.geometry, vertex, number);
        }
        for index in 0..self.front.rays.rays.len() {
            let to = self.front.rays.rays[index].to;
            let candidate = self.straight(index);
            self.offer(to, candidate);
        }
    }

    fn straight(&self, index: usize) -> Candidate {
        let ray = &self.front.rays.rays[index];
        let time = self.front.rays.time(ray, &self.front.tissue);
        let arrival = self.sources[ray.source as usize].1 + time;
        Candidate { arrival, way: Way::Ray(index as u32), origin: ray.source }
    }

    /// Takes a candidate if it is earlier.
    #[inline]
    fn offer(&mut self, vertex: u32, candidate: Candidate) {
        let now = self.front.arrival[vertex as usize];
        if now - candidate.arrival > LEAST * candidate.arrival.abs() {
            self.take(vertex, candidate);
        }
    }

    fn take(&mut self, vertex: u32, candidate: Candidate) {
        let (front, v) = (&mut *self.front, vertex as usize);
        let before = (front.arrival[v], front.origins[v]);
        // those reached from here may now be reached later
        if candidate.arrival > before.0 || before.0 < f64::INFINITY && candidate.origin != before.1 {
            front.has_changed[v] = true;
        }
        front.arrival[v] = candidate.arrival;
        front.ways[v] = candidate.way;
        if self.is_free {
            front.origins[v] = candidate.origin;
        }
        front.heap.push(Reverse((order_of(candidate.arrival), vertex)));
    }

    /// Offers the neighbours of a vertex what leads there from it.
    fn spread(&mut self, v: u32) {
        let geometry = self.geometry;
        let has_changed = std::mem::take(&mut self.front.has_changed[v as usize]);
        for &(index, corner) in geometry.fan(v) {
            let corners = &geometry.triangles[index as usize].corners;
            let i = corner as usize;
            for (to, end) in [((i + 1) % 3, 1), ((i + 2) % 3, 0)] {
                let (vertex, other) = (corners[to], corners[3 - i - to]);
                let [here, there, now] =
                    [v, other, vertex].map(|u| self.front.arrival[u as usize]);
                if has_changed && self.is_free && self.is_from(vertex, v) {
                    self.reconsider(vertex);
                } else if now > here.min(there) {
                    let candidate = self.through(index, to, [end, end]);
                    self.offer(vertex, candidate);
                }
            }
        }
    }

    /// Whether `vertex` is reached from `parent`.
    fn is_from(&self, vertex: u32, parent: u32) -> bool {
        let corner = |triangle: u32, k: usize| {
            self.geometry.triangles[triangle as usize].corners[k % 3] == parent
        };
        match self.front.ways[vertex as usize] {
            Way::Along { triangle, to, end } => corner(triangle, (to + 1 + end) as usize),
            Way::Across { triangle, to, .. } => {
                corner(triangle, to as usize + 1) || corner(triangle, to as usize + 2)
            }
            _ => false,
        }
    }

    /// The earliest way to corner `to` of a triangle: across the side opposite, or along the sides from its
    /// `ends`.
    #[inline]
    fn through(&self, index: u32, to: usize, ends: [usize; 2]) -> Candidate {
        let front = &*self.front;
        let corners = &self.geometry.triangles[index as usize].corners;
        let sides = [corners[(to + 1) % 3], corners[(to + 2) % 3]].map(|v| v as usize);
        let arrivals = sides.map(|v| front.arrival[v]);
        let origins = sides.map(|v| front.origins[v]);
        let timed: &Timed = &front.timed[index as usize];
        let step = Step::new(timed, to, arrivals);
        let to = to as u8;
        if arrivals[0] < f64::INFINITY && arrivals[1] < f64::INFINITY {
            let origin = if origins[0] == origins[1] { origins[0] } else { NONE };
            let birth = front.births.get(origin as usize).filter(|birth| step.is_round(**birth));
            let arrival = birth.map_or_else(|| step.plane(), |birth| step.round(*birth));
            if let Some(arrival) = arrival {
                let way = Way::Across { triangle: index, to, is_round: birth.is_some() };
                return Candidate { arrival, way, origin };
            }
        }
        let [one, two] = ends.map(|end| (step.along(end), end));
        let (arrival, end) = if two.0 < one.0 { two } else { one };
        let way = Way::Along { triangle: index, to, end: end as u8 };
        Candidate { arrival, way, origin: origins[end] }
    }

    /// Finds the earliest way to a vertex anew, though it be later than the one it has.
    fn reconsider(&mut self, vertex: u32) {
        let mut best = Candidate { arrival: f64::INFINITY, way: Way::Never, origin: NONE };
        let mut consider = |candidate: Candidate| {
            if candidate.arrival < best.arrival {
                best = candidate;
            }
        };
        for (number, &(source, onset)) in (0..).zip(self.sources) {
            if source == vertex {
                consider(Candidate { arrival: onset, way: Way::Source(number), origin: number });
            }
        }
        for index in 0..self.front.rays.rays.len() {
            if self.front.rays.rays[index].to == vertex {
                consider(self.straight(index));
            }
        }
        for &(index, corner) in self.geometry.fan(vertex) {
            consider(self.through(index, corner as usize, [0, 1]));
        }
        let v = vertex as usize;
        let now = self.front.arrival[v];
        let is_same = best.way == self.front.ways[v] && best.origin == self.front.origins[v];
        if !(is_same && (best.arrival - now).abs() <= LEAST * now.abs()) {
            self.take(vertex, best);
        }
    }
}

/// Integers in the order of the numbers.
fn order_of(arrival: f64) -> u64 {
    let bits = arrival.to_bits();
    if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
}
