//! How often each vertex activates from some time on, and when: what one beat's first crossings do not tell.

use rayon::prelude::*;

use super::lanes::{BLOCK, meets};
use super::record::{ACTIVATION, REPOLARISED};
use super::solver::Solver;
use crate::ep::precision::Precision;

/// The activations of every vertex since [`Simulation::watch_waves`](super::Simulation::watch_waves).
///
/// A vertex activates where V rises through 0.7, and again once V has been below 0.1 (90 % recovery) in between. One
/// that is still above 0.1 when this begins is only counted after it has recovered.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Waves {
    /// When each vertex first activated, ms since this began; NaN if it did not.
    pub first: Vec<f64>,
    /// When it last did; NaN if it did not.
    pub last: Vec<f64>,
    /// How often it did.
    pub counts: Vec<u32>,
}

/// The activations of one vertex.
#[derive(Debug, Clone, Copy)]
struct Front {
    first: f64,
    last: f64,
    count: u32,
    has_recovered: bool,
}

/// Counts activations, by row.
#[derive(Debug)]
pub(super) struct Counter<F> {
    before: Vec<[F; BLOCK]>,
    fronts: Vec<Front>,
    begin: u64,
}

impl<F: Precision> Counter<F> {
    /// From the step `begin` on, which is the next.
    pub(super) fn new(solver: &Solver<F>, begin: u64) -> Self {
        let front = |v: &F| Front {
            first: f64::NAN,
            last: f64::NAN,
            count: 0,
            has_recovered: v.f64() <= REPOLARISED,
        };
        let fronts = solver.v.as_flattened().iter().map(front).collect();
        Self { before: solver.v.clone(), fronts, begin }
    }

    /// Notes the activations of step number `step` of `dt` ms; linear in time within it. Blocks that sleep have none.
    pub(super) fn after(&mut self, solver: &Solver<F>, step: u64, dt: f64) {
        let (arch, levels) = (solver.arch, [ACTIVATION, REPOLARISED].map(F::of));
        let steps = (step - self.begin) as f64;
        let blocks = self.before.par_iter_mut().zip(&solver.v).zip(&solver.awake);
        let blocks = blocks.zip(self.fronts.par_chunks_mut(BLOCK));
        blocks.for_each(|(((before, after), awake), fronts)| {
            if *awake {
                let meets = arch.dispatch(|| meets(&levels, before, after));
                for i in (0..BLOCK).filter(|i| meets[*i]) {
                    let (a, b) = (before[i].f64(), after[i].f64());
                    fronts[i].note(a, b, |share| (steps + share) * dt);
                }
            }
            *before = *after;
        });
    }

    pub(super) fn waves(&self, vertex: &[u32]) -> Waves {
        let n = vertex.len();
        let mut waves =
            Waves { first: vec![f64::NAN; n], last: vec![f64::NAN; n], counts: vec![0; n] };
        for (v, front) in vertex.iter().zip(&self.fronts) {
            let v = *v as usize;
            waves.first[v] = front.first;
            waves.last[v] = front.last;
            waves.counts[v] = front.count;
        }
        waves
    }
}

impl Front {
    /// V goes from `a` to `b`; `time` of the share of the step that is done.
    fn note(&mut self, a: f64, b: f64, time: impl Fn(f64) -> f64) {
        if b <= REPOLARISED {
            self.has_recovered = true;
        }
        if self.has_recovered && a < ACTIVATION && b >= ACTIVATION {
            self.last = time((ACTIVATION - a) / (b - a));
            self.first = if self.count == 0 { self.last } else { self.first };
            self.count += 1;
            self.has_recovered = false;
        }
    }
}
