//! A simulation from its first step to its last.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::lanes::BLOCK;
use super::pacing::PULSE;
use super::record::{Recorder, RecorderState};
use super::solver::{Solver, SolverState};
use super::waves::{Counter, Waves};
use super::{BeatMap, Pacing, Substrate, SurfaceError, by_vertex};
use crate::ep::precision::Precision;

/// A surface that is paced, step by step. Bit-identical for any number of threads.
///
/// ```text
/// let mut simulation = Simulation::<f32>::new(&substrate, &pacing, 0.1)?;
/// rayon::scope(|_| {
///     while !simulation.is_done() {
///         simulation.step()?;
///     }
///     Ok(simulation.beat())
/// })
/// ```
/// From inside rayon's pool, as here, its threads are woken once and not in every step.
#[derive(Debug)]
pub struct Simulation<F> {
    solver: Solver<F>,
    recorder: Recorder<F>,
    counter: Option<Counter<F>>,
    /// Rows that are stimulated, and what a step of it adds to V there.
    rows: Vec<u32>,
    amplitude: F,
    /// Steps at which stimuli begin, and how long they are.
    starts: Vec<u64>,
    pulse: u64,
    /// Steps that are measured.
    measured: std::ops::Range<u64>,
    dt: f64,
    step: u64,
    n_steps: u64,
}

/// What a simulation goes on from, to the same bits.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(bound(deserialize = "F: DeserializeOwned"))]
pub struct State<F> {
    step: u64,
    solver: SolverState<F>,
    recorder: RecorderState,
}

impl<F: Precision> Simulation<F> {
    /// Tissue at rest, to be paced in steps of `dt` ms.
    ///
    /// # Errors
    /// Pacing that makes no sense on this surface, or not a parameter set for each vertex.
    pub fn new(substrate: &Substrate<'_>, pacing: &Pacing, dt: f64) -> Result<Self, SurfaceError> {
        let (vertices, got) = (substrate.mesh.n_vertices(), substrate.tissue.len());
        pacing.validate(vertices, dt)?;
        if vertices != got {
            return Err(SurfaceError::Parameters { vertices, got });
        }
        let solver = Solver::<F>::new(substrate, dt);
        let mut simulation = Self {
            recorder: Recorder::new(vertices.div_ceil(BLOCK)),
            counter: None,
            solver,
            rows: vec![],
            amplitude: F::zero(),
            measured: 0..0,
            starts: vec![],
            pulse: step_of(PULSE, dt),
            dt,
            step: 0,
            n_steps: 0,
        };
        simulation.follow(pacing);
        Ok(simulation)
    }

    /// Takes up `pacing`, which is one of this surface.
    fn follow(&mut self, pacing: &Pacing) {
        let vertex = &self.solver.operators.vertex;
        let mut is_paced = vec![false; vertex.len()];
        for v in &pacing.vertices {
            is_paced[*v as usize] = true;
        }
        let rows = (0..).zip(vertex).filter(|(_, v)| is_paced[**v as usize]);
        self.rows = rows.map(|(row, _)| row).collect();
        self.amplitude = F::of(pacing.strength * self.dt);
        self.starts = pacing.times.iter().map(|t| step_of(*t, self.dt)).collect();
        self.n_steps = step_of(pacing.end, self.dt);
        let end = self.starts.get(pacing.measured + 1).copied().unwrap_or(self.n_steps);
        self.measured = self.starts[pacing.measured]..end;
    }

    /// Goes back to `state`, and from there on as `pacing` says: another S2 after the same S1, say. No beat is measured
    /// any more, and waves are no longer counted until [`Simulation::watch_waves`].
    ///
    /// # Errors
    /// Pacing that makes no sense on this surface; [`SurfaceError::State`] for a state of another surface, or after
    /// the beat has begun that `pacing` measures.
    pub fn branch(&mut self, state: State<F>, pacing: &Pacing) -> Result<(), SurfaceError> {
        let n_vertices = self.solver.operators.vertex.len();
        pacing.validate(n_vertices, self.dt)?;
        if state.step > step_of(pacing.times[pacing.measured], self.dt) {
            return Err(SurfaceError::State);
        }
        self.follow(pacing);
        self.measured = 0..0;
        self.counter = None;
        self.restore(state)
    }

    /// Counts the activations of every vertex from now on.
    pub fn watch_waves(&mut self) {
        self.counter = Some(Counter::new(&self.solver, self.step));
    }

    /// The activations since [`Simulation::watch_waves`]; `None` if they are not counted.
    pub fn waves(&self) -> Option<Waves> {
        let counter = self.counter.as_ref();
        counter.map(|counter| counter.waves(&self.solver.operators.vertex))
    }

    /// Whether the end of the pacing is reached.
    pub fn is_done(&self) -> bool {
        self.step >= self.n_steps
    }

    /// One time step.
    ///
    /// # Errors
    /// [`SurfaceError::Unstable`].
    pub fn step(&mut self) -> Result<(), SurfaceError> {
        let step = self.step;
        let is_on = self.starts.iter().any(|s| (*s..*s + self.pulse).contains(&step));
        let stimulus = is_on.then_some((self.amplitude, &self.rows[..]));
        let is_measured = self.measured.contains(&step);
        let Self { solver, recorder, counter, dt, .. } = self;
        // so that threads are woken once, and not for every loop
        let is_solved = rayon::scope(|_| {
            if is_measured {
                recorder.before(solver);
            }
            let is_solved = solver.step(stimulus);
            if is_measured {
                recorder.after(solver, (step - self.measured.start) as f64, *dt);
            }
            if let Some(counter) = counter {
                counter.after(solver, step, *dt);
            }
            is_solved
        });
        if !is_solved {
            return Err(SurfaceError::Unstable { time: self.time(), dt: self.dt });
        }
        self.step += 1;
        Ok(())
    }

    /// Time that has been simulated, ms.
    pub fn time(&self) -> f64 {
        self.step as f64 * self.dt
    }

    /// V at every vertex.
    pub fn voltage(&self) -> Vec<f64> {
        let v = self.solver.v.as_flattened();
        by_vertex(&self.solver.operators.vertex, v.iter().map(|v| v.f64()))
    }

    /// The measured beat so far.
    pub fn beat(&self) -> BeatMap {
        self.recorder.map(&self.solver.operators.vertex)
    }

    /// Share of the vertices that are not at rest.
    pub fn awake(&self) -> f64 {
        let awake = self.solver.awake.iter().filter(|awake| **awake).count();
        awake as f64 / self.solver.awake.len() as f64
    }

    /// Iterations of the linear solver so far.
    pub fn n_iterations(&self) -> u64 {
        self.solver.n_iterations
    }

    /// What [`Simulation::restore`] goes on from.
    pub fn state(&self) -> State<F> {
        State { step: self.step, solver: self.solver.state(), recorder: self.recorder.state() }
    }

    /// Goes on from where a simulation of the same substrate and pacing was.
    ///
    /// # Errors
    /// [`SurfaceError::State`] if it was on another surface.
    pub fn restore(&mut self, state: State<F>) -> Result<(), SurfaceError> {
        let fits = state.step <= self.n_steps
            && self.solver.restore(&state.solver, state.step)
            && self.recorder.restore(state.recorder);
        if !fits {
            return Err(SurfaceError::State);
        }
        self.step = state.step;
        Ok(())
    }
}

/// The number of steps of `dt` ms in `time` ms.
fn step_of(time: f64, dt: f64) -> u64 {
    (time / dt).round() as u64
}
