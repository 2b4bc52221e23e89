//! The state of eight strips and one time step of them.
//!
//! A step is: five forward-Euler substeps of the cells, the stimulus, Crank–Nicolson diffusion.

#![allow(clippy::needless_range_loop, reason = "`k` numbers the lanes of several arrays at once")]

use pulp::{Arch, NullaryFnOnce};

use super::Grid;
use super::fem::Matrices;
use super::lanes::{Diffusion, LANES, Lane};
use super::record::Recorder;
use crate::ep::cell::{StepRates, Tissue, euler_step};

/// Cell substeps in one diffusion step.
const SUBSTEPS: u32 = 5;

/// Steps between looks at whether the strips are at rest; no result depends on it.
const LOOK_EVERY: usize = 50;

/// Below this |V| is set to zero: it halts the decay towards subnormal numbers, which are slow.
const NEGLIGIBLE: f64 = 1e-30;

/// V and h at every node, `[n_nodes]` lanes each.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) v: Vec<Lane>,
    pub(super) h: Vec<Lane>,
}

/// Eight strips of tissue and what is needed to advance them.
#[derive(Debug)]
pub(super) struct LaneStrip<const B: usize> {
    pub(super) state: State,
    diffusion: Diffusion<B>,
    rates: LaneRates,
    /// Nodes that a stimulus excites, the first ones.
    n_stimulated: usize,
    before: Vec<Lane>,
    /// V = 0 everywhere, and stays there until the next stimulus.
    at_rest: bool,
    n_steps: usize,
    arch: Arch,
}

impl<const B: usize> LaneStrip<B> {
    /// Strips at rest: V = 0, h = 1.
    pub(super) fn new(grid: &Grid, matrices: &Matrices<B>, tissues: &[Tissue; LANES]) -> Self {
        let n = matrices.mass.diagonal.len();
        let ratio = tissues.map(|t| t.diffusivity * grid.dt / grid.spacing.powi(2));
        Self {
            state: State { v: vec![[0.0; LANES]; n], h: vec![[1.0; LANES]; n] },
            diffusion: Diffusion::new(matrices, ratio),
            rates: LaneRates::new(tissues.map(|t| t.step_rates(grid.dt / f64::from(SUBSTEPS)))),
            n_stimulated: grid.stimulated_rows() * grid.columns(),
            before: vec![[0.0; LANES]; n],
            at_rest: false,
            n_steps: 0,
            arch: Arch::new(),
        }
    }

    /// Goes on from `state`.
    pub(super) fn set_state(&mut self, state: &State) {
        self.state.clone_from(state);
        self.at_rest = false;
    }

    /// Goes on from `state` in lane `k` alone.
    pub(super) fn set_lane(&mut self, k: usize, state: &State) {
        for (to, from) in [(&mut self.state.v, &state.v), (&mut self.state.h, &state.h)] {
            for (to, from) in to.iter_mut().zip(from) {
                to[k] = from[k];
            }
        }
        self.at_rest = false;
    }

    /// One time step; `stimulus` is what it adds to V at the stimulated nodes.
    pub(super) fn step(&mut self, stimulus: Option<&Lane>) {
        self.arch.dispatch(Step::<B, 0> { strip: self, stimulus, recording: None });
    }

    /// One time step, number `index` since the stimulus, whose threshold crossings are recorded.
    pub(super) fn step_recorded<const D: usize>(
        &mut self,
        stimulus: Option<&Lane>,
        index: usize,
        recorder: &mut Recorder<D>,
    ) {
        self.arch.dispatch(Step { strip: self, stimulus, recording: Some((index, recorder)) });
    }

    /// A step in which nothing but the gates moves: bit for bit what [`LaneStrip::step_inlined`] does.
    #[inline(always)]
    fn rest(&mut self) {
        let rates = self.rates;
        for lane in &mut self.state.h {
            let mut h = *lane;
            for _ in 0..SUBSTEPS {
                for k in 0..LANES {
                    h[k] = euler_step(0.0, h[k], rates.lane(k)).1;
                }
            }
            *lane = h;
        }
    }

    #[inline(always)]
    fn step_inlined(&mut self, stimulus: Option<&Lane>) {
        self.n_steps += 1;
        if self.n_steps.is_multiple_of(LOOK_EVERY) {
            self.at_rest = self.state.v.iter().flatten().all(|v| *v == 0.0);
        }
        self.react();
        if let Some(stimulus) = stimulus {
            self.at_rest = false;
            for v in &mut self.state.v[..self.n_stimulated] {
                for k in 0..LANES {
                    v[k] += stimulus[k];
                }
            }
        }
        self.diffusion.step(&mut self.state.v);
    }

    #[inline(always)]
    fn react(&mut self) {
        let rates = self.rates;
        for (v, h) in self.state.v.iter_mut().zip(&mut self.state.h) {
            react(v, h, &rates);
        }
    }

    /// The largest V of each strip.
    pub(super) fn peak(&self) -> Lane {
        let mut peak = [f64::NEG_INFINITY; LANES];
        for v in &self.state.v {
            for k in 0..LANES {
                peak[k] = peak[k].max(v[k]);
            }
        }
        peak
    }
}

/// [`StepRates`] of every lane.
#[derive(Debug, Clone, Copy)]
struct LaneRates {
    excite: Lane,
    leak: Lane,
    open: Lane,
    close: Lane,
}

impl LaneRates {
    fn new(rates: [StepRates; LANES]) -> Self {
        Self {
            excite: rates.map(|r| r.excite),
            leak: rates.map(|r| r.leak),
            open: rates.map(|r| r.open),
            close: rates.map(|r| r.close),
        }
    }

    #[inline(always)]
    fn lane(&self, k: usize) -> StepRates {
        StepRates {
            excite: self.excite[k],
            leak: self.leak[k],
            open: self.open[k],
            close: self.close[k],
        }
    }
}

/// The cell substeps of one node.
///
/// Copies that stay in registers, and loops over `k` alone: iterators over the lanes were left scalar.
#[inline(always)]
fn react(v: &mut Lane, h: &mut Lane, rates: &LaneRates) {
    let (mut a, mut b) = (*v, *h);
    for _ in 0..SUBSTEPS {
        for k in 0..LANES {
            (a[k], b[k]) = euler_step(a[k], b[k], rates.lane(k));
        }
    }
    for k in 0..LANES {
        a[k] = if a[k].abs() < NEGLIGIBLE { 0.0 } else { a[k] };
    }
    (*v, *h) = (a, b);
}

/// A time step, in the form that is compiled once for each set of vector instructions.
struct Step<'a, const B: usize, const D: usize> {
    strip: &'a mut LaneStrip<B>,
    stimulus: Option<&'a Lane>,
    recording: Option<(usize, &'a mut Recorder<D>)>,
}

impl<const B: usize, const D: usize> NullaryFnOnce for Step<'_, B, D> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let strip = self.strip;
        if strip.at_rest && self.stimulus.is_none() {
            return strip.rest();
        }
        let Some((index, recorder)) = self.recording else {
            return strip.step_inlined(self.stimulus);
        };
        strip.before.copy_from_slice(&strip.state.v);
        strip.step_inlined(self.stimulus);
        recorder.observe(&strip.before, &strip.state.v, index);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ep::Parameters;

    fn strip(arch: Arch) -> LaneStrip<3> {
        let grid = Grid::default();
        let tissues = std::array::from_fn(|k| {
            let x = k as f64 / LANES as f64;
            Parameters::from_array([0.5 + x, 0.05, 2.0 + 20.0 * x, 120.0, 130.0 + 100.0 * x])
                .tissue()
        });
        LaneStrip { arch, ..LaneStrip::new(&grid, &Matrices::assemble(&grid), &tissues) }
    }

    #[test]
    fn vector_instructions_do_not_change_a_single_bit() {
        let (mut plain, mut vector) = (strip(Arch::Scalar), strip(Arch::new()));
        for index in 0..2500 {
            let stimulus = (index < 9).then_some(&[0.1; LANES]);
            plain.step(stimulus);
            vector.step(stimulus);
        }
        assert_eq!(plain.state.v, vector.state.v);
        assert_eq!(plain.state.h, vector.state.h);
        assert!(vector.peak().iter().any(|&v| v > 0.5), "the strips are excited");
    }

    #[test]
    fn steps_at_rest_leave_no_trace() {
        let run = |may_rest: bool| {
            let mut strip = strip(Arch::new());
            for index in 0..7000 {
                strip.at_rest &= may_rest;
                strip.step((index % 6000 < 9).then_some(&[0.1; LANES]));
            }
            (strip.state.v, strip.state.h)
        };
        assert_eq!(run(true), run(false));
    }

    #[test]
    fn strips_come_to_rest_at_exactly_zero() {
        let mut strip = strip(Arch::new());
        for index in 0..6000 {
            strip.step((index < 9).then_some(&[0.1; LANES]));
        }
        assert!(strip.state.v.iter().flatten().all(|v| v.to_bits() & !(1 << 63) == 0));
    }
}
