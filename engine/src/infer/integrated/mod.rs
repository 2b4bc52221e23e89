//! The integrated sampler: for densities whose likelihood is Gaussian in the latent values.
//!
//! There the coefficients of all blocks integrate out in closed form ([`marginal`]). What is left is a
//! density of the few outer unknowns, which a Metropolis chain samples with proposals shaped by the
//! warm-up; the coefficients of each draw come from their exact conditional. However many measurements
//! there are, products of modes over the places are made once, and an evaluation costs one Cholesky
//! factor of the coefficients.

mod chain;
mod marginal;
mod products;

pub use chain::Integrated;

use super::blocked::LatentGaussian;
use super::draws::ChainResult;
use super::error::InferError;
use super::progress::Progress;
use super::run::run;
use super::settings::{Settings, check_starts};

/// Samples `density` with one integrated chain from each of `starts`, each `(dim)`.
///
/// Every block must have the shape [`Shape::Scaled`](super::Shape::Scaled), and the log likelihood must be quadratic in
/// the latent values; of any other density this samples something else.
///
/// The result is that of [`super::sample()`]. There are no trajectories: the acceptance is that of the Metropolis steps
/// before a draw, and evaluations of the likelihood count as gradients.
///
/// # Errors
/// Those of [`super::sample()`].
pub fn sample_integrated(
    density: &dyn LatentGaussian,
    starts: &[Vec<f64>],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Vec<ChainResult>, InferError> {
    check_starts(density, starts, settings)?;
    settings
        .on_threads(|| run(Integrated::together(density, starts, settings), settings, progress))?
}
