//! The blocked sampler: for densities with many Gaussian coefficients that the likelihood sees
//! through few values.
//!
//! Two alternating moves, both exact for any stand-in ([`whiten`]): the whitened coefficients and the free
//! unknowns by NUTS given the hyperparameters; the hyperparameters by Metropolis given the whitened
//! coefficients. The funnel between the hyperparameters of a block and its coefficients is gone,
//! because the whitened coefficients hardly depend on them.
//!
//! Warm-up has stages. At the end of each but the last, the stand-in and the hyperparameters'
//! proposal are fitted anew to the draws of all chains; while sampling, nothing changes.
//! Knows nothing of fields, kernels, meshes or models: only [`LatentGaussian`].

mod chain;
mod conditional;
mod factor;
mod latent;
mod proposal;
mod stand_in;
mod warmup;
mod whiten;

pub use latent::{BlockLayout, Design, Latent, LatentGaussian, Layout, Shape};

use super::sample::{check_starts, thread_pool};
use super::{ChainResult, InferError, Progress, Settings};
use crate::store::Checkpoint;
use crate::store::take_chains;
use chain::Run;
use warmup::{Shared, for_each_chain, warm_up};

/// Samples `density` with one blocked chain from each of `starts`, each `(dim)`.
///
/// The result is that of [`super::sample`], with the draws in the density's own unknowns; steps,
/// energies and the metric are those of the whitened coordinates, a diagonal metric whatever
/// `settings.metric` says, and evaluations of the likelihood count as gradients.
///
/// # Errors
/// Those of [`super::sample`].
pub fn sample_blocked(
    density: &dyn LatentGaussian,
    starts: &[Vec<f64>],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Vec<ChainResult>, InferError> {
    check_starts(density, starts, settings)?;
    let checkpoint = progress.checkpoint();
    let mut kept = take_chains(checkpoint, starts.len())?;
    let shared = checkpoint.map_or(Ok(None), Checkpoint::take_common)?;
    Ok(thread_pool(settings)?.install(|| {
        let shared = shared.unwrap_or_else(|| Shared::new(density, starts, settings));
        let shared = warm_up(density, shared, &mut kept, settings, progress);
        let common = shared.common(density, settings, progress);
        for_each_chain(common, &shared.links, &mut kept, |chain, link, kept| {
            let (state, draws) =
                kept.map_or_else(Default::default, |(_, state, _, draws)| (Some(state), draws));
            Run::new(common, chain, link, state)?.draw(link, draws)
        })
    }))
}
