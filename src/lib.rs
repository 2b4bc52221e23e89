//! Calibration of cardiac electrophysiology parameter fields on an atrial surface.
//!
//! A layer imports only from layers below it; `tests/architecture.rs` holds this table.
//!
//! | layer | modules |
//! |---|---|
//! | 7 | [`cli`] |
//! | 6 | [`study`], [`closed_loop`] |
//! | 5 | [`run`], [`report`], [`import`] |
//! | 4 | [`experiment`], [`criticism`]; `models/*.rs`, through [`prelude`] only |
//! | 3 | [`model`](mod@model) |
//! | 2 | [`table`], [`field`], [`surrogate`], [`infer`], [`diagnostics`], [`anatomy`] |
//! | 1 | [`dist`], [`likelihood`], [`manifold`], [`ep`] |
//! | 0 | [`mesh`], [`num`], [`random`], [`error`], [`store`] |

// `model!` names this crate as its users do
extern crate self as eplat;

pub use eplat_engine::{
    anatomy, criticism, diagnostics, dist, ep, error, field, infer, likelihood, manifold, mesh,
    model, num, prelude, random, store, surrogate, table,
};

pub mod cli;
pub mod closed_loop;
pub mod experiment;
pub mod import;
pub mod report;
pub mod run;
pub mod study;
