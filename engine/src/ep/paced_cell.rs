//! One cell without neighbours, paced: V and h in time, and how a beat's duration depends on the pause
//! before it.
//!
//! The step is that of the tissue without its diffusion: five forward-Euler substeps, then the stimulus.

use thiserror::Error;

use super::cell::{StepRates, Tissue, V_GATE, euler_step};

/// Step, ms, and the cell's substeps in it.
const STEP: f64 = 0.1;
const SUBSTEPS: u32 = 5;

/// Steps that a stimulus lasts.
const PULSE: u64 = 9;

/// V at which an upstroke counts as activation, and at which a downstroke counts as recovery to 20, 30,
/// 50 and 90 %: the tissue's.
const ACTIVATION: f64 = 0.7;
const RECOVERY: [f64; 4] = [0.8, 0.7, 0.5, 0.1];

/// A cell at some time.
#[derive(Debug, Clone)]
pub struct PacedCell {
    rates: StepRates,
    /// What a stimulus adds to V, 1/ms.
    strength: f64,
    v: f64,
    h: f64,
    step: u64,
    /// Step at which the last stimulus began.
    stimulus: Option<u64>,
}

/// V and the gate h at a time, ms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time, ms.
    pub time: f64,
    /// V.
    pub v: f64,
    /// The gate.
    pub h: f64,
}

/// A beat of a cell: times since the stimulus, ms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellBeat {
    /// Activation.
    pub lat: f64,
    /// Action potential durations at 20, 30, 50 and 90 % recovery.
    pub apd: [f64; 4],
}

/// One point of a restitution curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestitutionPoint {
    /// Interval from the last S1, ms.
    pub s2: f64,
    /// Diastolic interval: from the 90 % recovery of the last S1 beat to the stimulus, ms.
    pub di: f64,
    /// The beat; `None` if it is not captured.
    pub beat: Option<CellBeat>,
}

impl PacedCell {
    /// At rest, V = 0 and h = 1, with stimuli of `strength` (1/ms).
    pub fn new(cell: Tissue, strength: f64) -> Self {
        let rates = cell.step_rates(STEP / f64::from(SUBSTEPS));
        Self { rates, strength, v: 0.0, h: 1.0, step: 0, stimulus: None }
    }

    /// Where it is.
    pub fn sample(&self) -> Sample {
        Sample { time: self.step as f64 * STEP, v: self.v, h: self.h }
    }

    /// Begins a stimulus and lets `ms` pass; what it saw of each step goes to `trace`. The beat, if V rose
    /// to activation from below the threshold and recovered in this time.
    pub fn beat(&mut self, ms: f64, trace: &mut dyn FnMut(Sample)) -> Option<CellBeat> {
        let begin = self.step;
        let was_recovered = self.v < V_GATE;
        self.stimulus = Some(begin);
        let (mut lat, mut recovery) = (f64::NAN, [f64::NAN; 4]);
        while self.step < begin + (ms / STEP).round() as u64 {
            let before = self.v;
            let since = |share: f64| ((self.step - begin) as f64 + share) * STEP;
            let (v, h) = self.next();
            let at = |level: f64| since((level - before) / (v - before));
            if lat.is_nan() && before < ACTIVATION && v >= ACTIVATION {
                lat = at(ACTIVATION);
            }
            for (recovery, level) in recovery.iter_mut().zip(RECOVERY) {
                if !lat.is_nan() && recovery.is_nan() && before > level && v <= level {
                    *recovery = at(level);
                }
            }
            (self.v, self.h) = (v, h);
            self.step += 1;
            trace(self.sample());
        }
        let is_beat = was_recovered && recovery.iter().all(|t| t.is_finite());
        is_beat.then(|| CellBeat { lat, apd: recovery.map(|t| t - lat) })
    }

    /// V and h after a step.
    fn next(&self) -> (f64, f64) {
        let (mut v, mut h) = (self.v, self.h);
        for _ in 0..SUBSTEPS {
            (v, h) = euler_step(v, h, self.rates);
        }
        let is_on = self.stimulus.is_some_and(|begin| self.step - begin < PULSE);
        (if is_on { v + STEP * self.strength } else { v }, h)
    }
}

/// How a cell is paced: an S1 train, and after its last beat, in turn, each of several S2 beats.
#[derive(Debug, Clone, PartialEq)]
pub struct CellProtocol {
    /// Strength of the stimuli, 1/ms: one cell alone needs little.
    pub strength: f64,
    /// Interval of the S1 train, ms.
    pub s1: f64,
    /// Beats of the S1 train.
    pub beats: u32,
    /// Intervals of the S2 beats, ms, none longer than `s1`.
    pub s2: Vec<f64>,
}

impl Default for CellProtocol {
    /// Eight beats, 600 ms apart, and S2 from 150 to 600 ms in steps of 10.
    fn default() -> Self {
        let s2 = (15..=60).map(|k| 10.0 * f64::from(k)).collect();
        Self { strength: 0.3, s1: 600.0, beats: 8, s2 }
    }
}

/// A cell that cannot be paced so.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum CellProtocolError {
    /// A strength that is none.
    #[error("a stimulus of {0} per ms excites nothing\nhelp: give a strength above 0")]
    Strength(f64),
    /// An S1 interval that is none.
    #[error("--s1 {0} is no interval\nhelp: give ms, 1 or more")]
    S1(f64),
    /// An S2 that comes after the next S1, or at once.
    #[error(
        "--s2 {s2} is not between 1 ms and the S1 interval of {s1} ms\nhelp: an S2 comes earlier than the next S1 would"
    )]
    S2 {
        /// Interval of the S2 beat, ms.
        s2: f64,
        /// That of the train, ms.
        s1: f64,
    },
}

impl CellProtocol {
    /// Checks that a cell can be paced so.
    ///
    /// # Errors
    /// What makes no sense.
    pub fn validate(&self) -> Result<(), CellProtocolError> {
        let Self { strength, s1, .. } = *self;
        if !(strength.is_finite() && strength > 0.0) {
            return Err(CellProtocolError::Strength(strength));
        }
        if !(1.0..=1e5).contains(&s1) {
            return Err(CellProtocolError::S1(s1));
        }
        match self.s2.iter().find(|s2| !(1.0..=s1).contains(*s2)) {
            Some(&s2) => Err(CellProtocolError::S2 { s2, s1 }),
            None => Ok(()),
        }
    }

    /// Number of samples of [`CellProtocol::trace`].
    pub fn n_samples(&self) -> f64 {
        1.0 + f64::from(self.beats) * (self.s1 / STEP).round()
    }

    /// V and h of `cell` through the S1 train, from rest on.
    pub fn trace(&self, cell: Tissue) -> Vec<Sample> {
        let mut paced = PacedCell::new(cell, self.strength);
        let mut trace = vec![paced.sample()];
        for _ in 0..self.beats {
            paced.beat(self.s1, &mut |sample| trace.push(sample));
        }
        trace
    }

    /// The S1S2 restitution curve of `cell`: a point for each S2.
    pub fn restitution(&self, cell: Tissue) -> Vec<RestitutionPoint> {
        let mut paced = PacedCell::new(cell, self.strength);
        for _ in 1..self.beats {
            paced.beat(self.s1, &mut |_| ());
        }
        let last = paced.clone().beat(self.s1, &mut |_| ());
        let point = |s2: &f64| {
            let mut paced = paced.clone();
            paced.beat(*s2, &mut |_| ());
            let di = last.map_or(f64::NAN, |beat| s2 - beat.lat - beat.apd[3]);
            RestitutionPoint { s2: *s2, di, beat: paced.beat(self.s1, &mut |_| ()) }
        };
        self.s2.iter().map(point).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ep::Parameters;

    fn cell() -> Tissue {
        Parameters::from_array([0.7, 0.05, 10.0, 120.0, 200.0]).tissue()
    }

    fn restitution(cell: Tissue, strength: f64, s1: f64, s2: &[f64]) -> Vec<RestitutionPoint> {
        CellProtocol { strength, s1, beats: 4, s2: s2.to_vec() }.restitution(cell)
    }

    /// Mitchell and Schaeffer 2003, equation for APD restitution: with fast currents the gate alone
    /// makes the duration, and opens with `tau_open` in the pause.
    #[test]
    fn durations_follow_the_gate_as_the_closed_form_says() {
        let tissue = Parameters::from_array([0.7, 0.01, 1.0, 120.0, 270.0]).tissue();
        let h_min = 1.0 / (1.0 + 0.81 * tissue.tau_out / (4.0 * tissue.tau_in));
        let curve = restitution(tissue, 0.4, 900.0, &[350.0, 450.0, 600.0, 900.0]);
        let tails = curve.iter().map(|point| {
            let h = 1.0 - (1.0 - h_min) * (-point.di / tissue.tau_open).exp();
            let plateau = tissue.tau_close * (h / h_min).ln();
            let apd = point.beat.unwrap().apd[3];
            println!("DI {:.1}: APD90 {apd:.2}, plateau by the closed form {plateau:.2}", point.di);
            apd - plateau
        });
        // repolarisation after the plateau is not in the closed form: some tau_out, the same after any pause
        let tails: Vec<f64> = tails.collect();
        assert!(tails.iter().all(|tail| (tail - tails[0]).abs() < 1.0 && *tail > 0.0), "{tails:?}");
        assert!(tails[0] < 15.0 * tissue.tau_out, "{tails:?}");
    }

    #[test]
    fn a_cell_that_has_not_recovered_is_not_captured() {
        let curve = restitution(cell(), 0.3, 600.0, &[100.0, 180.0, 300.0, 600.0]);
        let is_captured: Vec<bool> = curve.iter().map(|p| p.beat.is_some()).collect();
        assert_eq!(is_captured, [false, false, true, true]);
        assert!(curve[0].di < 0.0 && curve[2].di > 0.0);
        let apd90 = |k: usize| curve[k].beat.unwrap().apd[3];
        assert!(apd90(2) + 10.0 < apd90(3), "shorter after a shorter pause");
    }

    /// `V = V_gate` belongs to the branch in which the gate opens, also in a paced cell.
    #[test]
    fn at_the_threshold_itself_the_gate_opens() {
        let mut paced = PacedCell::new(cell(), 0.3);
        (paced.v, paced.h) = (V_GATE, 1.0);
        let rest = paced.next();
        assert!(rest.0 <= V_GATE && rest.1 >= 1.0, "no current at V_gate with h = 1: {rest:?}");
        paced.v = V_GATE.next_up();
        assert!(paced.next().1 < 1.0, "just above, it closes");
    }

    #[test]
    fn the_trace_is_of_every_step() {
        let mut paced = PacedCell::new(cell(), 0.3);
        let mut trace = vec![];
        let beat = paced.beat(400.0, &mut |sample| trace.push(sample)).unwrap();
        assert_eq!(trace.len(), 4000);
        let peak = trace.iter().map(|s| s.v).fold(0.0, f64::max);
        assert!(peak > 0.9 && peak < 1.0, "{peak}");
        assert!(trace.iter().all(|s| (0.0..=1.0).contains(&s.h)));
        assert!(beat.apd.is_sorted(), "{beat:?}");
    }
}
