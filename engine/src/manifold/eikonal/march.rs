//! First arrivals: the earliest vertex goes first, and goes again when it turns out to be reached earlier.
//!
//! What is sought is the fixed point: every vertex is reached at the least of its candidates, each computed from
//! the final arrivals of others.  With fibres a front may pass a vertex later than it has reached the next one, so
//! that no single order of the vertices will do; vertices are taken up again until nothing changes by more than
//! [`LEAST`].

use super::front::Front;
use super::geometry::{Blade, Geometry};
use super::step::Step;
use super::way::{NONE, Way};

/// A vertex that is reached earlier by less than this part of its arrival is not taken up again.
const LEAST: f64 = 1e-13;
/// Most turns per vertex with round fronts.  On triangles with angles of 170° in the timed plane two ends may each
/// pull the other on for ever; then all fronts are taken to be plane, which settles on any triangles.
const TURNS: usize = 20;

/// After so many turns of a vertex, fronts that reach it are taken to be plane. On triangles with wide angles in the
/// timed plane two ends may each pull the other on for ever, where fronts are round.
const ROUND: u8 = 40;

/// So often a vertex may go over from the front of one source to that of another.  Without an end two vertices
/// where fronts meet may do so in turns for ever.
const MOVES: u8 = 3;

/// A candidate for how a vertex is reached first.
#[derive(Clone, Copy)]
struct Candidate {
    arrival: f64,
    way: Way,
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
    geometry: &'a Geometry,
    front: &'a mut Front,
    /// Whether a vertex that turns out to be reached before the one whose turn it is waits until all later ones
    /// had theirs.  This takes more turns where few vertices do, and far fewer where many do, again and again.
    is_patient: bool,
    /// Arrival of the vertex whose turn it is, if patient.
    now: f64,
}

impl<'a> March<'a> {
    /// Of a front whose tissue is known.
    pub(super) fn new(
        geometry: &'a Geometry,
        sources: &[(u32, f64)],
        front: &'a mut Front,
    ) -> Self {
        front.births.clear();
        front.births.extend(sources.iter().map(|&(_, onset)| onset));
        trace(geometry, sources, front);
        Self { geometry, front, is_patient: false, now: f64::NEG_INFINITY }
    }

    /// For tests: when a vertex would be reached from the arrivals of `front`.
    #[cfg(test)]
    pub(super) fn again(geometry: &'a Geometry, front: &'a mut Front, vertex: u32) -> f64 {
        Self { geometry, front, is_patient: false, now: f64::NEG_INFINITY }.earliest(vertex).arrival
    }

    /// From the sources to the last vertex.
    pub(super) fn run(mut self) {
        self.begin();
        if !self.settle(TURNS * self.geometry.n_vertices()) {
            self.front.own.fill(NONE);
            self.is_patient = true;
            self.begin();
            self.settle(usize::MAX);
        }
    }

    /// What is reached straight from the sources, and nothing else.
    fn begin(&mut self) {
        let (n, front) = (self.geometry.n_vertices(), &mut *self.front);
        front.arrival.clear();
        front.arrival.resize(n, f64::INFINITY);
        front.ways.clear();
        front.ways.resize(n, Way::Never);
        front.origins.clear();
        front.origins.resize(n, NONE);
        front.has_changed.clear();
        front.has_changed.resize(n, false);
        front.turns.clear();
        front.turns.resize(n, 0);
        front.moves.clear();
        front.moves.resize(n, 0);
        front.queue.clear(n);
        front.later.clear(n);
        self.now = f64::NEG_INFINITY;
        for index in 0..self.front.rays.len() {
            let candidate = self.straight(index);
            self.offer(self.front.rays.ray(index).to, candidate);
        }
    }

    /// Takes up vertices until none is left; whether `turns` were enough.
    fn settle(&mut self, turns: usize) -> bool {
        for _ in 0..turns {
            let Some(v) = self.next() else { return true };
            let turns = &mut self.front.turns[v as usize];
            *turns = turns.saturating_add(1);
            if *turns == ROUND {
                self.reconsider(v);
            }
            self.spread(v);
        }
        false
    }

    /// The earliest vertex of this pass, or of the next one.
    fn next(&mut self) -> Option<u32> {
        let front = &mut *self.front;
        if front.queue.is_empty() {
            std::mem::swap(&mut front.queue, &mut front.later);
        }
        let v = front.queue.pop()?;
        if self.is_patient {
            self.now = front.arrival[v as usize];
        }
        Some(v)
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
        let is_first = front.ways[v] == Way::Never;
        let is_moved = candidate.origin != front.origins[v] && front.moves[v] < MOVES;
        if is_first || is_moved {
            front.origins[v] = candidate.origin;
            front.moves[v] += u8::from(!is_first);
        }
        // those reached from here may now be reached later, also if this one is reached earlier: a round front that
        // passes one end of a side sooner may pass beyond it later
        front.has_changed[v] |= front.turns[v] > 0;
        front.arrival[v] = candidate.arrival;
        front.ways[v] = candidate.way;
        let queue = if candidate.arrival < self.now { &mut front.later } else { &mut front.queue };
        queue.put(vertex, candidate.arrival);
    }

    /// Offers the neighbours of a vertex what leads there from it.
    fn spread(&mut self, v: u32) {
        let geometry = self.geometry;
        let has_changed = std::mem::take(&mut self.front.has_changed[v as usize]);
        for &Blade { triangle: index, corner, others } in geometry.fan(v) {
            for (end, vertex, other) in [(1, others[0], others[1]), (0, others[1], others[0])] {
                let to = (corner as usize + 2 - end) % 3;
                let [here, there, now] = [v, other, vertex].map(|u| self.front.arrival[u as usize]);
                let is_own = has_changed && self.is_from(vertex, index, v);
                if !is_own && now <= here.min(there) {
                    continue;
                }
                // across the side when its other end has its turn
                let candidate = if self.had_turn(other) {
                    let side = self.side(index, to);
                    if !is_own && side.step.is_later_than(now, side.birth) {
                        continue;
                    }
                    Self::through(&side, [end, end])
                } else {
                    self.along(index, to, end)
                };
                if is_own && self.is_otherwise(vertex, &candidate) {
                    self.reconsider(vertex);
                } else if !self.is_near(vertex, candidate.origin) {
                    self.offer(vertex, candidate);
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
        let later = now.arrival - front.arrival[v];
        let is_same = now.way == front.ways[v] && now.origin == front.origins[v];
        later > LEAST * now.arrival.abs() || !is_same && later >= -LEAST * now.arrival.abs()
    }

    /// To corner `to` of a triangle, from the side opposite.
    #[inline(always)]
    fn side(&self, index: u32, to: usize) -> Side {
        let front = &*self.front;
        let timed = &front.timed[index as usize];
        let ends = [1, 2].map(|k| timed.corners[(to + k) % 3] as usize);
        let arrivals = ends.map(|v| front.arrival[v]);
        let origins = ends.map(|v| front.origins[v]);
        let is_one = origins[0] == origins[1];
        let is_round = is_one && front.turns[timed.corners[to] as usize] < ROUND;
        let birth = front.births.get(origins[0] as usize).filter(|_| is_round).copied();
        Side { index, to, step: Step::new(timed, to, arrivals), origins, birth }
    }

    /// The earliest way to corner `to` of a triangle: across the side opposite, or along the sides from its
    /// `ends`.
    #[inline]
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

    /// Whether others may be reached from a vertex: not before its first turn.
    #[inline]
    fn had_turn(&self, vertex: u32) -> bool {
        self.front.turns[vertex as usize] > 0
    }

    /// Along the side from one end to corner `to` of a triangle.
    #[inline]
    fn along(&self, index: u32, to: usize, end: usize) -> Candidate {
        let front = &*self.front;
        let timed = &front.timed[index as usize];
        let from = timed.corners[(to + 1 + end) % 3] as usize;
        let arrival = front.arrival[from] + timed.sides[(to + 2 - end) % 3];
        let way = Way::Along { triangle: index, to: to as u8, end: end as u8 };
        Candidate { arrival, way, origin: front.origins[from] }
    }

    /// The earliest of all ways to a vertex.
    fn earliest(&self, vertex: u32) -> Candidate {
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
            let candidate = match others.map(|v| self.had_turn(v)) {
                [true, true] => Self::through(&self.side(index, to), [0, 1]),
                [true, false] => self.along(index, to, 0),
                [false, true] => self.along(index, to, 1),
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
        let now = self.front.arrival[v];
        let is_origin = best.origin == self.front.origins[v] || self.front.moves[v] >= MOVES;
        let is_same = is_origin && best.way == self.front.ways[v];
        if !(is_same && (best.arrival - now).abs() <= LEAST * now.abs()) {
            self.take(vertex, best);
        }
    }
}

/// Lines from the sources, and for every source its number, or [`NONE`] if a neighbour of its vertex is a source,
/// too: together they are a line or a region.  Lines lead out of a region only.
fn trace(geometry: &Geometry, sources: &[(u32, f64)], front: &mut Front) {
    let mut vertices: Vec<u32> = sources.iter().map(|&(vertex, _)| vertex).collect();
    vertices.sort_unstable();
    front.own.clear();
    front.rays.clear(geometry.n_vertices());
    for (number, &(vertex, _)) in (0..).zip(sources) {
        let neighbours = geometry.fan(vertex).iter().flat_map(|blade| blade.others);
        let mut are_sources = neighbours.map(|v| vertices.binary_search(&v).is_ok());
        let (is_lone, is_inner) = (!are_sources.clone().any(|is| is), are_sources.all(|is| is));
        front.own.push(if is_lone { number } else { NONE });
        front.rays.trace(geometry, vertex, number, !is_inner);
    }
}
