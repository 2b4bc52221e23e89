//! When each vertex activates and recovers in one beat.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::by_vertex;
use super::lanes::{BLOCK, meets};
use super::solver::Solver;
use crate::ep::precision::Precision;

/// V at which an upstroke counts as activation; one of the levels of [`RECOVERY`].
pub(super) const ACTIVATION: f64 = RECOVERY[1];

/// V at which a downstroke counts as recovery to 20, 30, 50 and 90 %.
const RECOVERY: [f64; 4] = [0.8, 0.7, 0.5, 0.1];

/// V below which a vertex has recovered to 90 %.
pub(super) const REPOLARISED: f64 = RECOVERY[3];

/// One beat at every vertex, ms; NaN where a vertex does not activate or not recover.
#[derive(Debug, Clone, PartialEq)]
pub struct BeatMap {
    /// Local activation time, since the stimulus.
    pub lat: Vec<f64>,
    /// Action potential duration at 20 % recovery.
    pub apd20: Vec<f64>,
    /// At 30 %.
    pub apd30: Vec<f64>,
    /// At 50 %.
    pub apd50: Vec<f64>,
    /// At 90 %.
    pub apd90: Vec<f64>,
}

impl BeatMap {
    /// Names of the maps, in the order of [`BeatMap::named`].
    pub const NAMES: [&str; 5] = ["lat", "apd20", "apd30", "apd50", "apd90"];

    /// The maps with their names.
    pub fn named(self) -> impl Iterator<Item = (&'static str, Vec<f64>)> {
        let Self { lat, apd20, apd30, apd50, apd90 } = self;
        Self::NAMES.into_iter().zip([lat, apd20, apd30, apd50, apd90])
    }
}

/// The first activation of a vertex and its first recovery after it, ms; NaN before.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Crossings {
    lat: f64,
    recovery: [f64; 4],
}

/// Crossings of one beat, by row.
#[derive(Debug)]
pub(super) struct Recorder<F> {
    before: Vec<[F; BLOCK]>,
    crossings: Vec<Crossings>,
}

/// What has been recorded so far.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct RecorderState(Vec<Crossings>);

impl<F: Precision> Recorder<F> {
    pub(super) fn new(n_blocks: usize) -> Self {
        let none = Crossings { lat: f64::NAN, recovery: [f64::NAN; 4] };
        Self { before: vec![[F::zero(); BLOCK]; n_blocks], crossings: vec![none; n_blocks * BLOCK] }
    }

    pub(super) fn state(&self) -> RecorderState {
        RecorderState(self.crossings.clone())
    }

    /// Goes on from `state`; whether it is one of this surface.
    #[must_use = "false: the state is of another surface"]
    pub(super) fn restore(&mut self, state: RecorderState) -> bool {
        let fits = state.0.len() == self.crossings.len();
        if fits {
            self.crossings = state.0;
        }
        fits
    }

    /// Keeps V before a step.
    pub(super) fn before(&mut self, solver: &Solver<F>) {
        self.before.par_iter_mut().zip(&solver.v).for_each(|(before, v)| *before = *v);
    }

    /// Notes the crossings of the step that began `steps` steps of `dt` ms after the stimulus; linear in
    /// time within it. Blocks that sleep cross nothing.
    pub(super) fn after(&mut self, solver: &Solver<F>, steps: f64, dt: f64) {
        let (arch, levels) = (solver.arch, RECOVERY.map(F::of));
        let blocks = self.before.par_iter().zip(&solver.v).zip(&solver.awake);
        let blocks = blocks.zip(self.crossings.par_chunks_mut(BLOCK));
        blocks.filter(|((_, awake), _)| **awake).for_each(|(((before, after), _), crossings)| {
            let meets = arch.dispatch(|| meets(&levels, before, after));
            for i in (0..BLOCK).filter(|i| meets[*i]) {
                let (a, b) = (before[i].f64(), after[i].f64());
                note(a, b, &mut crossings[i], |share| (steps + share) * dt);
            }
        });
    }

    pub(super) fn map(&self, vertex: &[u32]) -> BeatMap {
        let of = |value: fn(&Crossings) -> f64| by_vertex(vertex, self.crossings.iter().map(value));
        BeatMap {
            lat: of(|c| c.lat),
            apd20: of(|c| c.recovery[0] - c.lat),
            apd30: of(|c| c.recovery[1] - c.lat),
            apd50: of(|c| c.recovery[2] - c.lat),
            apd90: of(|c| c.recovery[3] - c.lat),
        }
    }
}

/// The crossings of one vertex as V goes from `a` to `b`; `time` of the share of the step that is done.
fn note(a: f64, b: f64, crossing: &mut Crossings, time: impl Fn(f64) -> f64) {
    let at = |level: f64| time((level - a) / (b - a));
    if crossing.lat.is_nan() && a < ACTIVATION && b >= ACTIVATION {
        crossing.lat = at(ACTIVATION);
    }
    for (recovery, level) in crossing.recovery.iter_mut().zip(RECOVERY) {
        if !crossing.lat.is_nan() && recovery.is_nan() && a > level && b <= level {
            *recovery = at(level);
        }
    }
}
