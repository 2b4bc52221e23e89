//! Restitution curves: how CV and APD of a beat depend on the interval before it.

use super::Beat;

/// The coefficients of `y = a − b exp(−(S2 − d)/c)`.
///
/// `d` is the shortest interval that was fitted, because only `b exp(d/c)` is determined: `b` is what is
/// lost there, `a` what is approached, `c` (ms) how fast.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Restitution {
    /// What the curve approaches, in the unit of y.
    pub a: f64,
    /// What is lost at `d`, in the unit of y.
    pub b: f64,
    /// Decay constant, ms.
    pub c: f64,
    /// Shortest interval, ms.
    pub d: f64,
}

/// Decay constants that are tried, ms.
const DECAY: [f64; 2] = [5.0, 2000.0];

/// Points that determine three coefficients, and one to spare.
const FEWEST: usize = 4;

impl Restitution {
    /// The curve at an interval of `s2` ms.
    pub fn at(&self, s2: f64) -> f64 {
        self.a - self.b * (-(s2 - self.d) / self.c).exp()
    }

    /// Least squares over the beats that have a value; `None` of fewer than four.
    pub fn fit<E>(
        beats: &[(u32, Result<Beat, E>)],
        y: impl Fn(&Beat) -> f64,
    ) -> Option<Restitution> {
        let points: Vec<(f64, f64)> = beats
            .iter()
            .filter_map(|(s2, beat)| Some((f64::from(*s2), y(beat.as_ref().ok()?))))
            .collect();
        if points.len() < FEWEST {
            return None;
        }
        // a and b are linear: what is left is a search for c, on a grid and then by golden section
        let [low, high] = DECAY.map(f64::ln);
        let n = 60;
        let grid = |i: usize| low + (high - low) * i as f64 / n as f64;
        let error = |ln_c: f64| Restitution::with_decay(&points, ln_c.exp()).1;
        let best = (0..=n).min_by(|i, j| error(grid(*i)).total_cmp(&error(grid(*j))))?;
        let (mut left, mut right) = (grid(best.saturating_sub(1)), grid((best + 1).min(n)));
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        while right - left > 1e-6 {
            let [x, y] = [right - golden * (right - left), left + golden * (right - left)];
            if error(x) < error(y) { right = y } else { left = x }
        }
        Some(Restitution::with_decay(&points, (0.5 * (left + right)).exp()).0)
    }

    /// The best curve of decay constant `c`, and its sum of squared errors.
    fn with_decay(points: &[(f64, f64)], c: f64) -> (Restitution, f64) {
        let d = points.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
        let terms: Vec<(f64, f64)> = points.iter().map(|p| ((-(p.0 - d) / c).exp(), p.1)).collect();
        let n = points.len() as f64;
        let mean = |of: fn(&(f64, f64)) -> f64| terms.iter().map(of).sum::<f64>() / n;
        let (mean_e, mean_y) = (mean(|t| t.0), mean(|t| t.1));
        let (mut ee, mut ey) = (0.0, 0.0);
        for (e, y) in &terms {
            ee += (e - mean_e).powi(2);
            ey += (e - mean_e) * (y - mean_y);
        }
        let b = -ey / ee;
        let curve = Restitution { a: mean_y + b * mean_e, b, c, d };
        let error = points.iter().map(|(x, y)| (curve.at(*x) - y).powi(2)).sum();
        (curve, error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beats(y: impl Fn(f64) -> f64) -> Vec<(u32, Result<Beat, ()>)> {
        let beat = |s2: u32| {
            let cv = y(f64::from(s2));
            Ok(Beat { cv, apd20: None, apd30: None, apd50: None, apd90: 0.0 })
        };
        let absent = std::iter::once((200, Err(())));
        absent.chain((220..=600).step_by(20).map(|s2| (s2, beat(s2)))).collect()
    }

    #[test]
    fn a_curve_of_the_form_is_found_again() {
        let truth = Restitution { a: 1.08, b: 0.4, c: 95.0, d: 220.0 };
        let found = Restitution::fit(&beats(|x| truth.at(x)), |b| b.cv).unwrap();
        for (found, truth) in [(found.a, 1.08), (found.b, 0.4), (found.c, 95.0), (found.d, 220.0)] {
            assert!((found - truth).abs() < 1e-4 * truth, "{found} {truth}");
        }
    }

    #[test]
    fn three_beats_are_too_few() {
        assert_eq!(Restitution::fit(&beats(f64::sqrt)[..4], |b| b.cv), None);
        assert!(Restitution::fit(&beats(f64::sqrt)[..5], |b| b.cv).is_some());
    }
}
