//! How fast a log density falls off along each unknown.

use super::density::Evaluator;
use super::hamiltonian::Metric;
use faer::{Mat, Side};

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

/// The metric that suits a normal with this Hessian at `position`: scales, and directions in which the density
/// falls off faster or slower than along the coordinates. Where it does not fall off, the scales count alone.
/// Coordinates that are `still` have the scale 0: they do not move.
pub(super) fn metric_at(
    evaluator: &mut dyn Evaluator,
    position: &[f64],
    still: &[usize],
) -> Metric {
    /// Variance along a direction, in units of the scales, that is left to the scales.
    const USUAL: std::ops::Range<f64> = 0.5..2.0;
    /// Largest such variance that is believed.
    const LARGEST: f64 = 100.0;
    let dim = position.len();
    let mut metric = Metric::diagonal(conditional_scales(evaluator, position, 1.0));
    for i in still {
        metric.scale[*i] = 0.0;
    }
    let scale = &metric.scale;
    let mut precision = Mat::<f64>::zeros(dim, dim);
    evaluator.hessian(position, &mut |j, column| {
        for i in 0..dim {
            let half = -0.5 * scale[i] * scale[j] * column[i];
            precision[(i, j)] += half;
            precision[(j, i)] += half;
        }
    });
    for i in still {
        precision[(*i, *i)] = 1.0;
    }
    let is_finite = precision.col_iter().all(|column| column.iter().all(|x| x.is_finite()));
    let Some(eigen) = is_finite.then(|| precision.self_adjoint_eigen(Side::Lower).ok()).flatten()
    else {
        return metric;
    };
    let (mut directions, mut stretch) = (vec![], vec![]);
    for (r, &value) in eigen.S().column_vector().iter().enumerate() {
        let variance = if value > 0.0 { value.recip().min(LARGEST) } else { 1.0 };
        if !USUAL.contains(&variance) {
            directions.extend(eigen.U().col(r).iter());
            stretch.push(variance.sqrt());
        }
    }
    (metric.directions, metric.stretch) = (directions, stretch);
    metric
}

#[cfg(test)]
mod tests {
    use super::super::LogDensity as _;
    use super::super::test_densities::FnDensity;
    use super::*;

    /// Of a normal with correlation 0.99 and sds 1 and 100, and a coordinate without curvature.
    #[test]
    fn the_metric_of_a_normal_whitens_its_ridge() {
        let (sd, rho) = ([1.0, 100.0], 0.99);
        let f = move |q: &[f64], g: &mut [f64]| {
            let x = [q[0] / sd[0], q[1] / sd[1]];
            let a = [x[0] - rho * x[1], x[1] - rho * x[0]].map(|a| a / (1.0 - rho * rho));
            (g[0], g[1], g[2]) = (-a[0] / sd[0], -a[1] / sd[1], 0.0);
            -0.5 * (x[0] * a[0] + x[1] * a[1])
        };
        let density = FnDensity { dim: 3, f };
        let mut evaluator = density.evaluator();
        let metric = metric_at(&mut *evaluator, &[0.3, 20.0, 1.0], &[]);
        // 1 / (1 − ρ) along the ridge; 1 / (1 + ρ) across it is left to the scales
        assert!(metric.stretch.len() == 1 && (metric.stretch[0] - 10.0).abs() < 1e-3, "{metric:?}");
        let mut gradient = [0.0; 3];
        for position in [[1.0, 100.0, 0.0], [-3.0, -300.0, 0.0]] {
            evaluator.ln_density(&position, &mut gradient);
            let (mut whitened, mut force) = (position.to_vec(), vec![0.0; 3]);
            metric.whiten(&mut whitened);
            metric.pull(&gradient, &mut force);
            // the force of a standard normal is minus its position
            for (x, f) in whitened.iter().zip(&force) {
                assert!((x + f).abs() < 1e-3 * (1.0 + x.abs()), "{whitened:?} {force:?}");
            }
        }
        let still = metric_at(&mut *evaluator, &[0.3, 20.0, 1.0], &[1]);
        assert!(still.scale[1] == 0.0 && still.stretch.is_empty(), "{still:?}");
    }
}
