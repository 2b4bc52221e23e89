//! One known truth, calibrated, and the atrium simulated with both.

mod simulation;

pub use simulation::{Listener, Simulated, SimulationEvent, SimulationPlan};
