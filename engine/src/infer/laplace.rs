//! A normal approximation of a log density at its mode, and draws from it.
//!
//! ```text
//! q = Normal(mode, P⁻¹),   P = −∇∇ ln p(mode) = L Lᵀ,   draw = mode + L⁻ᵀ z
//! ```
//! # Source
//! Tierney & Kadane 1986, "Accurate approximations for posterior moments and marginal densities".

use super::density::{Evaluator, LogDensity};
use super::draws::Chain;
use super::error::InferError;
use super::optimise::Optimum;
use super::settings::Settings;
use crate::random::Stream;
use crate::store::Spool;
use nalgebra::linalg::{Cholesky, SymmetricEigen};
use nalgebra::{DMatrix, DVector, Dyn};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::io;
use std::time::Instant;

/// The normal approximation at a mode, in unconstrained coordinates.
#[derive(Debug)]
pub struct Laplace {
    mode: DVector<f64>,
    /// The factor L of the precision P.
    factor: Cholesky<f64, Dyn>,
}

/// Independent draws from a [`Laplace`] approximation.
#[derive(Debug)]
pub struct LaplaceDraws {
    /// The draws, with the log density of the model, as if a sampler had made them.
    pub chain: Chain,
    /// `ln p − ln q` of each draw: the log of its importance ratio; −∞ out of support.
    pub log_ratios: Vec<f64>,
}

impl Laplace {
    /// Fits the curvature of `density` at `optimum`: its Hessian there ([`Evaluator::hessian`]).
    ///
    /// # Errors
    /// [`InferError::NoMode`] if the climb did not converge; [`InferError::NotConcave`] if the density
    /// does not fall off in every direction.
    pub fn at(density: &dyn LogDensity, optimum: &Optimum) -> Result<Self, InferError> {
        if !optimum.converged {
            let (iterations, gradient_norm) = (optimum.iterations, optimum.gradient_norm);
            return Err(InferError::NoMode { iterations, gradient_norm });
        }
        let precision = precision(&mut *density.evaluator(), &optimum.position);
        let Some(factor) = Cholesky::new(precision.clone()) else {
            return Err(not_concave(&precision));
        };
        Ok(Self { mode: DVector::from_column_slice(&optimum.position), factor })
    }

    /// As many chains and draws as the settings say, from the chains' own random streams.
    ///
    /// # Errors
    /// [`InferError::Threads`], [`InferError::Disk`].
    pub fn draws(
        &self,
        density: &dyn LogDensity,
        settings: &Settings,
    ) -> Result<Vec<LaplaceDraws>, InferError> {
        let draw = |chain| {
            let mut rng = Stream::Chain(chain).rng(settings.seed);
            self.chain(&mut *density.evaluator(), settings, &mut rng)
        };
        let chains = 0..settings.chains;
        let drawn = || chains.into_par_iter().map(draw).collect::<io::Result<_>>();
        settings.on_threads(drawn)?.map_err(|source| settings.disk_error(source))
    }

    fn chain(
        &self,
        evaluator: &mut dyn Evaluator,
        settings: &Settings,
        rng: &mut ChaCha8Rng,
    ) -> io::Result<LaplaceDraws> {
        let begun = Instant::now();
        let (n, dim) = (settings.draws, self.mode.len());
        let ln_norm = self.factor.ln_determinant() / 2.0 - dim as f64 * TAU.ln() / 2.0;
        let mut gradient = vec![0.0; dim];
        let mut draws = Spool::new(dim, n, settings.disk.as_deref());
        let [mut ln_densities, mut log_ratios] = [(); 2].map(|()| Vec::with_capacity(n));
        for _ in 0..n {
            let z = DVector::from_fn(dim, |_, _| rng.sample::<f64, _>(StandardNormal));
            let ln_normal = ln_norm - z.norm_squared() / 2.0;
            let mut position = z;
            // L has a positive diagonal, so the triangular system always has a solution.
            let _ = self.factor.l_dirty().tr_solve_lower_triangular_mut(&mut position);
            position += &self.mode;
            let ln_density = evaluator.ln_density(position.as_slice(), &mut gradient);
            draws.push(position.as_slice())?;
            ln_densities.push(ln_density);
            log_ratios.push(ln_density - ln_normal);
        }
        let mut chain = Chain::of_independent_draws(draws, ln_densities);
        chain.seconds_sampling = begun.elapsed().as_secs_f64();
        Ok(LaplaceDraws { chain, log_ratios })
    }
}

impl LaplaceDraws {
    /// As many draws again, chosen from `drawn` by systematic resampling. `weights` are those of
    /// all draws of `drawn` and sum to 1. A draw of weight w occurs S w times, rounded up or down.
    ///
    /// Copies of a draw follow each other, so that effective sample sizes count them once. Apart
    /// from that the draws are in random order; this makes a fixed offset as good as a random one.
    /// The new draws go where those of the `settings` go.
    ///
    /// # Errors
    /// [`InferError::Disk`].
    pub fn resample(
        drawn: &[Self],
        weights: &[f64],
        settings: &Settings,
    ) -> Result<Vec<Chain>, InferError> {
        Self::resampled(drawn, weights, settings).map_err(|source| settings.disk_error(source))
    }

    fn resampled(drawn: &[Self], weights: &[f64], settings: &Settings) -> io::Result<Vec<Chain>> {
        let (n, length) = (weights.len(), weights.len() / drawn.len().max(1));
        let room = |of: &Self| {
            let draws = Spool::new(of.chain.draws.width(), length, settings.disk.as_deref());
            (draws, Vec::with_capacity(length))
        };
        let mut chains: Vec<(Spool, Vec<f64>)> = drawn.iter().map(room).collect();
        let (mut weights, mut sum, mut n_picked) = (weights.iter(), 0.0, 0);
        for Self { chain, .. } in drawn {
            chain.draws.each(1, |i, draw| {
                sum += weights.next().unwrap_or(&0.0) * n as f64;
                while n_picked < (f64::round(sum) as usize).min(n) {
                    let (draws, ln_density) = &mut chains[n_picked / length];
                    draws.push(draw)?;
                    ln_density.push(chain.ln_density[i]);
                    n_picked += 1;
                }
                io::Result::Ok(())
            })?;
        }
        let filled = |((draws, ln_density), of): ((Spool, Vec<f64>), &Self)| Chain {
            seconds_sampling: of.chain.seconds_sampling,
            ..Chain::of_independent_draws(draws, ln_density)
        };
        Ok(chains.into_iter().zip(drawn).map(filled).collect())
    }
}

/// P, made symmetric.
fn precision(evaluator: &mut dyn Evaluator, mode: &[f64]) -> DMatrix<f64> {
    let mut columns = DMatrix::zeros(mode.len(), mode.len());
    evaluator.hessian(mode, &mut |j, column| {
        columns.column_mut(j).copy_from_slice(column);
    });
    (&columns + columns.transpose()) / -2.0
}

/// Names the unknown that moves most along the direction in which the density falls off least.
fn not_concave(precision: &DMatrix<f64>) -> InferError {
    if let Some(at) = precision.iter().position(|p| !p.is_finite()) {
        return InferError::NotConcave { unknown: at / precision.nrows(), curvature: f64::NAN };
    }
    let eigen = SymmetricEigen::new(precision.clone());
    let least = eigen.eigenvalues.imin();
    let unknown = eigen.eigenvectors.column(least).iamax();
    InferError::NotConcave { unknown, curvature: -eigen.eigenvalues[least] }
}

#[cfg(test)]
mod tests {
    use super::super::optimise::{OptimumSettings, maximise};
    use super::super::test_densities::{FnDensity, funnel};
    use super::*;

    /// A correlated normal with precision A, up to the constant `ln_scale`.
    fn correlated(ln_scale: f64) -> (DMatrix<f64>, DVector<f64>, impl LogDensity) {
        let a = DMatrix::from_row_slice(3, 3, &[400.0, 6.0, 0.0, 6.0, 1.0, 0.02, 0.0, 0.02, 1e-2]);
        let centre = DVector::from_column_slice(&[0.1, -3.0, 200.0]);
        let (by, about) = (a.clone(), centre.clone());
        let f = move |q: &[f64], g: &mut [f64]| {
            let away = DVector::from_column_slice(q) - &about;
            let slope = &by * &away;
            g.copy_from_slice((-&slope).as_slice());
            ln_scale - 0.5 * away.dot(&slope)
        };
        (a, centre, FnDensity { dim: 3, f })
    }

    fn fitted(density: &dyn LogDensity, start: &[f64]) -> Result<Laplace, InferError> {
        Laplace::at(density, &maximise(density, start, &OptimumSettings::default()).unwrap())
    }

    #[test]
    fn a_normal_is_its_own_approximation() {
        let (a, centre, density) = correlated(-7.0);
        let laplace = fitted(&density, &[0.0; 3]).unwrap();
        let l = laplace.factor.l();
        assert!((&l * l.transpose() - &a).abs().max() < 1e-5, "{l}");
        let settings = Settings { chains: 2, draws: 2000, ..Settings::default() };
        let drawn = laplace.draws(&density, &settings).unwrap();
        // The ratio is the normaliser of the density, at every draw: e^−7 √((2π)³ / |A|).
        let exact = -7.0 + 1.5 * TAU.ln() - 0.5 * a.determinant().ln();
        let ratios = || drawn.iter().flat_map(|d| &d.log_ratios);
        assert!(ratios().all(|r| (r - exact).abs() < 1e-3), "{exact} {:?}", ratios().next());
        // Moments of the 4000 independent draws within 4.5 standard errors.
        let covariance = a.try_inverse().unwrap();
        for i in 0..3 {
            let of = |d: &LaplaceDraws| -> Vec<f64> {
                (0..d.chain.n_draws()).map(|k| d.chain.draw(k).unwrap()[i] - centre[i]).collect()
            };
            let x: Vec<f64> = drawn.iter().flat_map(of).collect();
            let (n, variance) = (x.len() as f64, covariance[(i, i)]);
            let mean = x.iter().sum::<f64>() / n;
            let squares = x.iter().map(|x| x * x).sum::<f64>() / n;
            assert!(mean.abs() < 4.5 * (variance / n).sqrt(), "{i}: {mean}");
            assert!((squares / variance - 1.0).abs() < 4.5 * (2.0 / n).sqrt(), "{i}: {squares}");
        }
    }

    #[test]
    fn draws_are_resampled_by_weight_and_followed_by_their_copies() {
        let (_, _, density) = correlated(0.0);
        let settings = Settings { chains: 2, draws: 4, ..Settings::default() };
        let drawn = fitted(&density, &[0.0; 3]).unwrap().draws(&density, &settings).unwrap();
        let all: Vec<f64> = drawn.iter().flat_map(|d| d.chain.ln_density.clone()).collect();
        let weights = [0.0, 0.25, 0.05, 0.45, 0.0, 0.125, 0.0, 0.125];
        let resample =
            |weights: &[f64]| LaplaceDraws::resample(&drawn, weights, &settings).unwrap();
        let resampled = resample(&weights);
        let found: Vec<f64> = resampled.iter().flat_map(|c| c.ln_density.clone()).collect();
        assert_eq!(found, [1, 1, 3, 3, 3, 3, 5, 7].map(|i: usize| all[i]));
        assert_eq!(resampled[1].draw(0).unwrap(), drawn[0].chain.draw(3).unwrap());
        let same = resample(&[0.125; 8]);
        for i in 0..4 {
            assert_eq!(same[1].draw(i).unwrap(), drawn[1].chain.draw(i).unwrap());
        }
    }

    #[test]
    fn draws_do_not_depend_on_the_number_of_threads() {
        let (_, _, density) = correlated(0.0);
        let laplace = fitted(&density, &[0.0; 3]).unwrap();
        let [one, two] = [1, 2].map(|threads| {
            let settings = Settings { threads, draws: 50, ..Settings::default() };
            format!("{:?}", laplace.draws(&density, &settings).unwrap()[3].chain.draws)
        });
        assert_eq!(one, two);
    }

    #[test]
    fn without_a_mode_or_downward_curvature_there_is_no_approximation() {
        let error = fitted(&funnel(20), &[0.5; 20]).unwrap_err();
        assert!(matches!(error, InferError::NoMode { .. }), "{error}");
        // A saddle: its origin has no slope, but is a minimum along q₁.
        let saddle = FnDensity {
            dim: 2,
            f: |q: &[f64], g: &mut [f64]| {
                (g[0], g[1]) = (-q[0], q[1]);
                0.5 * (q[1] * q[1] - q[0] * q[0])
            },
        };
        insta::assert_snapshot!(fitted(&saddle, &[0.0; 2]).unwrap_err(), @r"
        no normal approximation at the mode: the log density does not fall off along unknown 1 (curvature 1.00e0, expected below 0)
        help: sample instead, or use a tighter prior on it
        ");
    }
}
