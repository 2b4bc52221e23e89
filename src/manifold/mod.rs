//! The Laplace–Beltrami operator of a surface: eigenpairs, distances and measurement sites.
//!
//! Lengths are millimetres; knows nothing of probability or electrophysiology.

mod basis;

pub use basis::Basis;
