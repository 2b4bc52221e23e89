//! Validation on known truth: a [`Plan`] of many synthetic experiments, block by block, and one experiment
//! with all its maps.

mod calibrate;
mod error;
mod experiment;
mod figure;
mod outcome;
mod plan;
mod recovery;
mod results;
mod slurm;

pub use calibrate::Study;
pub use error::StudyError;
pub use experiment::{
    ExperimentSettings, ExperimentWatch, Findings, KnownTruth, Simulated, SimulationEvent,
    SimulationPlan,
};
pub use figure::{pictures, table_text, write_figure, write_summary};
pub use outcome::{MapError, Outcome, Time};
pub use plan::{Block, Case, Choice, Estimate, Plan};
pub use recovery::{RecoveredMap, Recovery, recover};
pub use results::{Group, Results, Table, summarise};
pub use slurm::JobArray;
