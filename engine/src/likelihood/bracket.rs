//! Intervals as measurements.

use super::Observation;
use crate::num::LN_SQRT_2PI;

/// A value known only to lie between `lower` and `upper`; either end may be infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bracket {
    /// Lower end; −∞ if captured at every interval tried.
    pub lower: f64,
    /// Upper end; ∞ if never captured.
    pub upper: f64,
    /// Sub-intervals per unit, for [`TopHat`](super::TopHat).
    pub(super) inverse_s: f64,
    /// Number of the last sub-interval, from 0.
    pub(super) last: f64,
    /// `−ln width − ln √(2π)`.
    pub(super) ln_norm: f64,
}

impl Bracket {
    /// The bracket `[lower, upper]`. [`TopHat`](super::TopHat) cuts it into sub-intervals, each as near
    /// to 1 unit wide as fits.
    ///
    /// # Errors
    /// `upper ≤ lower`, or both ends open.
    pub fn new(lower: f64, upper: f64) -> Result<Self, String> {
        if upper <= lower {
            return Err(format!("upper ({upper}) must be greater than lower ({lower})"));
        }
        if lower.is_nan() || upper.is_nan() || (lower.is_infinite() && upper.is_infinite()) {
            return Err(format!("[{lower}, {upper}] is not a bracket"));
        }
        let width = upper - lower;
        let n = width.round().max(1.0);
        let ln_norm = -width.ln() - LN_SQRT_2PI;
        Ok(Self { lower, upper, inverse_s: n / width, last: n - 1.0, ln_norm })
    }

    /// The bracket that contains `value` on the grid of a protocol that gave `self`.
    ///
    /// The grid has the width of `self`. An open bracket has no width; its grid has steps of
    /// [`OPEN_STEP`], counted from its closed end.
    pub(super) fn containing(&self, value: f64) -> Self {
        let width =
            if (self.upper - self.lower).is_finite() { self.upper - self.lower } else { OPEN_STEP };
        let origin = if self.lower.is_finite() { self.lower } else { self.upper };
        let lower = origin + ((value - origin) / width).floor() * width;
        Self::new(lower, lower + width).unwrap_or(*self)
    }

    pub(super) fn is_open(&self) -> bool {
        self.lower.is_infinite() || self.upper.is_infinite()
    }
}

/// Step assumed for a protocol of which only an open bracket is known, ms.
pub const OPEN_STEP: f64 = 10.0;

impl Observation for Bracket {
    const COLUMNS: &'static [&'static str] = &["lower", "upper"];
    fn read(cells: &[f64]) -> Result<Option<Self>, String> {
        if cells[0].is_nan() && cells[1].is_nan() {
            return Ok(None);
        }
        let open = |x: f64, end: f64| if x.is_nan() { end } else { x };
        let (lower, upper) = (open(cells[0], f64::NEG_INFINITY), open(cells[1], f64::INFINITY));
        Self::new(lower, upper).map(Some)
    }
    fn cells(&self) -> Vec<f64> {
        vec![self.lower, self.upper]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::likelihood::{Likelihood, TopHat};

    fn bracket(lower: f64, upper: f64) -> Bracket {
        Bracket::new(lower, upper).unwrap()
    }

    #[test]
    fn brackets_are_read_with_open_ends_and_absences() {
        let read = |a, b| <Bracket as Observation>::read(&[a, b]);
        assert_eq!(read(f64::NAN, f64::NAN), Ok(None));
        assert!(read(200.0, f64::NAN).unwrap().unwrap().upper.is_infinite());
        assert!(read(f64::NAN, 60.0).unwrap().unwrap().lower.is_infinite());
        assert!(read(210.0, 200.0).unwrap_err().contains("greater than lower"));
        assert!(<u32 as Observation>::read(&[1.5]).is_err());
    }

    #[test]
    fn a_simulated_bracket_contains_the_value_on_the_protocols_grid() {
        let mut rng: rand_chacha::ChaCha8Rng = rand::SeedableRng::from_seed([0; 32]);
        let y = TopHat(227.3).simulate(&bracket(203.0, 213.0), &mut rng);
        assert_eq!(y, bracket(223.0, 233.0));
    }
}
