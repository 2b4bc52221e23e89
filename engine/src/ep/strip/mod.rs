//! A strip of tissue paced from one end: CV, APD90 and the effective refractory periods.
//!
//! 24.0 × 0.6 mm unless told otherwise, 81 × 3 nodes, P1 elements with consistent mass, no-flux
//! boundary, split time steps; set up like the reference simulations (openCARP) on which the ERP
//! surrogates rest.
//! Many parameter sets are run eight at a time as vector lanes, the batches in parallel; the
//! outcome of a set depends on nothing but the set.
//!
//! # Source
//! Coveney et al. 2022, Methods, "surrogate simulation"; details found by comparison with the
//! authors' published tables.

mod fem;
mod grid;
mod lanes;
mod outcome;
mod record;
mod search;
mod simulate;
mod tissue;

pub use grid::{Grid, GridError};
pub use outcome::{Absence, Beat, StripOutcome};
pub use simulate::{StripError, simulate_strips};
