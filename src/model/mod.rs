//! The model language: the [`model!`](crate::model) macro, and what its statements become.
//!
//! One value vector `v` holds every number of one evaluation: constrained parameters, field values at
//! probes, linear predictors, offsets. A measurement depends on W of them: a row is W indices into
//! `v`, its likelihood is evaluated in a dual number of width W, and its derivatives are added at the
//! same indices of the adjoint `g`. Everything between parameters and `v` is linear or a kernel's
//! spectral density, with a hand-written adjoint. Nothing here knows the EP simulator.

mod augmented;
mod blocked;
mod builder;
mod density;
mod equations;
mod error;
mod form;
mod gp;
mod lets;
mod linear;
mod local;
mod macros;
mod maps;
mod model;
mod parameter;
mod prior_draws;
mod restore;
mod rows;
mod scalar;
mod scope;
mod tape;
mod units;
mod uses;

pub use augmented::{AddedEffect, Augmented};
pub use blocked::Sampler;
pub use builder::outlying;
pub use density::Density;
pub use equations::equations;
pub use error::ModelError;
pub use form::{Form, families};
pub use lets::LetValues;
pub use local::{RowId, Split};
pub use maps::{MapName, MapSummary, Maps};
pub use model::{Declare, Kind, Model, Observe, Parameter, Statement};
pub use rows::{Curvature, Noise};
pub use tape::Tape;

/// What the expansion of [`model!`](crate::model) names; not for people.
#[doc(hidden)]
pub mod expansion {
    pub use super::builder::{Builder, Len};
    pub use super::density::{DensityFn, Terms};
    pub use super::form::Form;
    pub use super::gp::KernelFn;
    pub use super::maps::LetFn;
    pub use super::parameter::{PriorFn, SequenceFn};
    pub use super::rows::{Column, Columns, RowFn, read_column};
    pub use super::scalar::ScalarFn;
    pub use super::scope::{Scope, Take, lift, one};
    pub use super::units::Decl;
    pub use super::uses::{mentions_columns, uses, uses_through};
}
