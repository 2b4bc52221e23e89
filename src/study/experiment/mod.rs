//! One known truth: calibrated, and the atrium simulated with it and with what was recovered.
//!
//! Figures 3 to 5 of the paper. Every stage keeps what it has done in the output folder, so that an
//! experiment that was interrupted goes on from there.

mod findings;
mod known_truth;
mod settings;
mod simulation;
mod stages;

pub use findings::Findings;
pub use known_truth::KnownTruth;
pub use settings::ExperimentSettings;
pub use simulation::{ExperimentWatch, Simulated, SimulationEvent, SimulationPlan};
