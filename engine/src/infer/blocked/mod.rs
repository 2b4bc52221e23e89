//! The blocked sampler: for densities with many Gaussian coefficients that the likelihood sees
//! through few values.
//!
//! Moves alternate. All are exact whatever the stand-in ([`whiten`]) is:
//!
//! - Given the hyperparameters, a trajectory moves the whitened coefficients and the free unknowns.
//!   It is one of NUTS, or, where there are no free unknowns, one of random length, accepted or rejected.
//! - Given the whitened coefficients, Metropolis steps move the hyperparameters.
//!
//! Where the likelihood sees few latent values, a third move proposes other hyperparameters and, with them,
//! all coefficients anew ([`particles`]). It goes from one regime of the posterior to another in a step.
//!
//! Where the values of a region have two regimes of their own, a fourth goes from one to the other ([`swaps`]).
//!
//! Without whitening, the hyperparameters of a block and its coefficients would form a funnel. The
//! whitened coefficients hardly depend on the hyperparameters, so there is none.
//!
//! In the warm-up the chains meet several times. At each meeting the stand-in and the proposal of
//! the hyperparameters are fitted to the draws of all chains ([`meeting`]). While sampling, nothing
//! changes.
//!
//! Knows nothing of fields, kernels, meshes or models: only [`LatentGaussian`].

mod anchors;
mod chain;
mod conditional;
mod explore;
mod factor;
mod forks;
mod groups;
mod last;
mod latent;
#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod leap_tests;
mod left_out;
#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod left_out_tests;
mod meeting;
mod mixture;
mod order;
mod particles;
mod planes;
mod proposal;
mod scouts;
mod stand_in;
#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod swap_tests;
mod swaps;
#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod test_sums;
mod together;
mod told;
mod whiten;

pub use chain::Blocked;
pub(super) use proposal::Proposal;

pub use latent::{BlockLayout, Design, Group, Latent, LatentGaussian, Layout, Shape};
pub use left_out::{WithoutRows, without_rows};
pub use told::RowWithout;

use super::draws::ChainResult;
use super::error::InferError;
use super::progress::Progress;
use super::run::run;
use super::settings::{Settings, check_starts};

/// Samples `density` with one blocked chain from each of `starts`, each `(dim)`.
///
/// The result has the form of that of [`super::sample()`], and its draws are of the density's own
/// unknowns. Step sizes, energies and the metric are those of the whitened coordinates. The metric
/// is diagonal whatever `settings.metric` says. Evaluations of the likelihood count as gradients.
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
    settings.on_threads(|| run(Blocked::together(density, starts, settings), settings, progress))?
}
