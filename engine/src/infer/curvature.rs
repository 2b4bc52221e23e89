//! How fast a log density falls off along each unknown.

use super::cholesky::Factor;
use super::density::Evaluator;
use super::hamiltonian::{Metric, Shape};
use crate::num::vector::dot;
use faer::Mat;
use serde::{Deserialize, Serialize};

/// Conditional standard deviation of every coordinate, (−∂²ln π/∂qᵢ²)^−½; `missing` where the curvature
/// has the wrong sign.
pub(super) fn conditional_scales(
    evaluator: &mut dyn Evaluator,
    position: &[f64],
    missing: f64,
) -> Vec<f64> {
    let mut scales = vec![missing; position.len()];
    evaluator.hessian(position, &mut |i, column| {
        scales[i] = scale(-column[i], position[i], missing);
    });
    scales
}

/// Of one coordinate.
///
/// No scale is larger than a thousand times the coordinate (or 1). Where a likelihood has
/// saturated, the curvature is next to nothing, or rounding, and would give a scale that no step
/// size suits.
fn scale(precision: f64, position: f64, missing: f64) -> f64 {
    const LARGEST: f64 = 1e3;
    if precision.is_finite() && precision > f64::MIN_POSITIVE {
        precision.powf(-0.5).min(LARGEST * position.abs().max(1.0))
    } else {
        missing
    }
}

/// What the Hessians at some places say of the scales and directions of a density, wherever it is.
///
/// Where coordinates are multiplied by numbers `c` of the density that rest during a trajectory (the coefficients of a
/// field by its amplitudes), what measurements say of them is multiplied, too, and what their prior says is not:
///
/// ```text
/// −Hessian = C G C + D        C = diag(c);  D = 1 for those that are multiplied: they are standard normal
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Curvature {
    /// G, `(dim, dim)`, averaged over places.
    information: Vec<f64>,
    /// ln L ≈ const + slopeᵀθ − ½ θᵀGθ, with θ the coordinates times c; averaged over places, too. What is not
    /// multiplied has its prior in L.
    slope: Vec<f64>,
    /// Coordinates that do not move.
    still: Vec<usize>,
    /// Those of them by which others are multiplied.
    scales: Vec<usize>,
}

impl Curvature {
    pub(super) fn at(evaluator: &mut dyn Evaluator, position: &[f64], still: &[usize]) -> Self {
        let dim = position.len();
        let mut information = vec![0.0; dim * dim];
        evaluator.hessian(position, &mut |j, column| {
            for (i, h) in column.iter().enumerate() {
                information[i * dim + j] -= 0.5 * h;
                information[j * dim + i] -= 0.5 * h;
            }
        });
        let multipliers = evaluator.multipliers(position);
        let largest = multipliers.iter().copied().fold(0.0, f64::max);
        for (i, row) in information.chunks_exact_mut(dim).enumerate() {
            row[i] -= prior(multipliers[i]);
            for (x, c) in row.iter_mut().zip(&multipliers) {
                *x /= factor(multipliers[i]) * factor(*c);
                if [multipliers[i], *c].iter().any(|c| *c != 0.0 && *c < UNSEEN * largest) {
                    *x = 0.0;
                }
            }
        }
        let mut gradient = vec![0.0; dim];
        evaluator.ln_density(position, &mut gradient);
        let mut theta: Vec<f64> =
            position.iter().zip(&multipliers).map(|(x, c)| x * factor(*c)).collect();
        // the likelihood sees what they multiply alone
        for i in still {
            theta[*i] = 0.0;
        }
        let slope = multipliers.iter().enumerate().map(|(i, c)| {
            if *c != 0.0 && *c < UNSEEN * largest {
                return 0.0;
            }
            let here = (gradient[i] + prior(*c) * position[i]) / factor(*c);
            here + dot::<4>(&information[i * dim..][..dim], &theta)
        });
        let slope = slope.collect();
        let mut moved = position.to_vec();
        let mut is_scale = |i: &usize| {
            moved[*i] += 0.1;
            let there = evaluator.multipliers(&moved);
            moved[*i] = position[*i];
            there.iter().zip(&multipliers).any(|(a, b)| a.to_bits() != b.to_bits())
        };
        let scales = still.iter().copied().filter(|i| is_scale(i)).collect();
        Self { information, slope, still: still.to_vec(), scales }
    }

    /// Coordinates that do not move, and by which others are multiplied.
    pub(super) fn scales(&self) -> &[usize] {
        &self.scales
    }

    /// G
    pub(super) fn information(&self, i: usize, j: usize) -> f64 {
        self.information[i * self.slope.len() + j]
    }

    /// The slope of the normal likelihood in θᵢ.
    pub(super) fn slope_at(&self, i: usize, theta: &[f64]) -> f64 {
        let dim = self.slope.len();
        self.slope[i] - dot::<4>(&self.information[i * dim..][..dim], theta)
    }

    /// Coordinates in blocks of which measurements see no two together.
    pub(super) fn seen_together(&self, mut left: Vec<usize>) -> Vec<Vec<usize>> {
        let mut blocks = vec![];
        while let Some(first) = left.pop() {
            let (mut block, mut reached) = (vec![first], 0);
            while let Some(i) = block.get(reached).copied() {
                block.extend(left.extract_if(.., |j| self.information(i, *j) != 0.0));
                reached += 1;
            }
            blocks.push(block);
        }
        blocks
    }

    /// Counts what `others` say as much as what was known before.
    pub(super) fn learn(&mut self, others: &[Self]) {
        let share = 0.5 / others.len() as f64;
        let mix = |own: &mut [f64], of: &dyn Fn(&Self) -> &[f64]| {
            for (i, x) in own.iter_mut().enumerate() {
                *x = 0.5 * *x + share * others.iter().map(|other| of(other)[i]).sum::<f64>();
            }
        };
        mix(&mut self.information, &|other| &other.information);
        mix(&mut self.slope, &|other| &other.slope);
    }

    /// What is known at another place.
    pub(super) fn again(&self, evaluator: &mut dyn Evaluator, position: &[f64]) -> Self {
        Self::at(evaluator, position, &self.still)
    }

    /// Whether it is of `dim` coordinates.
    pub(super) fn fits(&self, dim: usize) -> bool {
        Some(self.information.len()) == dim.checked_mul(dim)
            && self.slope.len() == dim
            && self.still.iter().chain(&self.scales).all(|i| *i < dim)
    }

    /// Where coordinates are multiplied by `multipliers`: their scales, and the Hessian in units of these. Where the
    /// density does not fall off, or hardly, it counts as falling off a little. Coordinates that are still have the
    /// scale 0.
    pub(super) fn metric(&self, multipliers: &[f64]) -> Metric {
        let dim = multipliers.len();
        let c: Vec<f64> = multipliers.iter().map(|c| factor(*c)).collect();
        let at = |i: usize, j: usize| {
            let prior = if i == j { prior(multipliers[i]) } else { 0.0 };
            c[i] * c[j] * self.information[i * dim + j] + prior
        };
        let mut metric = Metric::diagonal((0..dim).map(|i| scale(at(i, i), 0.0, 1.0)).collect());
        for i in &self.still {
            metric.scale[*i] = 0.0;
        }
        let scale = &metric.scale;
        let precision = |least: f64| {
            let of = |i: usize, j: usize| {
                if i == j { 1.0 + least } else { scale[i] * scale[j] * at(i, j) }
            };
            Factor::of(Mat::from_fn(dim, dim, of).as_ref())
        };
        if let Some(factor) = LEAST.into_iter().find_map(precision) {
            metric.shape = Shape::Precision(factor);
        }
        metric
    }
}

/// Added to the Hessian in units of the scales, whose diagonal is 1: the first with which it falls off in every direction.
const LEAST: [f64; 6] = [1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0];

/// A coordinate whose multiplier is a smaller part of the largest is not seen by measurements.
const UNSEEN: f64 = 1e-6;

/// What a coordinate with this multiplier is multiplied by.
fn factor(multiplier: f64) -> f64 {
    if multiplier == 0.0 { 1.0 } else { multiplier }
}

/// The curvature of its prior, if it is multiplied.
fn prior(multiplier: f64) -> f64 {
    f64::from(u8::from(multiplier != 0.0))
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
        let metric = Curvature::at(&mut *evaluator, &[0.3, 20.0, 1.0], &[]).metric(&[0.0; 3]);
        let mut gradient = [0.0; 3];
        for position in [[1.0, 100.0, 0.0], [-3.0, -300.0, 0.0]] {
            evaluator.ln_density(&position, &mut gradient);
            let (whitened, mut force) = (metric.whitened(&position), vec![0.0; 3]);
            metric.pull(&gradient, &mut force);
            // the force of a standard normal is minus its position
            for (x, f) in whitened.iter().zip(&force) {
                assert!((x + f).abs() < 1e-3 * (1.0 + x.abs()), "{whitened:?} {force:?}");
            }
        }
        let still = Curvature::at(&mut *evaluator, &[0.3, 20.0, 1.0], &[1]).metric(&[0.0; 3]);
        let mut moved = [0.0; 3];
        still.drift(&mut moved, 1.0, &[1.0, 0.0, 1.0]);
        assert!(still.scale[1] == 0.0 && moved[1] == 0.0, "{still:?}");
    }

    /// Where the density rises in some directions, a metric lets all move.
    #[test]
    fn a_saddle_has_a_metric() {
        for coupling in [1.05, 3.0] {
            let f = |q: &[f64], g: &mut [f64]| {
                (g[0], g[1]) = (-q[0] - coupling * q[1], -q[1] - coupling * q[0]);
                -0.5 * (q[0] * q[0] + q[1] * q[1]) - coupling * q[0] * q[1]
            };
            let density = FnDensity { dim: 2, f };
            let saddle = Curvature::at(&mut *density.evaluator(), &[0.1, 0.2], &[]);
            let mut moved = [0.0; 2];
            saddle.metric(&[0.0; 2]).drift(&mut moved, 1.0, &[1.0, -0.3]);
            assert!(moved.iter().all(|x| (0.1..10.0).contains(&x.abs())), "{moved:?}");
        }
    }

    /// A coordinate s that rests, and two that exp(s) multiplies, seen together.
    struct Multiplied;

    impl Evaluator for Multiplied {
        fn ln_density(&mut self, q: &[f64], g: &mut [f64]) -> f64 {
            let (a, b) = (q[1], q[2]);
            let seen = q[0].exp() * (a + 2.0 * b) - 1.0;
            let force = -10.0 * seen * q[0].exp();
            g.copy_from_slice(&[force * (a + 2.0 * b), force - a, 2.0 * force - b]);
            -5.0 * seen * seen - 0.5 * (a * a + b * b)
        }
        fn multipliers(&mut self, q: &[f64]) -> Vec<f64> {
            vec![0.0, q[0].exp(), q[0].exp()]
        }
    }

    /// A metric that follows is that of the Hessian there; one that does not is another.
    #[test]
    fn the_metric_follows_what_multiplies_coordinates() {
        let at = |s: f64| Curvature::at(&mut Multiplied, &[s, 0.4, 0.3], &[0]);
        let there = Multiplied.multipliers(&[1.0, 0.4, 0.3]);
        let flat = |metric: Metric| {
            let mut moved = [[0.0; 3]; 2];
            metric.drift(&mut moved[0], 1.0, &[0.0, 1.0, 0.0]);
            metric.drift(&mut moved[1], 1.0, &[0.0, 0.0, 1.0]);
            moved.concat()
        };
        let (right, followed) = (flat(at(1.0).metric(&there)), flat(at(0.0).metric(&there)));
        let left = flat(at(0.0).metric(&Multiplied.multipliers(&[0.0; 3])));
        let gap = |a: &[f64]| a.iter().zip(&right).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(gap(&followed) < 1e-4 && gap(&left) > 0.1, "{right:?} {followed:?} {left:?}");
    }
}
