//! The restricted likelihood of a Gaussian process, and the one matrix from which everything else of it follows.
//!
//! The formulas are those of [`Gp`](super::Gp).

use faer::linalg::solvers::{DenseSolveCore, Llt};
use faer::{Mat, Side};

use crate::infer::{Evaluator, LogDensity};

/// Smallest g. It keeps R invertible where the output is smooth and exact.
const LEAST_NUGGET: f64 = 1e-7;

/// Mean of the normal prior of ln ℓ, whose standard deviation is 1; ℓ is in half widths of the
/// inputs' ranges. The prior is needed because with a much longer lengthscale the process is a
/// polynomial, and only rounding would tell how long it is.
const LN_LENGTHSCALE: f64 = 1.0;

/// Inputs scaled to −1..1, and outputs.
#[derive(Debug, Clone)]
pub(super) struct Points {
    /// Middle and half width of each input.
    pub(super) scales: Vec<(f64, f64)>,
    pub(super) x: Vec<Vec<f64>>,
    pub(super) y: Vec<f64>,
}

/// M and what else follows from the lengthscales and the nugget.
#[derive(Debug, Clone)]
pub(super) struct System {
    pub(super) correlations: Mat<f64>,
    pub(super) inverse: Mat<f64>,
    /// M (y, 0), which is (Qy, β)
    pub(super) weights: Vec<f64>,
    pub(super) variance: f64,
    pub(super) nugget: f64,
    pub(super) ln_evidence: f64,
}

impl Points {
    pub(super) fn new(inputs: &[Vec<f64>], outputs: &[f64]) -> Self {
        let n_inputs = inputs.first().map_or(0, Vec::len);
        let scale = |d: usize| {
            let values = || inputs.iter().map(|x| x[d]);
            let (low, high) = (
                values().fold(f64::INFINITY, f64::min),
                values().fold(f64::NEG_INFINITY, f64::max),
            );
            (0.5 * (low + high), 0.5 * (high - low))
        };
        let scales: Vec<(f64, f64)> = (0..n_inputs).map(scale).collect();
        let x = inputs.iter().map(|x| scaled(x, &scales)).collect();
        Self { scales, x, y: outputs.to_vec() }
    }

    /// Terms of the mean.
    pub(super) fn n_terms(&self) -> usize {
        1 + self.scales.len()
    }

    /// M⁻¹, inverted; `None` if it is singular.
    pub(super) fn system(&self, ln_lengthscales: &[f64], ln_nugget: f64) -> Option<System> {
        let (n, p) = (self.y.len(), self.n_terms());
        let nugget = ln_nugget.exp() + LEAST_NUGGET;
        let shrunk: Vec<Vec<f64>> = self.x.iter().map(|x| shrink(x, ln_lengthscales)).collect();
        let correlations = Mat::from_fn(n, n, |i, j| correlation(&shrunk[i], &shrunk[j]));
        let matrix =
            Mat::from_fn(n, n, |i, j| correlations[(i, j)] + if i == j { nugget } else { 0.0 });
        let terms = Mat::from_fn(n, p, |i, k| if k == 0 { 1.0 } else { self.x[i][k - 1] });
        let (factor, ln_determinant) = cholesky(&matrix)?;
        let alone = factor.inverse();
        let leaning = &alone * &terms;
        let (trend, ln_trend_determinant) = cholesky(&(terms.transpose() * &leaning))?;
        let trend = trend.inverse();
        let b = &leaning * &trend;
        let y = Mat::from_fn(n, 1, |i, _| self.y[i]);
        let beta = b.transpose() * &y;
        // without the trend first: with it, a long lengthscale would leave differences of large numbers
        let left = &y - &terms * &beta;
        let residual = &alone * &left;
        let square: f64 = (0..n).map(|i| residual[(i, 0)] * left[(i, 0)]).sum();
        let variance = square / (n - p) as f64;
        let ln_evidence =
            -0.5 * (ln_determinant + ln_trend_determinant) - 0.5 * (n - p) as f64 * variance.ln();
        let q = &alone - &b * leaning.transpose();
        let inverse = Mat::from_fn(n + p, n + p, |i, j| match (i < n, j < n) {
            (true, true) => q[(i, j)],
            (true, false) => b[(i, j - n)],
            (false, true) => b[(j, i - n)],
            (false, false) => -trend[(i - n, j - n)],
        });
        let weight = |i: usize| if i < n { residual[(i, 0)] } else { beta[(i - n, 0)] };
        let weights = (0..n + p).map(weight).collect();
        let is_sound = variance > 0.0 && ln_evidence.is_finite();
        let system = System { correlations, inverse, weights, variance, nugget, ln_evidence };
        is_sound.then_some(system)
    }
}

/// The factor of a symmetric positive definite matrix, and the logarithm of its determinant.
fn cholesky(matrix: &Mat<f64>) -> Option<(Llt<f64>, f64)> {
    let factor = matrix.llt(Side::Lower).ok()?;
    let diagonal = (0..matrix.nrows()).map(|i| factor.L()[(i, i)].ln());
    let ln_determinant = 2.0 * diagonal.sum::<f64>();
    Some((factor, ln_determinant))
}

pub(super) fn scaled(x: &[f64], scales: &[(f64, f64)]) -> Vec<f64> {
    x.iter().zip(scales).map(|(x, (middle, half))| (x - middle) / half).collect()
}

pub(super) fn shrink(x: &[f64], ln_lengthscales: &[f64]) -> Vec<f64> {
    x.iter().zip(ln_lengthscales).map(|(x, l)| x * (-l).exp()).collect()
}

/// exp(−½ |x − y|²)
pub(super) fn correlation(x: &[f64], y: &[f64]) -> f64 {
    let squared: f64 = x.iter().zip(y).map(|(a, b)| (a - b) * (a - b)).sum();
    (-0.5 * squared).exp()
}

/// The restricted likelihood as a function of (ln ℓ, ln g).
impl LogDensity for Points {
    fn dim(&self) -> usize {
        self.scales.len() + 1
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        Box::new(Evidence(self))
    }
}

struct Evidence<'a>(&'a Points);

impl Evaluator for Evidence<'_> {
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        let Some((&ln_nugget, ln_lengthscales)) = position.split_last() else {
            return f64::NEG_INFINITY;
        };
        let Some(s) = self.0.system(ln_lengthscales, ln_nugget) else {
            return f64::NEG_INFINITY;
        };
        gradient.fill(0.0);
        let (n, x) = (self.0.y.len(), &self.0.x);
        // ½ tr((Qy yᵀQ/σ² − Q) ∂R), an entry at a time
        let entry = |i: usize, j: usize| {
            0.5 * (s.weights[i] * s.weights[j] / s.variance - s.inverse[(i, j)])
        };
        for i in 0..n {
            for j in 0..i {
                let weight = 2.0 * entry(i, j) * s.correlations[(i, j)];
                for (d, l) in ln_lengthscales.iter().enumerate() {
                    gradient[d] += weight * ((x[i][d] - x[j][d]) * (-l).exp()).powi(2);
                }
            }
            gradient[ln_lengthscales.len()] += entry(i, i) * ln_nugget.exp();
        }
        let mut ln_density = s.ln_evidence;
        for (slope, l) in gradient.iter_mut().zip(ln_lengthscales) {
            let off = l - LN_LENGTHSCALE;
            ln_density -= 0.5 * off * off;
            *slope -= off;
        }
        ln_density
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surrogate::gp::tests::sampled;

    #[test]
    fn the_gradient_of_the_evidence_is_that_of_differences() {
        let (x, y) = sampled(25, 1.0);
        let points = Points::new(&x, &y);
        let (at, mut gradient, mut unused) = ([0.3, -0.2, -3.0], [0.0; 3], [0.0; 3]);
        Evidence(&points).ln_density(&at, &mut gradient);
        for d in 0..3 {
            let mut value = |step: f64| {
                let mut shifted = at;
                shifted[d] += step;
                Evidence(&points).ln_density(&shifted, &mut unused)
            };
            let difference = (value(1e-4) - value(-1e-4)) / 2e-4;
            assert!((gradient[d] - difference).abs() < 1e-5, "{d}: {} {difference}", gradient[d]);
        }
    }
}
