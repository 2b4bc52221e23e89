//! The modified Mitchell–Schaeffer cell and its two sets of parameters.
//!
//! Knows one cell and the closed forms that tie its constants to tissue quantities; it knows
//! nothing of meshes, protocols or statistics.  Units: ms, mm, mm²/ms; V and h are dimensionless.
//!
//! ```text
//! dV/dt = D ∇²V + h V (V − V_gate)(1 − V)/tau_in − (1 − h) V/tau_out + J_stim
//! dh/dt = (1 − h)/tau_open   if V ≤ V_gate,   −h/tau_close   otherwise
//! CV_max  = ½ (1 − 2 V_gate) √(2 D/tau_in)
//! APD_max = tau_close ln(1 + tau_out (1 − V_gate)²/(4 tau_in))
//! ```

use super::precision::Precision;
use thiserror::Error;

/// Excitation threshold of V, and the voltage at which the gate h turns.
///
/// The model has two parameters here that happen to be equal.
pub const V_GATE: f64 = 0.1;

/// The constants the equations use: diffusivity (mm²/ms) and four time constants (ms).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tissue {
    /// Diffusivity D, mm²/ms.
    pub diffusivity: f64,
    /// Time constant of the inward current, ms.
    pub tau_in: f64,
    /// Time constant of the outward current, ms.
    pub tau_out: f64,
    /// Time constant with which the gate opens, ms.
    pub tau_open: f64,
    /// Time constant with which the gate closes, ms.
    pub tau_close: f64,
}

/// The parameters a modeller sets: a conduction velocity and an action potential duration take
/// the place of diffusivity and `tau_close`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters {
    /// Conduction velocity of a plane wave at full recovery, m/s (= mm/ms).
    pub cv_max: f64,
    /// Time constant of the inward current, ms.
    pub tau_in: f64,
    /// Time constant of the outward current, ms.
    pub tau_out: f64,
    /// Time constant with which the gate opens, ms.
    pub tau_open: f64,
    /// Action potential duration at full recovery, ms.
    pub apd_max: f64,
}

/// A parameter outside the range in which the model is used.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error(
    "{name} = {value} {unit} is outside its valid range {lower} to {upper} {unit}\n\
     help: give {name} in {unit}, between {lower} and {upper}"
)]
pub struct OutOfRange {
    /// The parameter's name.
    pub name: &'static str,
    /// What was given.
    pub value: f64,
    /// Unit of `value` and the bounds.
    pub unit: &'static str,
    /// Smallest valid value.
    pub lower: f64,
    /// Largest valid value.
    pub upper: f64,
}

/// Name, unit and valid range of each field of [`Parameters`], in the order of its fields.
///
/// # Source
/// Coveney et al. 2022, Methods, "Electrophysiology model".
pub const RANGES: [(&str, &str, f64, f64); 5] = [
    ("cv_max", "m/s", 0.1, 1.5),
    ("tau_in", "ms", 0.01, 0.30),
    ("tau_out", "ms", 1.0, 30.0),
    ("tau_open", "ms", 65.0, 215.0),
    ("apd_max", "ms", 120.0, 270.0),
];

impl Parameters {
    /// The five values in the order of [`RANGES`].
    pub fn to_array(self) -> [f64; 5] {
        [self.cv_max, self.tau_in, self.tau_out, self.tau_open, self.apd_max]
    }

    /// From five values in the order of [`RANGES`].
    pub fn from_array([cv_max, tau_in, tau_out, tau_open, apd_max]: [f64; 5]) -> Self {
        Self { cv_max, tau_in, tau_out, tau_open, apd_max }
    }

    /// Checks every parameter against [`RANGES`].
    ///
    /// # Errors
    /// The first parameter that is not a number inside its range.
    pub fn validate(self) -> Result<(), OutOfRange> {
        for ((name, unit, lower, upper), value) in RANGES.into_iter().zip(self.to_array()) {
            if !(lower..=upper).contains(&value) {
                return Err(OutOfRange { name, value, unit, lower, upper });
            }
        }
        Ok(())
    }

    /// The constants of the equations.
    pub fn tissue(self) -> Tissue {
        let Self { cv_max, tau_in, tau_out, tau_open, apd_max } = self;
        let speed = cv_max / (0.5 * (1.0 - 2.0 * V_GATE));
        let diffusivity = 0.5 * tau_in * speed * speed;
        let tau_close = apd_max / log_duration(tau_in, tau_out);
        Tissue { diffusivity, tau_in, tau_out, tau_open, tau_close }
    }
}

impl Tissue {
    /// The inverse of [`Parameters::tissue`].
    pub fn parameters(self) -> Parameters {
        let Self { diffusivity, tau_in, tau_out, tau_open, tau_close } = self;
        let cv_max = 0.5 * (1.0 - 2.0 * V_GATE) * (2.0 * diffusivity / tau_in).sqrt();
        let apd_max = tau_close * log_duration(tau_in, tau_out);
        Parameters { cv_max, tau_in, tau_out, tau_open, apd_max }
    }

    /// `step` (ms) over each time constant, for [`euler_step`].
    pub(super) fn step_rates(self, step: f64) -> StepRates {
        StepRates {
            excite: step / self.tau_in,
            leak: step / self.tau_out,
            open: step / self.tau_open,
            close: step / self.tau_close,
        }
    }
}

/// `APD_max / tau_close`.
fn log_duration(tau_in: f64, tau_out: f64) -> f64 {
    (tau_out * (1.0 - V_GATE).powi(2) / (4.0 * tau_in)).ln_1p()
}

/// One time step over each time constant.
#[derive(Debug, Clone, Copy)]
pub(super) struct StepRates<F = f64> {
    pub(super) excite: F,
    pub(super) leak: F,
    pub(super) open: F,
    pub(super) close: F,
}

impl StepRates {
    /// The same in another precision.
    pub(super) fn cast<F: Precision>(self) -> StepRates<F> {
        let Self { excite, leak, open, close } = self;
        StepRates {
            excite: F::of(excite),
            leak: F::of(leak),
            open: F::of(open),
            close: F::of(close),
        }
    }
}

impl<F: Copy, const N: usize> StepRates<[F; N]> {
    /// Those of N cells that share them.
    pub(super) fn uniform(rate: F) -> Self {
        Self { excite: [rate; N], leak: [rate; N], open: [rate; N], close: [rate; N] }
    }

    /// Gives the cell `i` its own.
    pub(super) fn set(&mut self, i: usize, rates: StepRates<F>) {
        let StepRates { excite, leak, open, close } = rates;
        (self.excite[i], self.leak[i], self.open[i], self.close[i]) = (excite, leak, open, close);
    }
}

/// V and h after one forward-Euler step without diffusion, both from the old values.
#[inline(always)]
pub(super) fn euler_step<F: Precision>(v: F, h: F, r: StepRates<F>) -> (F, F) {
    let (one, gate) = (F::one(), F::of(V_GATE));
    let turn = if v <= gate { r.open * (one - h) } else { -r.close * h };
    (v + current(v, h, r), h + turn)
}

/// As [`euler_step`], but around `V_gate` the gate turns by degrees, over a width 1/`steepness` of V.
#[inline(always)]
pub(super) fn gradual_step<F: Precision>(v: F, h: F, steepness: F, r: StepRates<F>) -> (F, F) {
    let (zero, one) = (F::zero(), F::one());
    let closing = F::of(0.5) + (v - F::of(V_GATE)) * steepness;
    let closing = if closing > zero { closing } else { zero };
    let closing = if closing < one { closing } else { one };
    let turn = (one - closing) * r.open * (one - h) - closing * r.close * h;
    (v + current(v, h, r), h + turn)
}

/// The cell's own change of V in one step.
#[inline(always)]
fn current<F: Precision>(v: F, h: F, r: StepRates<F>) -> F {
    let one = F::one();
    let excite = r.excite * h * v * (v - F::of(V_GATE)) * (one - v);
    let leak = r.leak * (one - h) * v;
    excite - leak
}

#[cfg(test)]
mod tests {
    use super::*;

    const TYPICAL: Parameters =
        Parameters { cv_max: 0.7, tau_in: 0.05, tau_out: 10.0, tau_open: 120.0, apd_max: 200.0 };

    /// V that passes `V_gate` at any time within a step: the gate turns as late as by V alone, on average, but without
    /// the jump by a step from one such time to the next.
    #[test]
    fn a_gradual_gate_is_as_late_on_average_and_does_not_jump() {
        const N: usize = 200;
        const RISE: f64 = 0.04;
        let rates = StepRates { excite: 0.0, leak: 0.0, open: 0.0, close: 1e-3 };
        let closed_for = |passes: usize, steepness: Option<f64>| {
            let v = |step: i32| V_GATE + RISE * (f64::from(step) - passes as f64 / N as f64);
            let turn = |h, step| match steepness {
                Some(steepness) => gradual_step(v(step), h, steepness, rates).1,
                None => euler_step(v(step), h, rates).1,
            };
            (-5..=5).fold(1.0, turn).ln() / (1.0 - rates.close).ln()
        };
        let [by_v, gradual] = [None, Some(1.0 / RISE)].map(|steepness| {
            (0..=N).map(|passes| closed_for(passes, steepness)).collect::<Vec<f64>>()
        });
        let mean = |x: &[f64]| x[1..].iter().sum::<f64>() / N as f64;
        let jump = |x: &[f64]| x.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        assert!((mean(&by_v) - mean(&gradual)).abs() < 0.01, "{} {}", mean(&by_v), mean(&gradual));
        assert!((jump(&by_v) - 1.0).abs() < 1e-9 && jump(&gradual) < 0.01, "{}", jump(&gradual));
    }

    /// At every corner of the valid ranges, and between.
    #[test]
    fn the_two_parameter_sets_are_inverse() {
        for place in 0..3_u32.pow(5) {
            let digit = |k: u32| f64::from(place / 3_u32.pow(k) % 3) / 2.0;
            let at = |k: usize| RANGES[k].2 + digit(k as u32) * (RANGES[k].3 - RANGES[k].2);
            let parameters = Parameters::from_array(std::array::from_fn(at));
            let back = parameters.tissue().parameters().to_array();
            for (a, b) in parameters.to_array().into_iter().zip(back) {
                assert!((a - b).abs() < 1e-13 * a, "{a} {b}");
            }
        }
    }

    #[test]
    fn closed_forms_agree_with_the_first_row_of_the_authors_table() {
        // mmserp, strip design, row 0: D 0.001801 cm²/ms, CV_max and APD_max printed to 8 digits.
        let tissue = Tissue {
            diffusivity: 0.180_1,
            tau_in: 0.05,
            tau_out: 24.843_328,
            tau_open: 120.0,
            tau_close: 53.381_064,
        };
        let p = tissue.parameters();
        assert!((p.cv_max - 1.073_610_7).abs() < 1e-7);
        assert!((p.apd_max - 246.684_35).abs() < 1e-5);
    }

    #[test]
    fn the_gate_opens_at_the_threshold_itself_and_closes_just_above() {
        let rates = TYPICAL.tissue().step_rates(0.02);
        assert!(
            euler_step(V_GATE, 0.5, rates).1 > 0.5,
            "V == V_gate belongs to the opening branch"
        );
        assert!(euler_step(V_GATE.next_up(), 0.5, rates).1 < 0.5);
    }

    #[test]
    fn an_isolated_cell_has_the_duration_of_the_closed_form() {
        // APD_max is when the plateau ceases to exist, (1 − h)/tau_out = h (1 − V_gate)²/(4 tau_in).
        // The fall from it takes some tau_out more, so the currents are made fast here.
        let fast = Parameters { tau_in: 0.01, tau_out: 1.0, apd_max: 270.0, ..TYPICAL };
        let rates = fast.tissue().step_rates(0.001);
        let (mut v, mut h, mut steps) = (0.3, 1.0, 0_u32);
        while v > V_GATE {
            (v, h) = euler_step(v, h, rates);
            steps += 1;
        }
        let excess = f64::from(steps) * 0.001 - fast.apd_max;
        assert!((0.0..0.05 * fast.apd_max).contains(&excess), "{excess}");
    }

    #[test]
    fn a_value_outside_its_range_is_named() {
        let error = Parameters { apd_max: 0.2, ..TYPICAL }.validate().unwrap_err();
        assert_eq!((error.name, error.lower, error.upper), ("apd_max", 120.0, 270.0));
        assert!(error.to_string().contains("help:"));
        assert!(Parameters { tau_in: f64::NAN, ..TYPICAL }.validate().is_err());
        assert!(TYPICAL.validate().is_ok());
    }
}
