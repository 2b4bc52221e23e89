//! Draws of a model's unknowns from its priors, in chains like those of a sampler.

use std::time::Instant;

use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::error::ModelError;
use super::laid_out::Model;
use super::reported::{Kind, Parameter};
use super::tape::Tape;
use crate::infer::{Chain, LogDensity as _, Settings};
use crate::random::Stream;
use crate::store::Spool;

impl Model {
    /// Independent draws from the prior, as many as the settings say, in memory or on the settings' disk.
    /// Nothing else in the settings but the seed is used. The measurements are left aside.
    ///
    /// # Errors
    /// [`ModelError::NoPriorDraw`], [`ModelError::DensityInPrior`], [`ModelError::Disk`].
    pub fn prior_draws(&self, settings: &Settings) -> Result<Vec<Chain>, ModelError> {
        if let Some(density) = self.densities.iter().find(|d| !d.reads_data) {
            return Err(ModelError::DensityInPrior { name: density.name });
        }
        (0..settings.chains).map(|chain| self.prior_chain(settings, chain)).collect()
    }

    fn prior_chain(&self, settings: &Settings, chain: usize) -> Result<Chain, ModelError> {
        let mut rng = Stream::Prior(chain).rng(settings.seed);
        let (n, mut tape, begun) = (settings.draws, self.tape(), Instant::now());
        let mut gradient = vec![0.0; tape.u.len()];
        let mut draws = Spool::new(self.dim(), n, settings.disk.as_deref());
        let mut ln_densities = Vec::with_capacity(n);
        for _ in 0..n {
            self.draw_prior(&mut tape, &mut rng)?;
            let position = tape.u.clone();
            let ln_density = self.ln_density(&mut tape, &position, &mut gradient);
            draws.push(&position).map_err(|source| {
                let folder = settings.disk.clone().unwrap_or_default();
                ModelError::Disk { folder, source }
            })?;
            ln_densities.push(ln_density);
        }
        let mut out = Chain::of_independent_draws(draws, ln_densities);
        out.seconds_sampling = begun.elapsed().as_secs_f64();
        Ok(out)
    }

    /// Draws of the unknowns as they may be before anything is measured. They serve for a look at
    /// what the model expects. They are those of [`Model::prior_draws`], but a field's mean with a
    /// flat prior stands in the middle of the field's range. `None` if some other prior cannot be
    /// drawn from.
    pub fn plausible(&self, n: usize, rng: &mut ChaCha8Rng) -> Option<Vec<Vec<f64>>> {
        let mut tape = self.tape();
        let mut draw = || {
            for (prior, entry) in self.priors.iter().zip(&self.prior_entries) {
                if prior.draw(&mut tape, rng).is_some() {
                    continue;
                }
                let (u, middle) = self.start.iter().find(|(u, _)| entry.u.contains(u))?;
                tape.u[*u] = *middle;
                prior.forward(&mut tape);
            }
            self.draw_coefficients(&mut tape, rng);
            Some(tape.u.clone())
        };
        (0..n).map(|_| draw()).collect()
    }

    /// Draws the unknowns `u[i]` that are not `known` from their priors given the others, for
    /// instance the coefficients of labels that were not fitted. If a prior cannot be drawn from,
    /// its unknowns stay as they are.
    pub fn draw_unknown(&self, tape: &mut Tape, u: &mut [f64], known: &[bool], rng: &mut dyn Rng) {
        tape.u.copy_from_slice(u);
        for (prior, entry) in self.priors.iter().zip(&self.prior_entries) {
            if known[entry.u.clone()].iter().all(|known| *known) {
                prior.forward(tape);
            } else if prior.draw(tape, rng).is_some() {
                for i in entry.u.clone().filter(|i| !known[*i]) {
                    u[i] = tape.u[i];
                }
                tape.u[entry.u.clone()].copy_from_slice(&u[entry.u.clone()]);
                prior.forward(tape);
            }
        }
        for term in self.fields.iter().flat_map(|f| &f.op.terms) {
            for i in (term.eta..term.eta + term.k).filter(|i| !known[*i]) {
                u[i] = rng.sample(StandardNormal);
            }
        }
    }

    /// Refuses a model with an unknown that `fitted` lacks and whose prior cannot be drawn from.
    /// `fitted` is the same model on the first of these rows.
    ///
    /// # Errors
    /// [`ModelError::NoPriorDraw`]
    pub fn check_new(&self, fitted: &Self, rng: &mut dyn Rng) -> Result<(), ModelError> {
        let from = self.unknowns_in(fitted);
        let (mut tape, names) = (self.tape(), self.unknown_names());
        self.forward(&mut tape, &self.initial());
        for ((prior, entry), parameter) in
            self.priors.iter().zip(&self.prior_entries).zip(self.declared())
        {
            let new = entry.u.clone().find(|i| from[*i].is_none());
            let Some(new) = new.filter(|_| prior.draw(&mut tape, rng).is_none()) else { continue };
            let (parameter, prior) = (names[new].clone(), parameter.prior.clone());
            return Err(ModelError::NoPriorDraw { parameter, prior });
        }
        Ok(())
    }

    /// The parameter behind each prior. These are all parameters but the coefficients of fields.
    pub(super) fn declared(&self) -> impl Iterator<Item = &Parameter> {
        self.parameters.iter().filter(|p| p.kind != Kind::Eta)
    }

    fn draw_prior(&self, tape: &mut Tape, rng: &mut ChaCha8Rng) -> Result<(), ModelError> {
        for (prior, parameter) in self.priors.iter().zip(self.declared()) {
            let cannot = || ModelError::NoPriorDraw {
                parameter: parameter.name.clone(),
                prior: parameter.prior.clone(),
            };
            prior.draw(tape, rng as &mut dyn Rng).ok_or_else(cannot)?;
        }
        self.draw_coefficients(tape, rng);
        Ok(())
    }

    fn draw_coefficients(&self, tape: &mut Tape, rng: &mut ChaCha8Rng) {
        for term in self.fields.iter().flat_map(|f| &f.op.terms) {
            tape.u[term.eta..][..term.k].fill_with(|| rng.sample(StandardNormal));
        }
    }
}
