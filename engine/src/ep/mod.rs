//! Electrophysiology: the cell, the tissue strip, the pacing protocols.
//!
//! Knows parameters and what tissue does with them; it knows nothing of probability.

pub mod cell;
pub mod paced_cell;
mod precision;
pub mod protocol;
mod restitution;
pub mod strip;
pub mod surface;
pub mod table;

pub use cell::{Parameters, Tissue};
pub use precision::Precision;
pub use protocol::Protocol;
pub use restitution::Restitution;
pub use strip::{Absence, Beat, Grid, GridError, StripError, StripOutcome, simulate_strips};
