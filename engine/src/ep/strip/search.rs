//! Pacing eight strips, and searching for their effective refractory periods.

use super::fem::Matrices;
use super::lanes::{LANES, Lane};
use super::record::{BeatRecorder, Recorder};
use super::tissue::{LaneStrip, State};
use super::{Absence, Beat, Grid, StripOutcome};
use crate::ep::cell::{Tissue, V_GATE};
use crate::ep::protocol::Protocol;

/// Steps between looks at whether tests are decided; no result depends on it.
const LOOK_EVERY: usize = 20;

/// Interval at which the states after a conditioning stimulus are kept, ms: a test begins from the last
/// one before its stimulus.
const KEEP_EVERY: u32 = 10;

/// One batch of strips under one protocol.
pub(super) struct Pacer<'a, const B: usize> {
    grid: &'a Grid,
    protocol: &'a Protocol,
    strip: LaneStrip<B>,
}

/// A conditioning beat: the states at multiples of [`KEEP_EVERY`] after its stimulus, and what was
/// measured.
struct Conditioning {
    kept: Vec<State>,
    beats: [Result<Beat, Absence>; LANES],
}

impl<'a, const B: usize> Pacer<'a, B> {
    pub(super) fn new(
        grid: &'a Grid,
        protocol: &'a Protocol,
        matrices: &Matrices<B>,
        tissues: &[Tissue; LANES],
    ) -> Self {
        Self { grid, protocol, strip: LaneStrip::new(grid, matrices, tissues) }
    }

    /// The whole protocol: S1 train, ERP_S2, restitution, conditioning S2, ERP_S3.
    pub(super) fn run(mut self) -> [StripOutcome; LANES] {
        for _ in 1..self.protocol.n_beats {
            self.plain_beat();
        }
        let s1 = self.conditioning_beat();
        let erp_s2 = self.erp(&s1);
        let curve: Vec<_> =
            self.protocol.restitution.iter().map(|&s2| (s2, self.beats_at(s2, &s1))).collect();
        self.restore(self.protocol.s2, &s1);
        let mut s2 = self.conditioning_beat();
        for (second, first) in s2.beats.iter_mut().zip(&s1.beats) {
            *second = first.and(*second);
        }
        let erp_s3 = self.erp(&s2);
        std::array::from_fn(|k| StripOutcome {
            s1: s1.beats[k],
            erp_s2: erp_s2[k],
            s2: s2.beats[k],
            erp_s3: erp_s3[k],
            restitution: curve.iter().map(|(s2, beats)| (*s2, s1.beats[k].and(beats[k]))).collect(),
        })
    }

    fn steps(&self, ms: u32) -> usize {
        ms as usize * self.grid.steps_per_ms()
    }

    /// What a stimulus of `strength` (1/ms) adds to V in one step.
    fn amplitude(&self, strength: f64) -> f64 {
        strength * self.grid.dt
    }

    fn plain_beat(&mut self) {
        let stimulus = [self.amplitude(self.protocol.conditioning_strength); LANES];
        for index in 0..self.steps(self.protocol.s1) {
            self.strip.step((index < self.grid.pulse_steps()).then_some(&stimulus));
        }
    }

    /// A beat that is measured within S1 of its stimulus, and followed for as long as tests may need.
    fn conditioning_beat(&mut self) -> Conditioning {
        let stimulus = [self.amplitude(self.protocol.conditioning_strength); LANES];
        let mut recorder = BeatRecorder::new(self.strip.state.v.len(), [0; LANES]);
        let mut kept = vec![];
        let window = self.steps(self.protocol.s1);
        for index in 0..window.max(self.steps(self.protocol.last_interval()) + 1) {
            if index.is_multiple_of(self.steps(KEEP_EVERY)) {
                kept.push(self.strip.state.clone());
            }
            let pulse = (index < self.grid.pulse_steps()).then_some(&stimulus);
            if index < window {
                self.strip.step_recorded(pulse, index, &mut recorder);
            } else {
                self.strip.step(pulse);
            }
        }
        Conditioning { kept, beats: std::array::from_fn(|k| recorder.beat(k, self.grid)) }
    }

    /// Puts every strip where it was `interval` (ms) after the conditioning stimulus.
    fn restore(&mut self, interval: u32, conditioning: &Conditioning) {
        self.strip.set_state(&conditioning.kept[(interval / KEEP_EVERY) as usize]);
        for _ in 0..self.steps(interval % KEEP_EVERY) {
            self.strip.step(None);
        }
    }

    /// The beat of a conditioning stimulus `s2` (ms) after the last one.
    fn beats_at(&mut self, s2: u32, conditioning: &Conditioning) -> [Result<Beat, Absence>; LANES] {
        self.restore(s2, conditioning);
        let stimulus = [self.amplitude(self.protocol.conditioning_strength); LANES];
        let mut recorder = BeatRecorder::new(self.strip.state.v.len(), [0; LANES]);
        for index in 0..self.steps(self.protocol.s1) {
            let pulse = (index < self.grid.pulse_steps()).then_some(&stimulus);
            self.strip.step_recorded(pulse, index, &mut recorder);
            let looks = pulse.is_none() && index.is_multiple_of(LOOK_EVERY);
            if looks && self.strip.peak().iter().all(|peak| *peak < V_GATE) {
                break;
            }
        }
        std::array::from_fn(|k| recorder.beat(k, self.grid))
    }

    /// The largest whole interval after the conditioning beat whose test stimulus fails.
    ///
    /// Lanes are independent: each begins its next test as soon as it has decided the last.
    fn erp(&mut self, conditioning: &Conditioning) -> [Result<u32, Absence>; LANES] {
        let n_nodes = self.strip.state.v.len();
        let window = self.steps(self.protocol.s1);
        let mut searches = conditioning.beats.map(|b| b.map(|b| Search::new(self.protocol, b)));
        let mut tests = searches.map(|search| search.ok()?.next());
        let mut recorder = Recorder::<0>::new(n_nodes, [usize::MAX; LANES]);
        for (k, test) in tests.into_iter().enumerate() {
            self.begin(k, test, 0, conditioning, &mut recorder);
        }
        let mut index = 0;
        while tests.iter().any(Option::is_some) {
            self.test_step(index, &mut recorder);
            index += 1;
            if !index.is_multiple_of(LOOK_EVERY) {
                continue;
            }
            let peak = self.strip.peak();
            for k in 0..LANES {
                let (Some(test), Ok(search)) = (tests[k], &mut searches[k]) else { continue };
                let since = index.saturating_sub(recorder.start[k]);
                let captured = recorder.n_activated[k] == n_nodes;
                let quiet = since >= self.grid.pulse_steps() && peak[k] < V_GATE;
                if captured || quiet || since >= window {
                    *(if captured { &mut search.captures } else { &mut search.fails }) = test;
                    tests[k] = search.next();
                    self.begin(k, tests[k], index, conditioning, &mut recorder);
                }
            }
        }
        searches.map(|search| search?.erp())
    }

    /// Puts strip `k` where it was shortly before its test, to be stimulated some steps from `now`.
    fn begin(
        &mut self,
        k: usize,
        test: Option<u32>,
        now: usize,
        conditioning: &Conditioning,
        recorder: &mut Recorder<0>,
    ) {
        let Some(test) = test else { return recorder.restart(k, usize::MAX) };
        self.strip.set_lane(k, &conditioning.kept[(test / KEEP_EVERY) as usize]);
        recorder.restart(k, now + self.steps(test % KEEP_EVERY));
    }

    /// A step in which every strip whose time has come is stimulated.
    fn test_step(&mut self, index: usize, recorder: &mut Recorder<0>) {
        let amplitude = self.amplitude(self.protocol.test_strength);
        let start = recorder.start;
        let pulse = |k: usize| start[k] <= index && index - start[k] < self.grid.pulse_steps();
        let stimulus: Lane = std::array::from_fn(|k| if pulse(k) { amplitude } else { 0.0 });
        let any = (0..LANES).any(pulse);
        self.strip.step_recorded(any.then_some(&stimulus), index, recorder);
    }
}

/// What is known of an ERP.
#[derive(Clone, Copy)]
struct Search {
    /// The longest interval known to fail; one below the range if none is.
    fails: u32,
    /// The shortest interval known to capture; one above the range if none is.
    captures: u32,
    range: [u32; 2],
    /// Where to begin: tissue recovers its excitability some ms after its action potential.
    guess: u32,
}

/// How much later than APD90 an ERP is expected, ms.
const LATER: u32 = 8;

/// The first step away from there, ms.
const STEP: u32 = 4;

impl Search {
    fn new(protocol: &Protocol, beat: Beat) -> Self {
        let range = [protocol.shortest, protocol.longest];
        let guess = beat.apd90 as u32 + LATER;
        Self { fails: range[0] - 1, captures: range[1] + 1, range, guess }
    }

    /// The next interval to test: outwards from the guess with growing steps, then the middle of the
    /// bracket; `None` once it is closed.
    fn next(&self) -> Option<u32> {
        let &Self { fails, captures, range, guess } = self;
        let (failed, captured) = (fails >= range[0], captures <= range[1]);
        let test = match (failed, captured) {
            (false, false) => guess,
            (true, false) => fails + STEP + 2 * fails.saturating_sub(guess),
            (false, true) => captures.saturating_sub(STEP + 2 * guess.saturating_sub(captures)),
            (true, true) => fails.midpoint(captures),
        };
        (captures - fails > 1).then(|| test.clamp(fails + 1, captures - 1))
    }

    /// Neither end of the range being ever left means that it was too narrow.
    fn erp(&self) -> Result<u32, Absence> {
        match self {
            Self { fails, range, .. } if *fails < range[0] => Err(Absence::AlwaysCaptures),
            Self { captures, range, .. } if *captures > range[1] => Err(Absence::NeverCaptures),
            Self { fails, .. } => Ok(*fails),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ep::Parameters;

    /// CV of the first beat, at full recovery, on a grid `refinement` times finer.
    fn first_cv<const B: usize>(refinement: u32, cv_max: f64) -> f64 {
        let fine = f64::from(refinement);
        let coarse = Grid::default();
        let grid = Grid {
            n_along: (coarse.n_along - 1) * refinement as usize + 1,
            n_across: 2 * refinement as usize + 1,
            spacing: coarse.spacing / fine,
            dt: coarse.dt / fine,
        };
        let protocol = Protocol { s1: 350, longest: 340, ..Protocol::default() };
        let tissue = Parameters::from_array([cv_max, 0.2, 10.0, 120.0, 120.0]).tissue();
        let matrices = Matrices::<B>::assemble(&grid);
        let mut pacer = Pacer::new(&grid, &protocol, &matrices, &[tissue; LANES]);
        pacer.conditioning_beat().beats[0].unwrap().cv
    }

    #[test]
    fn conduction_velocity_converges_to_its_closed_form() {
        let cv_max = 0.5;
        let [coarse, medium, fine] =
            [first_cv::<3>(1, cv_max), first_cv::<4>(2, cv_max), first_cv::<5>(3, cv_max)];
        // Second order: the error is c/n² on a grid n times finer, so successive differences are in
        // the ratio (1/4 − 1/9) to (1 − 1/4).
        let ratio = (medium - fine) / (coarse - medium);
        assert!((0.12..0.25).contains(&ratio), "{coarse} {medium} {fine}");
        let limit = fine + (fine - medium) / (9.0 / 4.0 - 1.0);
        // The gate closes a little within the front, so the wave is slightly slower than CV_max.
        assert!((0.97..1.0).contains(&(limit / cv_max)), "{limit}");
    }
}
