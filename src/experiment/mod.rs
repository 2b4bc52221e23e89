//! Experiments on known truth, and what a further measurement would teach.
//!
//! The paper's synthetic experiment for any model whose fields declare a range: fields from a Matérn-5/2
//! prior, scaled into range and repaired, measured at maximin sites. Knows a model, a basis and tables; no
//! files, and nothing of how a posterior is sampled.

mod design;
mod error;
mod laboratory;
mod next;
mod score;
mod truth;

pub use design::{Design, Experiment, experiment};
pub use error::ExperimentError;
pub use laboratory::{Laboratory, Visit};
pub use next::{Lesson, Minutes, lessons};
pub use score::{INTERVALS, agree, coverage, rms_error, thinned};
pub use truth::{TRUTH_MODES, Truth, conduction, repaired};
