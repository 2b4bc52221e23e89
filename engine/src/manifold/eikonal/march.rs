//! First arrivals: the earliest vertex goes first, and goes again when it turns out to be reached earlier.
//!
//! What is sought is the fixed point: every vertex is reached at the least of its candidates, each computed from
//! the final arrivals of others.  With fibres a front may pass a vertex later than it has reached the next one, so
//! that no single order of the vertices will do; vertices are taken up again until nothing changes by more than
//! [`LEAST`].  Where that takes too long, fronts are taken to be plane, and `policy.rs` goes on.

use super::front::{Front, Reached};
use super::geometry::{Blade, Geometry};
use super::rays::Rays;
use super::step::Step;
use super::way::{NONE, Way};
use std::sync::Arc;

/// A vertex that is reached earlier by less than this part of its arrival is not taken up again.
pub(super) const LEAST: f64 = 1e-13;
/// Most turns per vertex with round fronts.  On triangles with angles of 170° in the timed plane two ends may each
/// pull the other on for ever; then all fronts are taken to be plane.
const TURNS: usize = 20;

/// After so many turns of a vertex, fronts that reach it are taken to be plane. On triangles with wide angles in the
/// timed plane two ends may each pull the other on for ever, where fronts are round.
const ROUND: u8 = 40;

/// So often a vertex may go over from the front of one source to that of another.  Without an end two vertices
/// where fronts meet may do so in turns for ever.
const MOVES: u8 = 3;

/// A candidate for how a vertex is reached first.
#[derive(Clone, Copy)]
pub(super) struct Candidate {
    pub(super) arrival: f64,
    pub(super) way: Way,
    /// The source that the front was born at; [`NONE`] for one of neighbours, whose front is plane.
    origin: u32,
}

/// A front at a side of a triangle, on its way to the corner opposite.
struct Side {
    index: u32,
    /// Which corner.
    to: usize,
    step: Step,
    /// Of both ends.
    origins: [u32; 2],
    /// Of a front that may be round.
    birth: Option<f64>,
}

/// Arrivals on their way.
pub(super) struct March<'a> {
    pub(super) geometry: &'a Arc<Geometry>,
    pub(super) front: &'a mut Front,
    /// Whether every vertex has one turn only, though it be reached earlier after that.
    is_one_pass: bool,
}

impl<'a> March<'a> {
    /// Of a front whose tissue is known.
    pub(super) fn new(
        geometry: &'a Arc<Geometry>,
        sources: &[(u32, f64)],
        front: &'a mut Front,
    ) -> Self {
        front.births.clear();
        front.births.extend(sources.iter().map(|&(_, onset)| onset));
        let vertices: Vec<u32> = sources.iter().map(|&(vertex, _)| vertex).collect();
        if !front.rays.are_from(geometry, &vertices) {
            front.rays = Rays::new(geometry, vertices).into();
        }
        front.own.clone_from(&front.rays.own);
        Self { geometry, front, is_one_pass: false }
    }

    /// For tests: when a vertex would be reached from the arrivals of `front`.
    #[cfg(test)]
    pub(super) fn again(geometry: &'a Arc<Geometry>, front: &'a mut Front, vertex: u32) -> f64 {
        Self { geometry, front, is_one_pass: false }.earliest(vertex).arrival
    }

    /// From the sources to the last vertex.
    pub(super) fn run(mut self) {
        self.begin();
        if !self.settle(TURNS * self.geometry.n_vertices()) {
            self.front.own.fill(NONE);
            self.is_one_pass = true;
            self.begin();
            self.settle(usize::MAX);
            self.settle_ways();
        }
        self.front.arrival.clear();
        self.front.arrival.extend(self.front.reached.iter().map(|reached| reached.arrival));
    }

    /// What is reached straight from the sources, and nothing else.
    fn begin(&mut self) {
        let (n, front) = (self.geometry.n_vertices(), &mut *self.front);
        front.reached.clear();
        front.reached.resize(n, Reached::NOT);
        front.ways.clear();
        front.ways.resize(n, Way::Never);
        front.queue.clear(n);
        for index in 0..self.front.rays.len() {
            let candidate = self.straight(index);
            let to = self.front.rays.ray(index).to;
            if self.is_earlier(to, &candidate) {
                self.take(to, candidate);
            }
        }
    }

    /// Takes up vertices until none is left; whether `turns` were enough.
    fn settle(&mut self, turns: usize) -> bool {
        for _ in 0..turns {
            let Some(v) = self.front.queue.pop() else { return true };
            let turns = &mut self.front.reached[v as usize].turns;
            *turns = turns.saturating_add(1);
            if *turns == ROUND {
                self.reconsider(v);
            }
            self.spread(v);
        }
        false
    }

    fn straight(&self, index: u32) -> Candidate {
        let ray = self.front.rays.ray(index);
        let time = match self.front.plain_medium(ray.source) {
            Some((tissue, thickness)) => self.front.rays.late_time(ray, tissue, thickness),
            None => self.front.rays.time(ray, &self.front.tissue),
        };
        let arrival = self.front.births[ray.source as usize] + time;
        let origin = self.front.own[ray.source as usize];
        Candidate { arrival, way: Way::Ray(index), origin }
    }

    /// Whether a candidate is earlier than what a vertex has.
    #[inline(always)]
    fn is_earlier(&self, vertex: u32, candidate: &Candidate) -> bool {
        let now = self.front.reached[vertex as usize].arrival;
        now - candidate.arrival > LEAST * candidate.arrival.abs()
    }

    fn take(&mut self, vertex: u32, candidate: Candidate) {
        let (front, v) = (&mut *self.front, vertex as usize);
        let reached = &mut front.reached[v];
        let is_first = front.ways[v] == Way::Never;
        let is_moved = candidate.origin != reached.origin && reached.moves < MOVES;
        if is_first || is_moved {
            reached.origin = candidate.origin;
            reached.moves += u8::from(!is_first);
        }
        // those reached from here may now be reached later, also if this one is reached earlier: a round front that
        // passes one end of a side sooner may pass beyond it later
        reached.has_changed |= reached.turns > 0;
        reached.arrival = candidate.arrival;
        front.ways[v] = candidate.way;
        if !(self.is_one_pass && reached.turns > 0) {
            front.queue.put(vertex, candidate.arrival);
        }
    }

    /// Offers the neighbours of a vertex what leads there from it.
    fn spread(&mut self, v: u32) {
        let geometry = self.geometry;
        let here = &mut self.front.reached[v as usize];
        let has_changed = std::mem::take(&mut here.has_changed);
        let here = *here;
        for blade in geometry.fan(v) {
            for end in [1, 0] {
                let [vertex, other] = [blade.others[1 - end], blade.others[end]];
                let [now, there] = [vertex, other].map(|u| self.front.reached[u as usize]);
                let is_own = has_changed && self.is_from(vertex, blade.triangle, v);
                if !is_own && now.arrival <= here.arrival.min(there.arrival) {
                    continue;
                }
                let to = (blade.corner as usize + 2 - end) % 3;
                // across the side when its other end has its turn
                let candidate = if there.turns > 0 {
                    let ends = if end == 0 { [here, there] } else { [there, here] };
                    let side = self.side(blade.triangle, to, ends, now.turns);
                    if !is_own && side.step.is_later_than(now.arrival, side.birth) {
                        continue;
                    }
                    Self::through(&side, [end, end])
                } else {
                    self.along(blade.triangle, to, end, here)
                };
                if is_own && self.is_otherwise(vertex, &candidate) {
                    self.reconsider(vertex);
                } else if self.is_earlier(vertex, &candidate)
                    && !self.is_near(vertex, candidate.origin)
                {
                    self.take(vertex, candidate);
                }
            }
        }
    }

    /// Whether `vertex` is reached from `parent` through this triangle.
    fn is_from(&self, vertex: u32, index: u32, parent: u32) -> bool {
        let corner = |triangle: u32, k: usize| {
            triangle == index && self.geometry.triangles[index as usize].corners[k % 3] == parent
        };
        match self.front.ways[vertex as usize] {
            Way::Along { triangle, to, end } => corner(triangle, (to + 1 + end) as usize),
            Way::Across { triangle, to, .. } => {
                corner(triangle, to as usize + 1) || corner(triangle, to as usize + 2)
            }
            _ => false,
        }
    }

    /// Whether the way that a vertex has, as it is now, may no longer be the earliest: it is later than it was, or another.
    fn is_otherwise(&self, vertex: u32, now: &Candidate) -> bool {
        let (v, front) = (vertex as usize, &*self.front);
        let reached = front.reached[v];
        let later = now.arrival - reached.arrival;
        let is_same = now.way == front.ways[v] && now.origin == reached.origin;
        later > LEAST * now.arrival.abs() || !is_same && later >= -LEAST * now.arrival.abs()
    }

    /// To corner `to` of a triangle, which had so many turns, from the `ends` of the side opposite.
    #[inline(always)]
    fn side(&self, index: u32, to: usize, ends: [Reached; 2], turns: u8) -> Side {
        let Front { timed, births, .. } = &*self.front;
        let origins = ends.map(|end| end.origin);
        let is_round = origins[0] == origins[1] && turns < ROUND;
        let birth = births.get(origins[0] as usize).filter(|_| is_round).copied();
        let step = Step::new(&timed[index as usize], to, ends.map(|end| end.arrival));
        Side { index, to, step, origins, birth }
    }

    /// The earliest way to corner `to` of a triangle: across the side opposite, or along the sides from its
    /// `ends`.
    #[inline(always)]
    fn through(side: &Side, ends: [usize; 2]) -> Candidate {
        let Side { index, to, ref step, origins, birth } = *side;
        let to = to as u8;
        if step.has_arrived()
            && let Some((arrival, is_round)) = step.across(birth)
        {
            let way = Way::Across { triangle: index, to, is_round };
            let nearer = usize::from(step.along(1) < step.along(0));
            return Candidate { arrival, way, origin: origins[nearer] };
        }
        let [one, two] = ends.map(|end| (step.along(end), end));
        let (arrival, end) = if two.0 < one.0 { two } else { one };
        let way = Way::Along { triangle: index, to, end: end as u8 };
        Candidate { arrival, way, origin: origins[end] }
    }

    /// Along the side from one end, reached like `from`, to corner `to` of a triangle.
    #[inline(always)]
    fn along(&self, index: u32, to: usize, end: usize, from: Reached) -> Candidate {
        let arrival = from.arrival + self.front.timed[index as usize].sides[(to + 2 - end) % 3];
        let way = Way::Along { triangle: index, to: to as u8, end: end as u8 };
        Candidate { arrival, way, origin: from.origin }
    }

    /// The earliest of all ways to a vertex.
    pub(super) fn earliest(&self, vertex: u32) -> Candidate {
        let mut best = Candidate { arrival: f64::INFINITY, way: Way::Never, origin: NONE };
        let mut consider = |candidate: Candidate| {
            if candidate.arrival < best.arrival {
                best = candidate;
            }
        };
        let mut next = self.front.rays.first_to(vertex);
        while let Some(index) = next {
            consider(self.straight(index));
            next = self.front.rays.next_to(index);
        }
        for &Blade { triangle: index, corner, others } in self.geometry.fan(vertex) {
            let to = corner as usize;
            let ends = others.map(|v| self.front.reached[v as usize]);
            let turns = self.front.reached[vertex as usize].turns;
            let candidate = match ends.map(|end| end.turns > 0) {
                [true, true] => Self::through(&self.side(index, to, ends, turns), [0, 1]),
                [true, false] => self.along(index, to, 0, ends[0]),
                [false, true] => self.along(index, to, 1, ends[1]),
                [false, false] => continue,
            };
            if !self.is_near(vertex, candidate.origin) {
                consider(candidate);
            }
        }
        best
    }

    /// Whether a line leads to `vertex` from the source that is the origin of a front. Then it comes along that line:
    /// where a side is seen under a wide angle, the arrival across it would jump as the medium changes.
    #[inline]
    fn is_near(&self, vertex: u32, origin: u32) -> bool {
        let Front { rays, own, .. } = &*self.front;
        let mut lines = std::iter::successors(rays.first_to(vertex), |index| rays.next_to(*index));
        origin != NONE && lines.any(|index| own[rays.ray(index).source as usize] == origin)
    }

    /// Takes the earliest way to a vertex, though it be later than the one it has.
    fn reconsider(&mut self, vertex: u32) {
        let best = self.earliest(vertex);
        let v = vertex as usize;
        let Reached { arrival: now, origin, moves, .. } = self.front.reached[v];
        let is_origin = best.origin == origin || moves >= MOVES;
        let is_same = is_origin && best.way == self.front.ways[v];
        if !(is_same && (best.arrival - now).abs() <= LEAST * now.abs()) {
            self.take(vertex, best);
        }
    }
}
