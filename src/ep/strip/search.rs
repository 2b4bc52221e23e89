//! Pacing eight strips and bisecting for their effective refractory periods.

use super::fem::Matrices;
use super::lanes::{LANES, Lane};
use super::record::Recorder;
use super::tissue::{LaneStrip, State};
use super::{Absence, Beat, Grid, StripOutcome};
use crate::ep::cell::{Tissue, V_GATE};
use crate::ep::protocol::Protocol;

/// Steps between looks at whether a round of the bisection is decided; no result depends on it.
const LOOK_EVERY: usize = 50;

/// One batch of strips under one protocol.
pub(super) struct Pacer<'a> {
    grid: &'a Grid,
    protocol: &'a Protocol,
    strip: LaneStrip,
}

/// A conditioning beat: the state `protocol.shortest` after its stimulus, and what was measured.
struct Conditioning {
    checkpoint: State,
    beats: [Result<Beat, Absence>; LANES],
}

impl<'a> Pacer<'a> {
    pub(super) fn new(
        grid: &'a Grid,
        protocol: &'a Protocol,
        matrices: &Matrices,
        tissues: &[Tissue; LANES],
    ) -> Self {
        Self { grid, protocol, strip: LaneStrip::new(grid, matrices, tissues) }
    }

    /// The whole protocol: S1 train, ERP_S2, conditioning S2, ERP_S3.
    pub(super) fn run(mut self) -> [StripOutcome; LANES] {
        for _ in 1..self.protocol.n_beats {
            self.plain_beat();
        }
        let s1 = self.conditioning_beat();
        let erp_s2 = self.erp(&s1);

        self.strip.state = s1.checkpoint;
        for _ in self.steps(self.protocol.shortest)..self.steps(self.protocol.s2) {
            self.strip.step(None);
        }
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

    fn conditioning_beat(&mut self) -> Conditioning {
        let stimulus = [self.amplitude(self.protocol.conditioning_strength); LANES];
        let mut recorder = Recorder::new(self.strip.state.v.len(), [0; LANES]);
        let mut checkpoint = self.strip.state.clone();
        for index in 0..self.steps(self.protocol.s1) {
            if index == self.steps(self.protocol.shortest) {
                checkpoint.clone_from(&self.strip.state);
            }
            let pulse = (index < self.grid.pulse_steps()).then_some(&stimulus);
            self.strip.step_recorded(pulse, index, &mut recorder);
        }
        Conditioning { checkpoint, beats: std::array::from_fn(|k| recorder.beat(k, self.grid)) }
    }

    /// The largest whole interval after the conditioning beat whose test stimulus fails.
    fn erp(&mut self, conditioning: &Conditioning) -> [Result<u32, Absence>; LANES] {
        // Neither end is ever tested: one that survives means that the search range was too narrow.
        let (below, above) = (self.protocol.shortest - 1, self.protocol.longest + 1);
        let mut brackets = conditioning.beats.map(|beat| beat.map(|_| (below, above)));
        loop {
            let tests = brackets
                .map(|b| b.ok().and_then(|(lo, hi)| (hi - lo > 1).then(|| lo.midpoint(hi))));
            if tests.iter().all(Option::is_none) {
                return brackets.map(|bracket| match bracket? {
                    (fails, _) if fails == below => Err(Absence::AlwaysCaptures),
                    (_, captures) if captures == above => Err(Absence::NeverCaptures),
                    (fails, _) => Ok(fails),
                });
            }
            let captured = self.captures(&conditioning.checkpoint, tests);
            for k in 0..LANES {
                if let (Ok((fails, captures)), Some(test)) = (&mut brackets[k], tests[k]) {
                    *(if captured[k] { captures } else { fails }) = test;
                }
            }
        }
    }

    /// Whether the test stimulus at each interval (ms) activates every node within S1 of it.
    fn captures(&mut self, checkpoint: &State, tests: [Option<u32>; LANES]) -> [bool; LANES] {
        let n_nodes = checkpoint.v.len();
        self.strip.state.clone_from(checkpoint);
        let start = tests.map(|test| test.map_or(usize::MAX, |ms| self.steps(ms)));
        let mut recorder = Recorder::new(n_nodes, start);
        let amplitude = self.amplitude(self.protocol.test_strength);
        let window = self.steps(self.protocol.s1);
        let mut decided = tests.map(|test| test.is_none());
        let mut index = self.steps(self.protocol.shortest);
        while !decided.iter().all(|&d| d) {
            let pulse = |k: usize| start[k] <= index && index - start[k] < self.grid.pulse_steps();
            let stimulus: Lane = std::array::from_fn(|k| if pulse(k) { amplitude } else { 0.0 });
            let any = (0..LANES).any(pulse);
            self.strip.step_recorded(any.then_some(&stimulus), index, &mut recorder);
            index += 1;
            if index.is_multiple_of(LOOK_EVERY) {
                let peak = self.strip.peak();
                for k in 0..LANES {
                    let since = index.saturating_sub(start[k]);
                    let quiet = since >= self.grid.pulse_steps() && peak[k] < V_GATE;
                    decided[k] |= quiet || since >= window || recorder.n_activated[k] == n_nodes;
                }
            }
        }
        recorder.n_activated.map(|n| n == n_nodes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ep::Parameters;

    /// CV of the first beat, at full recovery, on a grid `refinement` times finer.
    fn first_cv(refinement: u32, cv_max: f64) -> f64 {
        let fine = f64::from(refinement);
        let coarse = Grid::default();
        let grid = Grid {
            n_along: (coarse.n_along - 1) * refinement as usize + 1,
            spacing: coarse.spacing / fine,
            dt: coarse.dt / fine,
        };
        // The stimulated rows become narrower with the grid, so the stimulus must be stronger.
        let protocol = Protocol { s1: 350, conditioning_strength: fine, ..Protocol::default() };
        let tissue = Parameters::from_array([cv_max, 0.2, 10.0, 120.0, 120.0]).tissue();
        let matrices = Matrices::assemble(grid.n_along);
        let mut pacer = Pacer::new(&grid, &protocol, &matrices, &[tissue; LANES]);
        pacer.conditioning_beat().beats[0].unwrap().cv
    }

    #[test]
    fn conduction_velocity_converges_to_its_closed_form() {
        let cv_max = 0.5;
        let [coarse, medium, fine] = [1, 2, 3].map(|refinement| first_cv(refinement, cv_max));
        // Second order: the error is c/n² on a grid n times finer, so successive differences are in
        // the ratio (1/4 − 1/9) to (1 − 1/4).
        let ratio = (medium - fine) / (coarse - medium);
        assert!((0.12..0.25).contains(&ratio), "{coarse} {medium} {fine}");
        let limit = fine + (fine - medium) / (9.0 / 4.0 - 1.0);
        // The gate closes a little within the front, so the wave is slightly slower than CV_max.
        assert!((0.97..1.0).contains(&(limit / cv_max)), "{limit}");
    }
}
