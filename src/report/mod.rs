//! What a run leaves on disk and on the screen.
//!
//! Knows arrays of draws, summaries, a mesh and a record of the run; nothing of models, samplers or the simulator.
//! Every file and folder appears whole or not at all.

mod atomic;
mod dataset;
mod draws;
mod error;
mod zarr;

pub use dataset::{Group, Values, Variable};
pub use draws::write_draws;
pub use error::ReportError;
pub use zarr::write_zarr;
