//! What a model lacks: the loop of residual, missing effect, new model, error before and after.
//!
//! A search is made on Laplace fits ([`Engine`]) of the model with an offset on whatever its
//! likelihoods compare with their measurements: a random effect of each site, a further error of each
//! row, and the effects that are tried ([`Candidate`]). What is claimed must beat the same search on
//! data simulated from the model without it ([`criticise`]). Knows nothing of electrophysiology but
//! the usual names of columns.

mod candidates;
mod checks;
mod claim;
mod engine;
mod error;
mod fine;
mod fit;
mod heldout;
mod judge;
mod leave;
mod newton;
mod nulls;
mod observable;
mod outer;
mod procedure;
mod rewrite;
mod rivals;
mod screen;
mod search;
mod units;

pub use candidates::{Candidate, Level, Screen, Unusable};
pub use checks::{Warning, check_heldout};
pub use engine::{Engine, Outer, RowAt, Term};
pub use error::CriticismError;
pub use fine::FINER;
pub use fit::{Cavity, Fit};
pub use heldout::{Predicted, Score, predict_rows, score_of, with_heldout};
pub use judge::{CLAIM, least_log_bf};
pub use leave::{Left, leave_out, leave_sites_out, leave_units_out};
pub use procedure::{Case, Outcome, Record, Round, Settings, criticise};
pub use rewrite::rewrite;
pub use units::{Unit, site_column};
