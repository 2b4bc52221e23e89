//! What is what on a left atrium: its openings, coordinates that are the same for all atria, and fibres that are
//! carried from one atrium to another.
//!
//! # Source
//! Roney et al. 2019, "Universal atrial coordinates applied to visualisation, registration and construction of patient
//! specific meshes".

mod coordinates;
mod error;
mod fibres;
mod openings;
mod patch;
mod seams;
#[cfg(test)]
mod tests;
mod tubes;
mod ways;

pub use coordinates::Coordinates;
pub use error::AnatomyError;
pub use fibres::carry_fibres;
pub use openings::{Opening, Openings, around, middle, openings};
