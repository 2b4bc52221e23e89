//! How fast a log density falls off along each unknown.

use super::density::Evaluator;

/// Conditional standard deviation of every coordinate, (−∂²ln π/∂qᵢ²)^−½; `missing` where the curvature
/// has the wrong sign.
///
/// No scale is larger than a thousand times the coordinate (or 1). Where a likelihood has
/// saturated, the curvature is next to nothing, or rounding, and would give a scale that no step
/// size suits.
pub(super) fn conditional_scales(
    evaluator: &mut dyn Evaluator,
    position: &[f64],
    missing: f64,
) -> Vec<f64> {
    const LARGEST: f64 = 1e3;
    let mut scales = vec![missing; position.len()];
    evaluator.hessian(position, &mut |i, column| {
        let precision = -column[i];
        if precision.is_finite() && precision > f64::MIN_POSITIVE {
            scales[i] = precision.powf(-0.5).min(LARGEST * position[i].abs().max(1.0));
        }
    });
    scales
}
