//! A model laid out on its data: what the statements of [`model!`](crate::prelude::model) become.
//!
//! One value vector `v` holds every number of one evaluation: constrained parameters, field values
//! at probes, linear predictors, offsets. A measurement depends on W of them, so a row is W indices
//! into `v`. Its likelihood is evaluated in a dual number of width W, and its derivatives are added
//! at the same indices of the adjoint `g`.
//!
//! Everything between parameters and `v` is linear, or the spectral density of a kernel, and has a
//! hand-written adjoint. Nothing here knows the EP simulator.

mod augmented;
mod blocked;
mod breakthrough;
mod builder;
mod compiled_rows;
mod coordinate;
mod corrected;
mod declare;
mod density;
mod discrepancy;
mod equations;
mod error;
mod everywhere;
mod exceedance;
mod expression;
pub mod forms;
mod functions;
mod gp;
mod interpreted;
mod laid_out;
mod late;
mod late_maps;
mod lets;
mod linear;
mod local;
mod map;
mod map_columns;
mod maps;
mod operator;
mod over;
mod parameter;
mod passes;
mod predictor;
mod prior_draws;
mod reported;
mod rescale;
mod restore;
mod row_line;
mod row_math;
mod row_place;
mod rows;
mod scalar;
mod scope;
mod second;
mod shifts;
mod shipped;
mod tape;

pub use augmented::{AddedEffect, Augmented};
pub use blocked::{Predictive, Sampler};
pub use breakthrough::Breakthrough;
pub use declare::{Compiled, Declare};
pub use density::Density;
pub use discrepancy::{Discrepancy, RowError, Spread};
pub use equations::equations;
pub use error::ModelError;
pub use exceedance::{Exceedance, ExceedanceError};
pub use forms::{EffectForm, Form};
pub use interpreted::{Beyond, Interpreted};
pub use laid_out::{Model, Observe};
pub use lets::LetValues;
pub use local::{RowId, Split, Visit};
pub use maps::{Asked, MapName, MapSummary, Maps, Summaries};
pub use operator::{Adjoints, Everywhere, Memo, Off, Operands, Operator, operator_error};
pub use reported::{Kind, Parameter};
pub use rows::{Curvature, Noise};
pub use tape::Tape;

/// What the code refers to that [`model!`](crate::prelude::model) expands to. It is not meant to be
/// used by hand.
#[doc(hidden)]
pub mod expansion {
    pub use super::builder::{Builder, Computed, Len, Operation, Place, Range};
    pub use super::expression::*;
    pub use super::forms::Form;
    pub use super::functions::*;
    pub use super::shipped::*;
    pub use crate::dist::{Dist, Vector, vector};
    pub use crate::field::Kernel;
    pub use crate::likelihood::Likelihood;
    pub use crate::num::{Num, Real, within};
}
