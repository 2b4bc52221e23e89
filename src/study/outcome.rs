//! What came of a case of a plan.

use super::plan::Case;

/// What came of one case.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The case.
    pub case: Case,
    /// Whether the mode was reached, or the draws can be used.
    pub converged: bool,
    /// Share of vertices whose estimate was unphysical and repaired.
    pub repaired: f64,
    /// By field and derived quantity, in the order of [`Study::names`](super::Study::names).
    pub errors: Vec<MapError>,
    /// What was done, if the plan says how long it takes.
    pub time: Option<Time>,
}

/// How the time of a case was spent.
#[derive(Clone, Debug)]
pub struct Time {
    /// Minutes in all.
    pub minutes: f64,
    /// How often each `observe` was measured.
    pub measured: Vec<(&'static str, usize)>,
}

/// How far an estimate is from the truth over the surface.
#[derive(Clone, Debug)]
pub struct MapError {
    /// Root mean squared error over all vertices, in the map's unit.
    pub rmse: f64,
    /// Share of vertices whose truth lies in each of [`INTERVALS`](crate::experiment::INTERVALS); only from draws.
    pub coverage: Option<[f64; 3]>,
}
