//! What maps need the whole surface at once: gradients, and what is computed of them.

use super::everywhere::PlaceFn;
use super::map::{MapFn, Source};
use crate::manifold::Gradient;

/// Those of a model, but for the maps of its operators.
#[derive(Debug, Default)]
pub(super) struct LateMaps {
    pub(super) steepness: Vec<Steepness>,
    pub(super) lets: Vec<LateLet>,
}

/// The map of `let name(x) = gradient(EXPR);`.
#[derive(Debug)]
pub(super) struct Steepness {
    pub(super) name: &'static str,
    pub(super) unit: String,
    /// Where the numbers of the expression come from.
    pub(super) sources: Vec<Source>,
    pub(super) math: Box<dyn PlaceFn>,
    pub(super) gradient: Gradient,
}

/// The map of a `let` that mentions a gradient.
#[derive(Debug)]
pub(super) struct LateLet {
    pub(super) name: &'static str,
    pub(super) unit: String,
    pub(super) range: Option<(f64, f64)>,
    pub(super) sources: Vec<LateSource>,
    pub(super) at: Box<dyn MapFn>,
}

/// Where a number of such a `let` comes from.
#[derive(Clone, Copy, Debug)]
pub(super) enum LateSource {
    Early(Source),
    /// The gradient number `.0`.
    Steepness(usize),
}
