//! What a model lacks: the loop of residual, missing effect, new model, error before and after.
//!
//! A search works on Laplace fits ([`Engine`]) of the model. What a likelihood compares with its
//! measurement has an offset, which holds a random effect of each site and the effects that are
//! tried ([`Candidate`]). Each row has a further error. What is claimed must do better than the
//! same search on data simulated from the model without it ([`criticise`]).
//!
//! Knows nothing of electrophysiology. What columns mean it asks the table
//! ([`Role`](crate::table::Role)).
//!
//! Files, each of which uses only those above it:
//!
//! | | |
//! |---|---|
//! | words | `cause`, `candidate`, `progress`, `error` |
//! | the table | `units`, `checks`, `propose` |
//! | fits | `engine`, `system`, `fit`, `newton`, `laplace`, `slope`, `outer`, `leave`, `screen`, `fine` |
//! | a round | `bench`, `search`, `nulls`, `refute`, `rivals`, `claim`, `judge`, `remainder` |
//! | all | `procedure`; `heldout` and `rewrite` for what follows it |
//!
//! The fits before and after are made in the room `closed_loop`.

mod bench;
mod candidate;
mod cause;
mod checks;
mod claim;
mod engine;
mod error;
mod fine;
mod fit;
mod heldout;
mod judge;
mod judgement;
mod laplace;
mod leave;
mod newton;
mod nulls;
mod observable;
mod outer;
mod procedure;
mod progress;
mod propose;
mod refute;
mod remainder;
mod rewrite;
mod rivals;
mod screen;
mod search;
mod slope;
mod system;
mod units;

pub use bench::Subject;
pub use candidate::{Candidate, Level, Screen, Unusable};
pub use cause::Cause;
pub use checks::{Warning, check_heldout};
pub use engine::{Engine, Outer, RowAt, TriedTerm};
pub use error::CriticismError;
pub use fine::FINER;
pub use fit::{Cavity, LaplaceFit};
pub use heldout::{Predicted, Predictions, Score, predict_rows, score_of, with_heldout};
pub use judgement::{
    CLAIM, Judgement, Record, Refutation, Round, UNEXPLAINED, UnitScore, least_log_bf,
};
pub use leave::{Left, leave_out, leave_sites_out, leave_units_out};
pub use observable::observables;
pub use procedure::{Criticism, SearchSettings, criticise, criticise_remembering};
pub use progress::{Remembered, SearchProgress, Watch};
pub use rewrite::{Findings, rewrite};
pub use units::{Unit, site_column, site_name};
