//! A model's fields as the blocks of [`sample_blocked`]: which unknowns are in them, and their design.
//!
//! ```text
//! Σ_terms amplitude √S_k η_k = √s_k ζ_k      s_k = Σ_terms (amplitude √S_k)²
//! ```
//! So the terms of a field are one term, with ζ standard normal. If there are fewer sites than
//! modes, the sites see only n combinations w of them: θ = mean + L w with L Lᵀ = Φ diag(s) Φᵀ.
//!
//! Two further things are in a block:
//!
//! - a mean that nothing else mentions, if its prior is normal or flat, as location + scale w;
//! - deviations of places whose sd is learnt.
//!
//! For the integrated sampler so are parameters and effects in which all measurements are linear.
//!
//! All other unknowns are outer. What the sites do not see is drawn from its exact conditional
//! ([`restore`](super::restore)).

mod blocks;
mod free;
mod left_out;
mod on_tape;
mod places;

use std::collections::BTreeMap;

use blocks::Blocks;
pub(super) use free::priors_of;
pub use left_out::Predictive;

use crate::infer::{
    self, Blocked, ChainResult, InferError, LatentGaussian as _, LogDensity, Nuts, Progress,
    Settings, climbs, climbs_on, sample_blocked, sample_integrated, starts_at,
};
use crate::model::laid_out::{FieldEntry, Model};

/// The blocked sampler is not the default if the blocks of fields that share rows have more numbers
/// than this.
const MOST: usize = 400;

/// Most unknowns that the integrated sampler's proposals can follow.
const MOST_OUTER: usize = 12;

/// Most parameters that it integrates out beside fields.
const MOST_FREE: usize = 400;

/// Numbers of a field's block: one per site or one per mode, whichever are fewer.
fn size(field: &FieldEntry) -> usize {
    field.op.k.min(field.op.n_probes())
}

/// How many numbers the fields of each group have. The fields of a group share rows.
fn sizes(model: &Model) -> BTreeMap<usize, usize> {
    let mut sizes = BTreeMap::new();
    for field in &model.fields {
        *sizes.entry(field.group).or_insert(0) += size(field);
    }
    for (spread, size) in model.spreads.iter().zip(sizes.values_mut()) {
        *size += spread.vertices.len();
    }
    sizes
}

/// The sampler of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampler {
    /// Fields integrated out in closed form, where all measurements are normal about them; the rest by Metropolis.
    Integrated,
    /// Fields whitened in a block, their hyperparameters by Metropolis, the rest by NUTS.
    Blocked,
    /// NUTS on all unknowns.
    Nuts,
}

impl Sampler {
    /// The integrated sampler where it can be used. Else the blocked one where that can, unless the fields that share
    /// rows have so many numbers that their Cholesky factors cost more than they save; else NUTS.
    pub fn of(model: &Model) -> Self {
        if Self::Integrated.takes(model) { Self::Integrated } else { Self::up_to(model, MOST) }
    }

    fn up_to(model: &Model, most: usize) -> Self {
        let is_small = sizes(model).values().all(|size| *size <= most);
        if is_small && Self::Blocked.takes(model) { Self::Blocked } else { Self::Nuts }
    }

    /// Whether it can sample the model: the blocked sampler needs a field, and measurements that see
    /// every field at the places of their rows alone; the integrated one in addition that every measurement is normal about a sum of fields, parameters
    /// and effects; NUTS samples all models.
    pub fn takes(self, model: &Model) -> bool {
        let is_local = model.over.is_empty();
        let is_seen = || is_local && model.has_fields() && model.fields.iter().all(|f| size(f) > 0);
        match self {
            Self::Nuts => true,
            Self::Blocked => is_seen(),
            Self::Integrated => is_seen() && is_normal(model),
        }
    }

    /// Its name for tables and records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Integrated => "integrated",
            Self::Blocked => "blocked",
            Self::Nuts => "nuts",
        }
    }

    /// The mean acceptance that the step size is tuned to: what is asked for, else what suits the model. `None`
    /// where there is no step size.
    pub fn target_accept(self, model: &Model, settings: &Settings) -> Option<f64> {
        let suits = match self {
            Self::Integrated => return None,
            Self::Blocked => Blocked::TARGET_ACCEPT,
            Self::Nuts if model.has_fields() && model.over.is_empty() => WITH_FIELDS,
            Self::Nuts => Nuts::TARGET_ACCEPT,
        };
        settings.target_accept.or(Some(suits))
    }

    /// After how many draws of each chain it is worth to ask whether there are enough: where an operator over the surface
    /// makes a draw cost tenths of a second.
    pub fn enough_after(self, model: &Model) -> Option<usize> {
        (self == Self::Nuts && !model.over.is_empty()).then_some(50)
    }

    /// Where climbs end, the best first, with which the search for starting points begins.
    ///
    /// # Errors
    /// Those of [`jittered_starts`](crate::infer::jittered_starts).
    pub fn climbs(self, model: &Model, settings: &Settings) -> Result<Vec<Vec<f64>>, InferError> {
        let (initial, chains, seed) = (model.climbs_from(), settings.chains, settings.seed);
        self.search(model, settings, |density| climbs(density, &initial, chains, seed))
    }

    /// Where these climbs end if they go on, of a model that has changed since.
    ///
    /// # Errors
    /// Those of [`jittered_starts`](crate::infer::jittered_starts).
    pub fn climbs_on(
        self,
        model: &Model,
        ends: &[Vec<f64>],
        settings: &Settings,
    ) -> Result<Vec<Vec<f64>>, InferError> {
        self.search(model, settings, |density| climbs_on(density, ends, settings.seed))
    }

    /// Where chains start, if climbs ended there: see [`jittered_starts`](crate::infer::jittered_starts).
    ///
    /// # Errors
    /// Those of [`jittered_starts`](crate::infer::jittered_starts).
    pub fn starts_at(
        self,
        model: &Model,
        ends: &[Vec<f64>],
        settings: &Settings,
    ) -> Result<Vec<Vec<f64>>, InferError> {
        let (chains, seed) = (settings.chains, settings.seed);
        self.search(model, settings, |density| starts_at(density, ends, chains, seed))
    }

    fn search(
        self,
        model: &Model,
        settings: &Settings,
        search: impl Fn(&dyn LogDensity) -> Result<Vec<Vec<f64>>, InferError> + Sync,
    ) -> Result<Vec<Vec<f64>>, InferError> {
        let without_shifts = self.without_shifts(model);
        let density = without_shifts.as_deref().unwrap_or(model);
        settings.on_threads(|| search(density))?
    }

    fn without_shifts(self, model: &Model) -> Option<Box<dyn LogDensity + '_>> {
        model.without_shifts().filter(|_| self == Self::Nuts)
    }

    /// Samples `model`; the draws are its own unknowns whichever sampler it is.
    ///
    /// # Errors
    /// Those of [`infer::sample`].
    pub fn sample(
        self,
        model: &Model,
        starts: &[Vec<f64>],
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Result<Vec<ChainResult>, InferError> {
        match self {
            Self::Integrated => {
                let free = free_priors(model).unwrap_or_default();
                let blocks = Blocks::integrated(model, &free);
                sample_integrated(&blocks, starts, settings, progress)
            }
            Self::Blocked => sample_blocked(&Blocks::new(model), starts, settings, progress),
            Self::Nuts => {
                let target_accept = self.target_accept(model, settings);
                let settings = Settings { target_accept, ..settings.clone() };
                match self.without_shifts(model) {
                    Some(density) => infer::sample(&*density, starts, &settings, progress),
                    None => infer::sample(model, starts, &settings, progress),
                }
            }
        }
    }
}

/// Mean acceptance to which NUTS tunes its step size on a model with fields. Longer steps seldom enter the tails
/// of their amplitudes and lengthscales.
const WITH_FIELDS: f64 = 0.95;

/// Whether every measurement is normal about a linear function of fields, with an sd that these do not change, and few
/// unknowns are left without what integrates out.
fn is_normal(model: &Model) -> bool {
    free_priors(model).is_some_and(|free| {
        let blocks = Blocks::integrated(model, &free);
        (1..=MOST_OUTER).contains(&blocks.layout().outer.len())
    })
}

/// Of a model with such measurements, the priors of parameters and effects that integrate out with the fields. With
/// several groups of fields there are none.
fn free_priors(model: &Model) -> Option<Vec<usize>> {
    let tree = model.syntax().ok()?;
    let names: Vec<String> = tree.normal_about()?.iter().map(ToString::to_string).collect();
    let priors = priors_of(model, &names);
    let n: usize = priors.iter().map(|prior| model.prior_entries[*prior].len).sum();
    let is_one_group = sizes(model).len() == 1;
    Some(if is_one_group && n <= MOST_FREE { priors } else { vec![] })
}

#[cfg(test)]
mod models_of_tests;
#[cfg(test)]
mod on_tape_tests;
#[cfg(test)]
mod tests;
