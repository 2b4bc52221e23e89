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
//! # Source
//! Bornemann and Rasch 2006, Finite-element discretization of static Hamilton–Jacobi equations (plane);
//! Novotni and Klein 2002, Computing geodesic distances on triangular meshes (round, without a medium).

use super::metric::Timed;

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
    pub(super) ways: [([f64; 2], f64); 3],
}

impl Step {
    /// To corner `to`, where the next corner is reached at `ends[0]` and the one after it at `ends[1]`.
    #[inline(always)]
    pub(super) fn new(timed: &Timed, to: usize, ends: [f64; 2]) -> Self {
        let side = timed.sides[to];
        // the way from the next corner is the side opposite the one after it
        let from_ends = [timed.sides[(to + 2) % 3], timed.sides[(to + 1) % 3]];
        let [u, w] = from_ends;
        let x = 0.5 * (side * side + (u - w) * (u + w));
        Self { side, from_ends, x, y: timed.area, ends }
    }

    /// Arrival across the inside of the side, and whether the front is taken to be round; none where the way
    /// leads along another side, or round one of the ends.
    ///
    /// A round front needs a birthplace.  One that sees the side under more than a right angle makes an arrival
    /// depend strongly on both ends: then the corner must be the last of the three.
    #[inline(always)]
    pub(super) fn across(&self, birth: Option<f64>) -> Option<(f64, bool)> {
        let [a, b] = self.ends;
        let Some(birth) = birth.filter(|birth| self.has_birthplace(*birth)) else {
            return self.plane().map(|arrival| (arrival, false));
        };
        let arrival = self.round(birth)?;
        if arrival < a.max(b) {
            let [a, b] = [a - birth, b - birth];
            if a * a + b * b < self.side * self.side {
                return self.plane().map(|arrival| (arrival, false));
            }
        }
        Some((arrival, true))
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

    /// Derivatives of the arrival with a plane front.
    pub(super) fn plane_slope(&self) -> Slope {
        let Self { side, .. } = *self;
        let (x, y) = (self.x / side, self.y / side);
        let delta = self.ends[1] - self.ends[0];
        let root = ((side - delta) * (side + delta)).max(0.0).sqrt();
        let share = ((x - delta * y / root) / side).clamp(0.0, 1.0);
        let length = y * side / root;
        let direction = [delta / side, root / side];
        let none = ([0.0; 2], 0.0);
        Slope { ends: [1.0 - share, share], birth: 0.0, ways: [(direction, length), none, none] }
    }

    /// Derivatives of the arrival with a round front, times counted from its birth:
    ///
    /// ```text
    /// n_c = α n_a + β n_b                    directions from S
    /// dT_c = α dT_a + β dT_b + (1 − α − β) dbirth
    ///        + ½ (T_c n_cᵀdM n_c − α T_a n_aᵀdM n_a − β T_b n_bᵀdM n_b)
    /// ```
    pub(super) fn round_slope(&self, birth: f64) -> Slope {
        let [along, behind] = self.birthplace(birth).map(|x| x / self.side);
        let (x, y) = (self.x / self.side, self.y / self.side);
        let [a, b] = self.ends.map(|t| t - birth);
        let c = ((x - along).powi(2) + (y + behind).powi(2)).sqrt();
        let share = ((along * y + x * behind) / (behind + y) / self.side).clamp(0.0, 1.0);
        let reach = behind / (behind + y);
        let alpha = (1.0 - share) * a / (reach * c);
        let beta = share * b / (reach * c);
        let ways = [
            ([(x - along) / c, (y + behind) / c], c),
            ([-along / a, behind / a], -alpha * a),
            ([(self.side - along) / b, behind / b], -beta * b),
        ];
        Slope { ends: [alpha, beta], birth: 1.0 - alpha - beta, ways }
    }

    /// Arrival straight from one end.
    #[inline(always)]
    pub(super) fn along(&self, end: usize) -> f64 {
        self.ends[end] + self.from_ends[end]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt as _, SeedableRng as _};

    /// Fronts that were born opposite the inside of a side, and beside it. How many are known to be later than some time, and how
    /// many of these are earlier. In a test that must fail, `slack` times the height is allowed.
    fn known(slack: f64) -> [usize; 2] {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut count = [0; 2];
        for _ in 0..20_000 {
            let mut at = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
            let (side, corner) = (at(0.5, 3.0), [at(-1.0, 4.0), at(0.1, 2.0)]);
            let (source, birth) = ([at(-4.0, 7.0), at(-6.0, -0.05)], at(-2.0, 2.0));
            let far = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
            let [a, b] = [[0.0, 0.0], [side, 0.0]];
            let sides = [side, far(corner, b), far(corner, a)];
            let timed = Timed { corners: [0, 1, 2], sides, area: side * corner[1] };
            // not quite the arrivals of that birth, as where the medium varies
            let ends = [a, b].map(|p| birth + far(p, source) * at(0.95, 1.05));
            let step = Step::new(&timed, 0, ends);
            for birth in [None, Some(birth)] {
                let along = step.along(0).min(step.along(1));
                let arrival = step.across(birth).map_or(along, |(arrival, _)| arrival);
                let time = ends[0].min(ends[1]) + at(0.0, 2.0);
                let slackened = ends[0].min(ends[1]) + (time - ends[0].min(ends[1])) / slack;
                if step.is_later_than(slackened, birth) {
                    count[0] += 1;
                    count[1] += usize::from(arrival < time * (1.0 - time.signum() * 1e-12));
                }
            }
        }
        count
    }

    #[test]
    fn what_is_known_to_be_later_is() {
        let [known_later, earlier] = known(1.0);
        assert!(known_later > 10_000 && earlier == 0, "{known_later} {earlier}");
        assert!(known(1.2)[1] > 100);
    }
}
