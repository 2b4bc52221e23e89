//! How fast a log density falls off along each unknown.

use super::density::Evaluator;

/// Conditional standard deviation of every coordinate, (−∂²ln π/∂qᵢ²)^−½ by central differences of
/// the gradient; `missing` where the curvature has the wrong sign.  Costs 2 dim evaluations.
///
/// No scale is larger than a thousand times the coordinate (or 1): where a likelihood has saturated
/// the curvature is next to nothing, or rounding, and no step size would suit the scale it gives.
pub(super) fn conditional_scales(
    evaluator: &mut dyn Evaluator,
    position: &[f64],
    missing: f64,
) -> Vec<f64> {
    const LARGEST: f64 = 1e3;
    let mut moved = position.to_vec();
    let mut gradient = vec![0.0; position.len()];
    let mut scale = |i: usize| {
        let h = 1e-5 * position[i].abs().max(1.0);
        let mut slope_at = |q: f64| {
            moved[i] = q;
            let ln_density = evaluator.ln_density(&moved, &mut gradient);
            moved[i] = position[i];
            if ln_density.is_finite() { gradient[i] } else { f64::NAN }
        };
        let precision = -(slope_at(position[i] + h) - slope_at(position[i] - h)) / (2.0 * h);
        let usable = precision.is_finite() && precision > f64::MIN_POSITIVE;
        let most = LARGEST * position[i].abs().max(1.0);
        if usable { precision.powf(-0.5).min(most) } else { missing }
    };
    (0..position.len()).map(&mut scale).collect()
}
