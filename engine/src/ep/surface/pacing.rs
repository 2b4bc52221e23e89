//! Where and when a surface is paced.

use thiserror::Error;

/// How long a stimulus acts, ms: the strip's.
pub(super) const PULSE: f64 = 0.9;

/// Where and when a surface is paced.
#[derive(Debug, Clone, PartialEq)]
pub struct Pacing {
    /// Vertices that are stimulated.
    pub vertices: Vec<u32>,
    /// When stimuli begin, ms, in order.
    pub times: Vec<f64>,
    /// What a stimulus adds to V, 1/ms.
    pub strength: f64,
    /// When the simulation ends, ms.
    pub end: f64,
    /// Which stimulus' beat is measured, from 0; until the next stimulus.
    pub measured: usize,
}

/// A simulation that cannot be done.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SurfaceError {
    /// No vertex, no stimulus, or a number that makes no sense.
    #[error("{what}\nhelp: {help}")]
    Impossible {
        /// What is wrong.
        what: String,
        /// What to do.
        help: &'static str,
    },
    /// A step whose diffusion has no solution: V has run away.
    #[error(
        "V ran away at {time:.1} ms in steps of {dt} ms\nhelp: give a shorter time step; tau_in asks for the shortest"
    )]
    Unstable {
        /// When, ms.
        time: f64,
        /// Time step, ms.
        dt: f64,
    },
    /// A state to go on from that another simulation left.
    #[error(
        "the state is of another simulation\nhelp: go on with the mesh, parameters and pacing that it began with"
    )]
    State,
    /// Not a parameter set for each vertex.
    #[error(
        "the mesh has {vertices} vertices, but there are parameters for {got}\nhelp: give one set for each vertex"
    )]
    Parameters {
        /// Vertices of the mesh.
        vertices: usize,
        /// Parameter sets.
        got: usize,
    },
}

impl Pacing {
    /// Checks that a mesh of `n_vertices` can be paced so in steps of `dt` ms.
    ///
    /// # Errors
    /// What makes no sense.
    pub fn validate(&self, n_vertices: usize, dt: f64) -> Result<(), SurfaceError> {
        let wrong = |what: String, help| Err(SurfaceError::Impossible { what, help });
        if !(dt > 0.0 && dt <= 0.5) {
            return wrong(format!("a time step of {dt} ms"), "give one above 0 and up to 0.5 ms");
        }
        if self.vertices.is_empty() {
            return wrong("no vertex is stimulated".into(), "give a vertex, or a larger radius");
        }
        if let Some(v) = self.vertices.iter().find(|v| **v as usize >= n_vertices) {
            let what = format!("vertex {v} is not on the mesh, which has {n_vertices}");
            return wrong(what, "vertices are counted from 0");
        }
        let ordered = self.times.windows(2).all(|t| t[0] + PULSE < t[1]);
        let within = self.times.iter().all(|t| (0.0..self.end).contains(t));
        if self.times.is_empty() || !ordered || !within || !self.end.is_finite() {
            let what = format!("stimuli at {:?} ms do not fit before {} ms", self.times, self.end);
            return wrong(what, "give at least one, in order, a ms apart, before the end");
        }
        if self.measured >= self.times.len() {
            let (beat, n) = (self.measured + 1, self.times.len());
            return wrong(format!("there is no beat {beat} among {n}"), "measure one of them");
        }
        if !(self.strength.is_finite() && self.strength > 0.0) {
            let what = format!("a stimulus of {} per ms excites nothing", self.strength);
            return wrong(what, "give a strength above 0");
        }
        Ok(())
    }
}
