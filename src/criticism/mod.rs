//! What a model lacks: the loop of residual, missing effect, new model, error before and after.

mod candidates;
mod engine;
mod observable;
mod outer;
mod search;

pub use candidates::{Candidate, Column, Form, Level, Unusable, candidates, read_column};
pub use engine::{Cavity, Engine, Fit, Outer, RowAt, Term};
pub use observable::observables;
pub use outer::{Free, optimise, score};
pub use search::{Left, Tried, f_test, field_sd, leave_sites_out, search, simulate};
