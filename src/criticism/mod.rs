//! What a model lacks: the loop of residual, missing effect, new model, error before and after.

mod candidates;
mod engine;
mod error;
mod observable;
mod outer;
mod procedure;
mod search;
mod units;

pub use candidates::{Candidate, Level, Unusable, candidates};
pub use engine::{Cavity, Engine, Fit, Outer, RowAt, Term};
pub use error::CriticismError;
pub use observable::{observables, step_of};
pub use procedure::{Case, Outcome, Record, Round, Settings, criticise, gain};
pub use search::{Left, Tried, leave_sites_out};
