//! What a run leaves on disk and on the screen.

mod dataset;

pub use dataset::{Group, Variable};
