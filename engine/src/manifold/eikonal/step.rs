//! One step of activation: from the two ends of a triangle's side to the corner opposite.
//!
//! In the timed plane (`metric.rs`) the side lies on the first axis from `a` = (0, 0) to `b` = (L, 0), the corner
//! `c` at (x, y) with y > 0. A **plane** front has arrivals linear along the side:
//!
//! ```text
//! T_c = min over λ in [0, 1] of (1 − λ) T_a + λ T_b + |c − (λ L, 0)|
//! δ = T_b − T_a,   q = sqrt(L² − δ²):   T_c = T_a + (δ x + q y)/L    if the minimum is within
//! ```
//! By the envelope theorem the derivatives of `T_c` are those at fixed λ.
//!
//! A **round** front was born at a point at the time β. The point S is where the times from there to `a` and `b`
//! are `T_a − β` and `T_b − β`, on the far side of the side, and `T_c = β + |c − S|`.  In a constant medium on a
//! flat surface this is exact.
//!
//! Where the birthplace sees the side under more than a right angle, `T_c` depends strongly on both ends, unless the corner is
//! the last of the three. There the front **goes over** to a plane one, the more the wider the angle and the earlier
//! the corner. A jump from one to the other would be one of milliseconds on large triangles, and stops a sampler.
//!
//! ```text
//! e = (max(T_a, T_b) − T_c)/L,   w = 1 − ((T_a − β)² + (T_b − β)²)/L²,   share = min(e/E, 1) min(w/W, 1), 0 where e or w is
//! T = T_c + share (P − T_c),   P the earliest of a plane front and those along both sides
//! ```
//!
//! # Source
//! Bornemann and Rasch 2006, Finite-element discretization of static Hamilton–Jacobi equations (plane);
//! Novotni and Klein 2002, Computing geodesic distances on triangular meshes (round, without a medium).

use super::metric::Timed;

/// By how much earlier than the later end, in lengths of the side, a corner is reached by a plane front.
const EARLY: f64 = 0.1;
/// How wide the angle is then; 1 is 180°.
const WIDE: f64 = 0.25;

/// A front on its way through a triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    /// Lengths of the side that is crossed, and from its ends to the corner, ms.
    side: f64,
    from_ends: [f64; 2],
    /// The corner: `x` of it times the side, and `y` of it times the side, ms².
    x: f64,
    y: f64,
    /// Arrival at the ends, ms.
    ends: [f64; 2],
}

/// Derivatives of an arrival.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slope {
    /// By the arrivals at the two ends.
    pub(super) ends: [f64; 2],
    /// By the birth of the front.
    pub(super) birth: f64,
    /// Directions (along the side, towards the corner; units) in the timed plane, and the ms along each whose
    /// change with the medium adds up to that of the arrival.
    pub(super) ways: [([f64; 2], f64); 5],
}

/// How much of a round front goes over to a plane one, and the derivatives of that by the arrival of the later end less that of
/// the round one, by both ends' times since birth, and by the length of the side.
struct Over {
    share: f64,
    by_early: f64,
    by_ends: [f64; 2],
    by_side: f64,
}

impl Step {
    /// To corner `to`, where the next corner is reached at `ends[0]` and the one after it at `ends[1]`.
    #[inline(always)]
    pub(super) fn new(timed: &Timed, to: usize, ends: [f64; 2]) -> Self {
        let side = timed.sides[to];
        // the way from the next corner is the side opposite the one after it
        let from_ends = [2, 1].map(|k| timed.sides[(to + k) % 3]);
        let [u, w] = from_ends;
        let x = 0.5 * (side * side + (u - w) * (u + w));
        Self { side, from_ends, x, y: timed.area, ends }
    }

    /// Arrival across the inside of the side, and whether the front is taken to be round; none where the way
    /// leads along another side, or round one of the ends.
    ///
    /// A round front needs a birthplace; a part of it may have gone over to a plane one.
    #[inline(always)]
    pub(super) fn across(&self, birth: Option<f64>) -> Option<(f64, bool)> {
        let Some(birth) = birth.filter(|birth| self.has_birthplace(*birth)) else {
            return self.plane().map(|arrival| (arrival, false));
        };
        let arrival = self.round(birth)?;
        let later =
            self.over(birth, arrival).map_or(0.0, |over| over.share * (self.flat().0 - arrival));
        Some((arrival + later, true))
    }

    /// How much of a round front that arrives so goes over to a plane one, if any.
    #[inline(always)]
    fn over(&self, birth: f64, arrival: f64) -> Option<Over> {
        let (side, later) = (self.side, self.ends[0].max(self.ends[1]));
        let since = self.ends.map(|t| t - birth);
        let squares = since[0] * since[0] + since[1] * since[1];
        let (early, wide) = ((later - arrival) / side, 1.0 - squares / (side * side));
        if early <= 0.0 || wide <= 0.0 {
            return None;
        }
        // a factor and its derivative
        let ramp = |x: f64, end: f64| if x < end { (x / end, 1.0 / end) } else { (1.0, 0.0) };
        let ((e, de), (w, dw)) = (ramp(early, EARLY), ramp(wide, WIDE));
        Some(Over {
            share: e * w,
            by_early: de * w / side,
            by_ends: since.map(|t| -2.0 * t * e * dw / (side * side)),
            by_side: (2.0 * squares / (side * side) * e * dw - early * de * w) / side,
        })
    }

    /// The earliest arrival of a front that is not round, and the end that it comes along from, if it does.
    fn flat(&self) -> (f64, Option<usize>) {
        let along = [0, 1].map(|end| (self.along(end), Some(end)));
        let earlier = if along[1].0 < along[0].0 { along[1] } else { along[0] };
        match self.plane() {
            Some(arrival) if arrival < earlier.0 => (arrival, None),
            _ => earlier,
        }
    }

    /// Whether both ends are reached.
    #[inline(always)]
    pub(super) fn has_arrived(&self) -> bool {
        self.ends[0] < f64::INFINITY && self.ends[1] < f64::INFINITY
    }

    /// Whether the arrival is later than `time` for sure, without computing it: from the arrival at the earlier end until
    /// `time` a front gets no farther than the corner's height above the side. This says nothing of a round front that
    /// was born opposite the inside of the side, for such a front crosses the side before it is at either end.
    #[inline(always)]
    pub(super) fn is_later_than(&self, time: f64, birth: Option<f64>) -> bool {
        let Self { side, y, ends: [a, b], .. } = *self;
        let comes_from_end = |birth: f64| ((a - b) * (a + b - 2.0 * birth)).abs() >= side * side;
        (time - a.min(b)) * side <= y && birth.is_none_or(comes_from_end)
    }

    #[inline(always)]
    fn plane(&self) -> Option<f64> {
        let Self { side, x, y, .. } = *self;
        let delta = self.ends[1] - self.ends[0];
        let root2 = (side - delta) * (side + delta);
        if root2 <= 0.0 {
            return None;
        }
        let root = root2.sqrt();
        // 0 < λ < 1 with λ L² = x − δ y / q
        let is_within = x * root > delta * y && (side * side - x) * root > -delta * y;
        is_within.then(|| self.ends[0] + (delta * x + root * y) / (side * side))
    }

    /// Whether there is a point from which the ends are as far as their arrivals say.
    #[inline(always)]
    fn has_birthplace(&self, birth: f64) -> bool {
        let [a, b] = self.ends.map(|t| t - birth);
        a > 0.0 && b > 0.0 && a + b > self.side && (a - b).abs() < self.side
    }

    /// The birthplace seen from the first end: along the side, and behind it, both times the side.
    #[inline(always)]
    fn birthplace(&self, birth: f64) -> [f64; 2] {
        let Self { side, .. } = *self;
        let [a, b] = self.ends.map(|t| t - birth);
        let along = 0.5 * (side * side + (a - b) * (a + b));
        [along, ((a * side - along) * (a * side + along)).max(0.0).sqrt()]
    }

    #[inline(always)]
    fn round(&self, birth: f64) -> Option<f64> {
        let Self { side, x, y, .. } = *self;
        let [along, behind] = self.birthplace(birth);
        // the way crosses the side at along + (x − along) behind / (behind + y)
        let crossing = along * y + x * behind;
        let is_within = crossing > 0.0 && crossing < side * side * (behind + y);
        is_within.then(|| birth + ((x - along).powi(2) + (y + behind).powi(2)).sqrt() / side)
    }

    /// Derivatives of [`Step::across`] where it leads across; of a plane front without a `birth`.
    pub(super) fn across_slope(&self, birth: Option<f64>) -> Slope {
        let Some(birth) = birth else { return self.plane_slope() };
        let (round, arrival) = self.round_slope(birth);
        match self.over(birth, arrival) {
            Some(over) => self.gone_over(&round, arrival, &over),
            None => round,
        }
    }

    /// Derivatives of the arrival with a plane front.
    fn plane_slope(&self) -> Slope {
        let Self { side, .. } = *self;
        let (x, y) = (self.x / side, self.y / side);
        let delta = self.ends[1] - self.ends[0];
        let root = ((side - delta) * (side + delta)).max(0.0).sqrt();
        let share = ((x - delta * y / root) / side).clamp(0.0, 1.0);
        let length = y * side / root;
        let direction = [delta / side, root / side];
        let mut ways = [([0.0; 2], 0.0); 5];
        ways[0] = (direction, length);
        Slope { ends: [1.0 - share, share], birth: 0.0, ways }
    }

    /// Derivatives of the arrival along a side.
    fn along_slope(&self, end: usize) -> Slope {
        let (x, y) = (self.x / self.side, self.y / self.side);
        let length = self.from_ends[end];
        let from = [0.0, self.side][end];
        let (mut ends, mut ways) = ([0.0; 2], [([0.0; 2], 0.0); 5]);
        ends[end] = 1.0;
        ways[0] = ([(x - from) / length, y / length], length);
        Slope { ends, birth: 0.0, ways }
    }

    /// Derivatives of the arrival with a round front, times counted from its birth, and that arrival:
    ///
    /// ```text
    /// n_c = α n_a + β n_b                    directions from S
    /// dT_c = α dT_a + β dT_b + (1 − α − β) dbirth
    ///        + ½ (T_c n_cᵀdM n_c − α T_a n_aᵀdM n_a − β T_b n_bᵀdM n_b)
    /// ```
    fn round_slope(&self, birth: f64) -> (Slope, f64) {
        let [along, behind] = self.birthplace(birth).map(|x| x / self.side);
        let (x, y) = (self.x / self.side, self.y / self.side);
        let [a, b] = self.ends.map(|t| t - birth);
        let c = ((x - along).powi(2) + (y + behind).powi(2)).sqrt();
        let share = ((along * y + x * behind) / (behind + y) / self.side).clamp(0.0, 1.0);
        let reach = behind / (behind + y);
        let alpha = (1.0 - share) * a / (reach * c);
        let beta = share * b / (reach * c);
        let none = ([0.0; 2], 0.0);
        let ways = [
            ([(x - along) / c, (y + behind) / c], c),
            ([-along / a, behind / a], -alpha * a),
            ([(self.side - along) / b, behind / b], -beta * b),
            none,
            none,
        ];
        (Slope { ends: [alpha, beta], birth: 1.0 - alpha - beta, ways }, birth + c)
    }

    /// Derivatives of an arrival with a front of which a part has gone over, from those with the `round` one.
    fn gone_over(&self, round: &Slope, arrival: f64, over: &Over) -> Slope {
        let (flat, end) = self.flat();
        let other = end.map_or_else(|| self.plane_slope(), |end| self.along_slope(end));
        let gap = flat - arrival;
        let of_round = 1.0 - over.share - gap * over.by_early;
        let later = usize::from(self.ends[1] > self.ends[0]);
        let mut new = Slope { birth: of_round * round.birth, ..*round };
        for k in 0..2 {
            let further = gap * (over.by_ends[k] + if k == later { over.by_early } else { 0.0 });
            new.ends[k] = of_round * round.ends[k] + over.share * other.ends[k] + further;
            new.birth -= gap * over.by_ends[k];
        }
        for way in &mut new.ways[..3] {
            way.1 *= of_round;
        }
        new.ways[3] = (other.ways[0].0, over.share * other.ways[0].1);
        new.ways[4] = ([1.0, 0.0], gap * over.by_side * self.side);
        new
    }

    /// Arrival straight from one end.
    #[inline(always)]
    pub(super) fn along(&self, end: usize) -> f64 {
        self.ends[end] + self.from_ends[end]
    }
}

#[cfg(test)]
#[path = "step_tests.rs"]
mod tests;
