//! A cubic polynomial in two inputs and its least-squares fit.
//!
//! Knows two inputs t and a and one output; it knows nothing of where they come from.
//!
//! ```text
//! f(t, a) = c₀ + c₁ t + c₂ a + c₃ t² + c₄ a² + c₅ t a + c₆ t³ + c₇ a³ + c₈ t² a + c₉ t a²
//! ```

use nalgebra::{DMatrix, DVector};
use thiserror::Error;

use crate::num::Real;

/// Number of coefficients.
pub const N_TERMS: usize = 10;

/// Names of the terms, in the order of the coefficients.
pub const TERMS: [&str; N_TERMS] = ["1", "t", "a", "t2", "a2", "ta", "t3", "a3", "t2a", "ta2"];

/// Powers of t and a in each term.
const POWERS: [(i32, i32); N_TERMS] =
    [(0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (1, 1), (3, 0), (0, 3), (2, 1), (1, 2)];

/// Coefficients in the order of [`TERMS`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cubic(pub [f64; N_TERMS]);

impl Cubic {
    /// The polynomial at (t, a), with derivatives if the inputs carry them.
    #[inline(always)]
    pub fn eval<D: Real>(&self, t: D, a: D) -> D {
        let [c0, c1, c2, c3, c4, c5, c6, c7, c8, c9] = self.0;
        let order_0 = ((a * c7 + c4) * a + c2) * a + c0;
        let order_1 = (a * c9 + c5) * a + c1;
        let order_2 = t * c6 + a * c8 + c3;
        (order_2 * t + order_1) * t + order_0
    }
}

/// A fitted cubic and how well it fits; errors in the unit of the output.
#[derive(Debug, Clone, PartialEq)]
pub struct CubicFit {
    /// The polynomial.
    pub cubic: Cubic,
    /// Points used.
    pub n_points: usize,
    /// Root mean square residual.
    pub rmse: f64,
    /// Largest absolute residual.
    pub max_error: f64,
    /// Root mean square error at each point of the fit made without it.
    pub leave_one_out: f64,
}

/// A fit that the points do not determine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum FitError {
    /// Not more points than coefficients.
    #[error(
        "a cubic has {N_TERMS} coefficients, but only {n_points} points are left after filtering\n\
         help: use a larger design (100 points) or a wider filter"
    )]
    TooFewPoints {
        /// Points given.
        n_points: usize,
    },
    /// The points lie on a curve on which some cubic vanishes.
    #[error(
        "the {n_points} points do not determine a cubic: the inputs do not vary independently\n\
         help: use a design that varies both inputs, as `eplat surrogate design` makes"
    )]
    Degenerate {
        /// Points given.
        n_points: usize,
    },
}

/// Least squares by QR over `points` (t, a, output).
///
/// # Errors
/// [`FitError`] where the points are too few or do not vary independently.
pub fn fit(points: &[[f64; 3]]) -> Result<CubicFit, FitError> {
    let n_points = points.len();
    if n_points <= N_TERMS {
        return Err(FitError::TooFewPoints { n_points });
    }
    // Inputs are scaled to at most 1, so that columns are of comparable size.
    let size =
        |column: usize| points.iter().map(|p| p[column].abs()).fold(f64::MIN_POSITIVE, f64::max);
    let (size_t, size_a) = (size(0), size(1));
    let basis = DMatrix::from_fn(n_points, N_TERMS, |row, term| {
        let (i, j) = POWERS[term];
        (points[row][0] / size_t).powi(i) * (points[row][1] / size_a).powi(j)
    });
    let output = DVector::from_iterator(n_points, points.iter().map(|p| p[2]));
    let qr = basis.qr();
    let (q, r) = (qr.q(), qr.r());
    let diagonal = r.diagonal().abs();
    if diagonal.min() <= 1e-12 * diagonal.max() {
        return Err(FitError::Degenerate { n_points });
    }
    let projection = q.transpose() * &output;
    let scaled = r.solve_upper_triangular(&projection).ok_or(FitError::Degenerate { n_points })?;
    let cubic = Cubic(std::array::from_fn(|term| {
        let (i, j) = POWERS[term];
        scaled[term] / (size_t.powi(i) * size_a.powi(j))
    }));
    let residual = output - &q * projection;
    Ok(summarise(cubic, &q, &residual))
}

fn summarise(cubic: Cubic, q: &DMatrix<f64>, residual: &DVector<f64>) -> CubicFit {
    let n_points = residual.len();
    let root_mean_square = |sum: f64| (sum / n_points as f64).sqrt();
    // The residual of a point left out is its residual over one minus its leverage.
    let left_out: f64 = residual
        .iter()
        .zip(q.row_iter())
        .map(|(e, row)| (e / (1.0 - row.norm_squared())).powi(2))
        .sum();
    CubicFit {
        cubic,
        n_points,
        rmse: root_mean_square(residual.norm_squared()),
        max_error: residual.amax(),
        leave_one_out: root_mean_square(left_out),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::{derivatives, variable};
    use crate::surrogate::design::latin_hypercube;

    const KNOWN: Cubic =
        Cubic([20.3, 0.8, 1.1, 0.01, -8e-4, 0.016, 1.8e-4, 1.5e-6, -2e-4, -1.8e-5]);

    fn term_by_term(cubic: &Cubic, t: f64, a: f64) -> f64 {
        cubic.0.iter().zip(POWERS).map(|(c, (i, j))| c * t.powi(i) * a.powi(j)).sum()
    }

    fn sampled(noise: f64) -> Vec<[f64; 3]> {
        let design = latin_hypercube(60, &[(1.0, 30.0), (120.0, 270.0)], 5);
        let with_output = |(i, point): (usize, Vec<f64>)| {
            let [t, a] = [point[0], point[1]];
            [t, a, term_by_term(&KNOWN, t, a) + noise * (i as f64).sin()]
        };
        design.into_iter().enumerate().map(with_output).collect()
    }

    #[test]
    fn horner_form_and_derivatives_agree_with_the_terms() {
        let (t, a) = (7.3, 181.0);
        let value = KNOWN.eval(variable::<2>(t, 0), variable::<2>(a, 1));
        assert!((value.re - term_by_term(&KNOWN, t, a)).abs() < 1e-11);
        let step = 1e-4;
        let f = |t, a| term_by_term(&KNOWN, t, a);
        let dt = (f(t + step, a) - f(t - step, a)) / (2.0 * step);
        let da = (f(t, a + step) - f(t, a - step)) / (2.0 * step);
        let got = derivatives(&value);
        assert!((got[0] - dt).abs() < 1e-7 && (got[1] - da).abs() < 1e-7);
    }

    #[test]
    fn a_cubic_is_recovered_from_its_own_values() {
        let fit = fit(&sampled(0.0)).unwrap();
        for (got, known) in fit.cubic.0.iter().zip(KNOWN.0) {
            assert!((got - known).abs() < 1e-8 * known.abs(), "{got} {known}");
        }
        assert!(fit.max_error < 1e-10);
    }

    #[test]
    fn leave_one_out_equals_refitting_without_each_point() {
        let points = sampled(0.5);
        let mut sum = 0.0;
        for left_out in 0..points.len() {
            let mut rest = points.clone();
            let [t, a, y] = rest.remove(left_out);
            sum += (y - fit(&rest).unwrap().cubic.eval(t, a)).powi(2);
        }
        let direct = (sum / points.len() as f64).sqrt();
        let fit = fit(&points).unwrap();
        assert!((fit.leave_one_out - direct).abs() < 1e-8, "{} {direct}", fit.leave_one_out);
        assert!(fit.leave_one_out > fit.rmse);
    }

    #[test]
    fn too_few_or_dependent_points_are_refused() {
        assert_eq!(fit(&sampled(0.0)[..10]), Err(FitError::TooFewPoints { n_points: 10 }));
        let line: Vec<_> = (0..30).map(|i| [f64::from(i), 2.0 * f64::from(i), 1.0]).collect();
        assert_eq!(fit(&line), Err(FitError::Degenerate { n_points: 30 }));
    }
}
