//! What a model lacks: the loop of residual, missing effect, new model, error before and after.

mod candidates;
mod engine;
mod error;
mod heldout;
mod observable;
mod outer;
mod procedure;
mod rewrite;
mod search;
mod units;

pub use candidates::{Candidate, Level, Unusable, candidates};
pub use engine::{Cavity, Engine, Fit, Outer, RowAt, Term};
pub use error::CriticismError;
pub use heldout::{Predicted, Score, predict_rows, score_of, with_heldout};
pub use observable::{observables, step_of};
pub use procedure::{Case, Outcome, Record, Round, Settings, criticise, gain};
pub use rewrite::rewrite;
pub use search::{Left, Tried, leave_sites_out};
