//! A generalised additive model: a sum of one smooth function of each input, by penalised B-splines.
//!
//! Knows inputs and one output as numbers; it knows nothing of what they mean.
//!
//! ```text
//! y ≈ β₀ + Σ_d s_d(x_d),   s_d = Σ_j β_dj B_j(x_d),   ten cubic B-splines on uniform knots over the range of x_d
//! minimises |y − ŷ|² + λ Σ_d Σ_j (β_dj − 2 β_d,j+1 + β_d,j+2)²
//! λ from a grid minimises n |y − ŷ|² / (n − 1.4 tr H)²,   H the hat matrix
//! ```
//!
//! # Source
//! Wood 2017, "Generalized Additive Models", 4.2 and 6.2; settings as in pygam's `LinearGAM.gridsearch`.

use nalgebra::{DMatrix, DVector};
use thiserror::Error;

/// B-splines of each smooth.
const N_SPLINES: usize = 10;

/// Pieces between their knots.
const N_PIECES: usize = N_SPLINES - 3;

/// Weight of an effective degree of freedom in the score. Above 1, it counts against wiggly
/// smooths.
const GAMMA: f64 = 1.4;

/// Penalties that are tried: 10⁻³ to 10³, the same for all inputs.
const GRID: usize = 11;

/// A tiny penalty on every coefficient. A constant could go into any of the smooths; with this it
/// goes into none.
const RIDGE: f64 = 1.5e-8;

/// A fitted additive model.
#[derive(Debug, Clone, PartialEq)]
pub struct Gam {
    /// The smooth of each input.
    pub smooths: Vec<Smooth>,
    /// Mean of the output.
    pub mean: f64,
    /// The penalty λ that was chosen.
    pub penalty: f64,
    /// Effective degrees of freedom.
    pub degrees_of_freedom: f64,
    /// Share of the output's variance that the model explains.
    pub r_squared: f64,
    /// Rows used.
    pub n_points: usize,
}

/// The smooth of one input; its mean over the rows is 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Smooth {
    /// Smallest and largest value of the input among the rows.
    pub range: (f64, f64),
    /// Sensitivity index: variance of the smooth at the rows over that of the output.
    pub index: f64,
    coefficients: [f64; N_SPLINES],
    offset: f64,
}

/// Rows from which no additive model follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum GamError {
    /// Fewer rows than coefficients.
    #[error(
        "an additive model of {n_inputs} inputs needs more than {needed} rows, but only {n_points} are left after filtering\n\
         help: use a larger design (500 points) or a wider filter"
    )]
    TooFewPoints {
        /// Rows given.
        n_points: usize,
        /// Inputs.
        n_inputs: usize,
        /// Coefficients of the model.
        needed: usize,
    },
    /// The output is the same on all rows.
    #[error(
        "the output is the same on all {n_points} rows: nothing to explain\nhelp: use a design that varies more"
    )]
    Constant {
        /// Rows given.
        n_points: usize,
    },
    /// The rows do not determine the smooths.
    #[error("the rows do not determine the smooths\nhelp: use a larger design")]
    Degenerate,
}

impl Smooth {
    /// The smooth at `x`, in the unit of the output. Outside [`Smooth::range`] it is the value at
    /// the nearer end.
    pub fn at(&self, x: f64) -> f64 {
        let (first, weights) = splines(x, self.range);
        let terms = weights.iter().zip(&self.coefficients[first..]);
        terms.map(|(w, c)| w * c).sum::<f64>() - self.offset
    }
}

/// The four B-splines that are not 0 at `x`, and the place of the first.
fn splines(x: f64, (lower, upper): (f64, f64)) -> (usize, [f64; 4]) {
    let t = ((x - lower) / (upper - lower)).clamp(0.0, 1.0) * N_PIECES as f64;
    let piece = (t as usize).min(N_PIECES - 1);
    let u = t - piece as f64;
    let rising = [
        (1.0 - u).powi(3),
        (3.0 * u - 6.0) * u * u + 4.0,
        ((3.0 - 3.0 * u) * u + 3.0) * u + 1.0,
        u.powi(3),
    ];
    (piece, rising.map(|w| w / 6.0))
}

/// Fits `outputs` `(n)` on `inputs` `(n, n_inputs)`.
///
/// # Errors
/// [`GamError`]
pub fn fit_gam(inputs: &[Vec<f64>], outputs: &[f64]) -> Result<Gam, GamError> {
    let (n_points, n_inputs) = (outputs.len(), inputs.first().map_or(0, Vec::len));
    let needed = 1 + n_inputs * N_SPLINES;
    if n_points <= needed {
        return Err(GamError::TooFewPoints { n_points, n_inputs, needed });
    }
    let ranges: Vec<(f64, f64)> = (0..n_inputs).map(|d| range(inputs, d)).collect();
    let (basis, offsets) = centred_basis(inputs, &ranges);
    let mean = outputs.iter().sum::<f64>() / n_points as f64;
    let y = DVector::from_iterator(n_points, outputs.iter().map(|y| y - mean));
    if !(y.norm_squared() > 0.0) || ranges.iter().any(|(lower, upper)| !(lower < upper)) {
        return Err(GamError::Constant { n_points });
    }
    let penalties = (0..GRID).map(|i| 10f64.powf(-3.0 + 0.6 * i as f64));
    let fits = penalties.filter_map(|penalty| Penalised::fit(&basis, &y, n_inputs, penalty));
    let best = fits.min_by(|a, b| a.score.total_cmp(&b.score)).ok_or(GamError::Degenerate)?;
    let smooths = ranges.iter().enumerate().map(|(d, &range)| {
        let columns = d * N_SPLINES..(d + 1) * N_SPLINES;
        let own = best.coefficients.rows(columns.start, N_SPLINES);
        let values = basis.columns(columns.start, N_SPLINES) * own;
        let coefficients: [f64; N_SPLINES] = std::array::from_fn(|j| own[j]);
        let offset = coefficients.iter().zip(&offsets[columns]).map(|(c, o)| c * o).sum();
        let index = values.norm_squared() / y.norm_squared();
        Smooth { range, index, coefficients, offset }
    });
    Ok(Gam {
        smooths: smooths.collect(),
        mean,
        penalty: best.penalty,
        degrees_of_freedom: best.degrees_of_freedom,
        r_squared: 1.0 - best.squared_residual / y.norm_squared(),
        n_points,
    })
}

fn range(inputs: &[Vec<f64>], d: usize) -> (f64, f64) {
    let values = || inputs.iter().map(|row| row[d]);
    (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
}

/// All B-splines at all rows less their means, `(n, n_inputs × N_SPLINES)`; and these means.
fn centred_basis(inputs: &[Vec<f64>], ranges: &[(f64, f64)]) -> (DMatrix<f64>, Vec<f64>) {
    let mut basis = DMatrix::zeros(inputs.len(), ranges.len() * N_SPLINES);
    for (i, row) in inputs.iter().enumerate() {
        for (d, (&x, &range)) in row.iter().zip(ranges).enumerate() {
            let (first, weights) = splines(x, range);
            for (j, weight) in weights.into_iter().enumerate() {
                basis[(i, d * N_SPLINES + first + j)] = weight;
            }
        }
    }
    let means: Vec<f64> = basis.row_mean().iter().copied().collect();
    for (mut column, mean) in basis.column_iter_mut().zip(&means) {
        column.add_scalar_mut(-mean);
    }
    (basis, means)
}

/// The fit under one penalty.
struct Penalised {
    coefficients: DVector<f64>,
    penalty: f64,
    degrees_of_freedom: f64,
    squared_residual: f64,
    score: f64,
}

impl Penalised {
    fn fit(basis: &DMatrix<f64>, y: &DVector<f64>, n_inputs: usize, penalty: f64) -> Option<Self> {
        let gram = basis.tr_mul(basis);
        let mut penalised = gram.clone() + DMatrix::identity(gram.nrows(), gram.nrows()) * RIDGE;
        for d in 0..n_inputs {
            for j in 0..N_SPLINES - 2 {
                let at = d * N_SPLINES + j;
                for (a, x) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                    for (b, y) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                        penalised[(at + a, at + b)] += penalty * x * y;
                    }
                }
            }
        }
        let factor = penalised.cholesky()?;
        let coefficients = factor.solve(&basis.tr_mul(y));
        let squared_residual = (y - basis * &coefficients).norm_squared();
        // the mean is one more degree of freedom
        let degrees_of_freedom = 1.0 + factor.solve(&gram).trace();
        let n = y.len() as f64;
        let score = n * squared_residual / (n - GAMMA * degrees_of_freedom).powi(2);
        Some(Self { coefficients, penalty, degrees_of_freedom, squared_residual, score })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surrogate::design::latin_hypercube;

    fn additive(x: &[f64]) -> f64 {
        (3.0 * x[0]).sin() + 2.0 * x[1]
    }

    fn fitted(noise: f64) -> (Vec<Vec<f64>>, Vec<f64>, Gam) {
        let inputs = latin_hypercube(200, &[(0.0, 2.0), (-1.0, 1.0), (0.0, 1.0)], 2);
        let wiggle = |i: usize| noise * (17.0 * i as f64).sin();
        let outputs: Vec<f64> =
            inputs.iter().enumerate().map(|(i, x)| additive(x) + wiggle(i)).collect();
        let gam = fit_gam(&inputs, &outputs).unwrap();
        (inputs, outputs, gam)
    }

    #[test]
    fn splines_add_up_to_one_and_are_smooth() {
        for i in 0..=100 {
            let x = 0.03 * f64::from(i);
            let weights = splines(x, (0.0, 3.0)).1;
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
        }
        // across a knot the last three of one piece are the first three of the next
        let [below, above] = [-1e-9, 1e-9].map(|e| splines(3.0 / 7.0 + e, (0.0, 3.0)));
        assert_eq!((below.0, above.0), (0, 1));
        assert!((0..3).all(|j| (below.1[j + 1] - above.1[j]).abs() < 1e-8));
    }

    #[test]
    fn an_additive_function_is_found_and_its_variance_divided() {
        let (inputs, outputs, gam) = fitted(0.0);
        for (x, y) in inputs.iter().zip(&outputs) {
            let fit = gam.mean + gam.smooths.iter().zip(x).map(|(s, x)| s.at(*x)).sum::<f64>();
            assert!((fit - y).abs() < 0.01, "{fit} {y}");
        }
        let variance = |f: &dyn Fn(&[f64]) -> f64| {
            let values: Vec<f64> = inputs.iter().map(|x| f(x)).collect();
            let mean = values.iter().sum::<f64>() / 200.0;
            values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 200.0
        };
        let all = variance(&additive);
        let expected = [variance(&|x| (3.0 * x[0]).sin()) / all, variance(&|x| 2.0 * x[1]) / all];
        for (smooth, expected) in gam.smooths.iter().zip(expected) {
            assert!((smooth.index - expected).abs() < 0.01, "{} {expected}", smooth.index);
        }
        assert!(gam.smooths[2].index < 1e-4 && gam.r_squared > 0.999, "{gam:?}");
    }

    #[test]
    fn noise_takes_a_larger_penalty() {
        assert!(fitted(1.0).2.penalty > fitted(0.01).2.penalty);
    }

    #[test]
    fn too_few_or_equal_rows_are_refused() {
        let (inputs, outputs, _) = fitted(0.0);
        let few = fit_gam(&inputs[..31], &outputs[..31]);
        assert_eq!(few, Err(GamError::TooFewPoints { n_points: 31, n_inputs: 3, needed: 31 }));
        assert_eq!(fit_gam(&inputs, &[4.0; 200]), Err(GamError::Constant { n_points: 200 }));
    }
}
