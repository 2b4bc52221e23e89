//! For tests: measurements of the sum of two fields, of which all that is estimated is known.

use super::stand_in::{Sample, StandIn, Trust};
use super::{BlockLayout, Design, Group, Latent, Layout, Shape};
use nalgebra::{Cholesky, DMatrix, DVector};
use rand::{Rng, RngExt as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

pub(super) const PLACES: usize = 4;
pub(super) const LATENT: usize = 2 * PLACES;
/// Measurements of the sum of two fields, and their error.
const Y: [f64; PLACES] = [1.6, 0.2, -0.7, 1.1];
pub(super) const SD: f64 = 0.4;
/// Each is the sum of two rows, which have these shares of the log likelihood.
pub(super) const SHARES: [f64; 2] = [0.75, 0.25];
/// Two-sided 0.001 % of a normal number.
pub(super) const LARGEST_Z: f64 = 4.4;

/// Two fields at a few places on a line: sd and lengthscale of each.
const FIELDS: [[f64; 2]; 2] = [[1.0, 2.0], [0.7, 0.8]];

/// L of a field's covariance L Lᵀ. Of the first field only so many columns are left: its values at the places
/// before determine the others.
pub(super) fn factor(field: usize, rank: usize) -> DMatrix<f64> {
    let [sd, rho] = FIELDS[field];
    let covariance = DMatrix::from_fn(PLACES, PLACES, |i, j| {
        sd * sd * (-0.5 * ((i as f64 - j as f64) / rho).powi(2)).exp()
    });
    let mut factor = Cholesky::new(covariance).unwrap().l();
    if field == 0 {
        factor.columns_mut(rank, PLACES - rank).fill(0.0);
    }
    factor
}

fn covariance(field: usize, rank: usize) -> DMatrix<f64> {
    let factor = factor(field, rank);
    &factor * factor.transpose()
}

pub(super) fn layout() -> Layout {
    let block =
        || BlockLayout { n_coefficients: PLACES, mean_precision: None, shape: Shape::Triangular };
    let group = Group { n_seen: PLACES, blocks: vec![block(), block()] };
    Layout { groups: vec![group], free_precision: vec![], outer: vec![], hyper: vec![] }
}

/// Outer unknowns, if there are any, are standard normal; ln L = −½ Σ ((θ₁ + θ₂ − y)/sd)²
pub(super) struct Sums {
    pub(super) rank: usize,
}

impl Latent for Sums {
    fn set_outer(&mut self, outer: &[f64], designs: &mut [Design]) -> f64 {
        for design in designs {
            for (field, rows) in design.rows.iter_mut().enumerate() {
                rows.copy_from_slice(factor(field, self.rank).transpose().as_slice());
            }
        }
        -0.5 * outer.iter().map(|x| x * x).sum::<f64>()
    }
    fn ln_likelihoods(&mut self, [_, place]: [usize; 2], theta: &[f64], out: &mut [f64]) {
        for (out, theta) in out.iter_mut().zip(theta.chunks_exact(2)) {
            *out = -0.5 * ((theta[0] + theta[1] - Y[place]) / SD).powi(2);
        }
    }
    fn ln_of_rows(&mut self, at: [usize; 2], theta: &[f64]) -> Vec<Vec<f64>> {
        let mut both = vec![0.0; theta.len() / 2];
        self.ln_likelihoods(at, theta, &mut both);
        SHARES.map(|share| both.iter().map(|ln| share * ln).collect()).to_vec()
    }
    fn slope(&mut self, theta: &[f64], theta_bar: &mut [f64]) -> f64 {
        for (theta, theta_bar) in theta.chunks_exact(LATENT).zip(theta_bar.chunks_exact_mut(LATENT))
        {
            for place in 0..PLACES {
                let slope = (Y[place] - theta[place] - theta[PLACES + place]) / SD.powi(2);
                theta_bar[place] = slope;
                theta_bar[PLACES + place] = slope;
            }
        }
        f64::NAN
    }
    fn coefficients(&mut self, position: &[f64], coefficients: &mut [f64]) {
        coefficients.copy_from_slice(&position[..coefficients.len()]);
    }
    fn join(&mut self, _: &[f64], _: &[f64], _: &mut dyn Rng, _: &mut [f64]) -> f64 {
        unreachable!("not asked for")
    }
    fn ln_likelihood(&mut self, _: &[f64]) -> f64 {
        unreachable!("not asked for")
    }
    fn slopes(&mut self, _: &[f64], _: &[f64], _: &mut [f64], _: &mut [f64]) -> f64 {
        unreachable!("not asked for")
    }
}

/// The exact posterior.
pub(super) struct Exact {
    /// ln ∫ p(θ) L dθ
    pub(super) ln_evidence: f64,
    /// `(block, place)`
    pub(super) mean: DVector<f64>,
    /// A with covariance A Aᵀ.
    pub(super) factor: DMatrix<f64>,
}

pub(super) fn exact(rank: usize) -> Exact {
    exact_with(rank, [SD; PLACES])
}

/// Where the measurements have these errors.
pub(super) fn exact_with(rank: usize, sd: [f64; PLACES]) -> Exact {
    let y = DVector::from_row_slice(&Y);
    let noise = DMatrix::from_diagonal(&DVector::from_row_slice(&sd.map(|sd| sd * sd)));
    let sum = Cholesky::new(covariance(0, rank) + covariance(1, rank) + noise).unwrap();
    let ln_ratio: f64 = sum.l().diagonal().iter().zip(sd).map(|(l, sd)| (sd / l).ln()).sum();
    let mut prior = DMatrix::zeros(LATENT, LATENT);
    let mut seen = DMatrix::zeros(PLACES, LATENT);
    for field in 0..2 {
        prior
            .view_mut((field * PLACES, field * PLACES), (PLACES, PLACES))
            .copy_from(&covariance(field, rank));
        seen.view_mut((0, field * PLACES), (PLACES, PLACES)).fill_with_identity();
    }
    let gain = &prior * seen.transpose() * sum.inverse();
    let mut eigen = (&prior - &gain * &seen * &prior).symmetric_eigen();
    eigen.eigenvalues.apply(|x| *x = x.max(0.0).sqrt());
    Exact {
        ln_evidence: ln_ratio - 0.5 * y.dot(&sum.solve(&y)),
        mean: gain * y,
        factor: eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues),
    }
}

/// A stand-in that is not the likelihood's own: half of its information.
pub(super) fn lookahead(layout: &Layout, rng: &mut ChaCha8Rng) -> StandIn {
    let sample = |_| {
        let theta: Vec<f64> = (0..LATENT).map(|_| rng.sample(StandardNormal)).collect();
        let mut slope = vec![0.0; LATENT];
        Sums { rank: PLACES }.slope(&theta, &mut slope);
        Sample { theta, slope }
    };
    let samples: Vec<Sample> = (0..100).map(sample).collect();
    let mut stand_in = StandIn::new(layout);
    stand_in.fit(&samples, Trust { least: 0.1, reach: f64::INFINITY }, layout);
    stand_in.times(0.5)
}

/// Z with a mean of one, if the values are what they should be.
pub(super) fn z(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean - 1.0) / (variance / n).sqrt()
}
