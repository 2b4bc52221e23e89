//! What a model stands on: surfaces and fields, priors and likelihoods, samplers, tissue, and the
//! layout of a model on its data. It knows no files of a run, no report and no command line.
//!
//! Programs use all of this through the crate `eplat`, which exports it.

// `model!` and the models call this by the name of the whole
extern crate self as eplat;

pub mod anatomy;
pub mod criticism;
pub mod diagnostics;
pub mod dist;
pub mod ep;
pub mod error;
pub mod field;
pub mod infer;
pub mod likelihood;
pub mod manifold;
pub mod mesh;
pub mod model;
pub mod num;
pub mod prelude;
pub mod random;
pub mod store;
pub mod surrogate;
pub mod table;
