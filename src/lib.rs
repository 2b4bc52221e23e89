//! Calibration of cardiac electrophysiology parameter fields on an atrial surface.
//!
//! A layer imports only from layers below it; `tests/architecture.rs` holds this table.
//!
//! | layer | modules |
//! |---|---|
//! | 6 | [`cli`] |
//! | 5 | [`report`], [`study`], [`criticism`] |
//! | 4 | `models/*.rs`, through [`prelude`] only |
//! | 3 | [`dsl`] |
//! | 2 | [`field`], [`surrogate`], [`infer`], [`diagnostics`] |
//! | 1 | [`dist`], [`likelihood`], [`manifold`], [`ep`] |
//! | 0 | [`mesh`], [`num`], [`error`], [`cache`], [`atomic`] |

pub mod atomic;
pub mod cache;
pub mod cli;
pub mod criticism;
pub mod diagnostics;
pub mod dist;
pub mod dsl;
pub mod ep;
pub mod error;
pub mod field;
pub mod infer;
pub mod likelihood;
pub mod manifold;
pub mod mesh;
pub mod num;
pub mod prelude;
pub mod report;
pub mod study;
pub mod surrogate;
