//! The blocked sampler: for densities with many Gaussian coefficients that the likelihood sees
//! through few values.
//!
//! Two alternating moves, both exact for any stand-in ([`whiten`]): the whitened coefficients and the
//! free unknowns by NUTS given the hyperparameters; the hyperparameters by Metropolis given the
//! whitened coefficients. The funnel between the hyperparameters of a block and its coefficients is
//! gone, because the whitened coefficients hardly depend on them.
//!
//! In the warm-up the chains meet several times, and the stand-in and the hyperparameters' proposal
//! are fitted anew to the draws of all ([`meeting`]); while sampling, nothing changes.
//! Knows nothing of fields, kernels, meshes or models: only [`LatentGaussian`].

mod chain;
mod conditional;
mod factor;
mod groups;
mod latent;
mod meeting;
mod proposal;
mod stand_in;
mod together;
mod whiten;

pub use chain::Blocked;
pub(super) use proposal::Proposal;

pub use latent::{BlockLayout, Design, Group, Latent, LatentGaussian, Layout, Shape};

use super::draws::ChainResult;
use super::error::InferError;
use super::progress::Progress;
use super::run::run;
use super::settings::{Settings, check_starts, thread_pool};

/// Samples `density` with one blocked chain from each of `starts`, each `(dim)`.
///
/// The result is that of [`super::sample()`], with the draws in the density's own unknowns; steps,
/// energies and the metric are those of the whitened coordinates, a diagonal metric whatever
/// `settings.metric` says, and evaluations of the likelihood count as gradients.
///
/// # Errors
/// Those of [`super::sample()`].
pub fn sample_blocked(
    density: &dyn LatentGaussian,
    starts: &[Vec<f64>],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Vec<ChainResult>, InferError> {
    check_starts(density, starts, settings)?;
    thread_pool(settings)?
        .install(|| run(Blocked::together(density, starts, settings), settings, progress))
}
