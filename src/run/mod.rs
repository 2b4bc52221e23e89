//! From a model and its inputs to a fit, its verdict and its files: all that the program does, for
//! programs.

pub mod atrium;
mod compare;
mod error;
mod event;
mod fit;
mod folder;
mod inputs;
mod keep;
mod maps;
mod mode;
mod problem;
mod record;
mod results;
mod sample;
mod warm_start;
mod write;

pub use crate::infer::Settings;
pub use crate::experiment::Design;
pub use compare::{CompareError, Comparison};
pub use error::RunError;
pub use event::{Event, Watch};
pub use fit::{Fit, Method, Options};
pub use folder::OutputFolder;
pub use inputs::{DataSource, Inputs, MeshSource, hash, hash_file};
pub use keep::Keep;
pub use maps::FittedMap;
pub use mode::Mode;
pub use problem::{Domain, Loaded, Problem, surface};
pub use results::Results;
pub use sample::Ended;
pub use warm_start::WarmStartError;
