//! What the chains share: the stand-in and the proposal of the hyperparameters. A first version is
//! made at the chains' starts; at each meeting they are fitted to the draws of all chains.

use super::explore::{Exploring, Leaps, explore, has_few_unknowns};
use super::groups::Whitening;
use super::latent::{LatentGaussian, Layout};
use super::proposal::Proposal;
use super::stand_in::{Sample, StandIn, Trust};
use super::swaps::Swap;
use crate::infer::curvature::conditional_scales;
use crate::infer::settings::Settings;
use crate::random::Stream;
use rand::RngExt;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

/// Least variance of a hyperparameter in the proposal.
const FLOOR: f64 = 1e-3;

/// What a chain takes from one round to the next.
#[derive(Clone, Debug)]
pub(super) struct Link {
    pub(super) outer: Vec<f64>,
    pub(super) coefficients: Vec<f64>,
    /// Scale of each inner coordinate.
    pub(super) scale: Vec<f64>,
    pub(super) step_size: f64,
    /// ln of the hyperparameter steps' length.
    pub(super) ln_length: f64,
    pub(super) n_evaluations: u64,
}

/// What a chain collects in a round to learn from.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Lesson {
    pub(super) samples: Vec<Sample>,
    pub(super) outer: Vec<Vec<f64>>,
}

impl Lesson {
    /// Whether it is one of `n` draws under this layout.
    pub(super) fn fits(&self, n: usize, layout: &Layout) -> bool {
        let is_sample = |sample: &Sample| sample.fits(layout.n_latent());
        [self.samples.len(), self.outer.len()] == [n; 2]
            && self.samples.iter().all(is_sample)
            && self.outer.iter().all(|outer| outer.len() == layout.outer.len())
    }
}

/// What all chains share. It changes only at a meeting.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Shared {
    pub(super) stand_in: StandIn,
    pub(super) proposal: Proposal,
    /// What is proposed where all unknowns move together, once the warm-up is over.
    pub(super) leaps: Option<Leaps>,
    /// By what a region of the surface goes over from one regime to another.
    pub(super) swaps: Vec<Swap>,
}

impl Shared {
    /// As it was before it was kept; `None` if that cannot be.
    pub(super) fn ready(mut self, density: &dyn LatentGaussian, seed: u64) -> Option<Self> {
        if let Some(leaps) = self.leaps.take() {
            self.leaps = Some(leaps.ready(density, &self.stand_in, seed)?);
        }
        Some(self)
    }

    /// With this many draws of an earlier run the first round is not needed.
    const ENOUGH: usize = 80;

    /// Whether both are of the same layout, which is this one.
    pub(super) fn is_like(&self, other: &Self, layout: &Layout) -> bool {
        self.leaps.as_ref().is_none_or(|leaps| leaps.fits(layout))
            && self.swaps.iter().all(|swap| swap.fits(layout))
            && self.stand_in.is_like(&other.stand_in)
            && self.proposal.is_like(&other.proposal)
    }

    /// Whether draws of an earlier run take the place of the first round.
    pub(super) fn knows_hyper(density: &dyn LatentGaussian, settings: &Settings) -> bool {
        settings.earlier.len() >= Self::ENOUGH && !density.layout().hyper.is_empty()
    }

    /// What the chains share at their starts. Draws of an earlier run shape the proposal. They do
    /// not shape the stand-in, which is made from the present likelihood: this may have terms where
    /// those draws are far off.
    pub(super) fn first(
        density: &dyn LatentGaussian,
        starts: &[Vec<f64>],
        links: &[Link],
        settings: &Settings,
    ) -> Self {
        let stand_in = first_stand_in(density, links, settings.seed);
        let mut proposal = first_proposal(density, &starts[0]);
        if Self::knows_hyper(density, settings) {
            let layout = density.layout();
            let hyper = |draw: &Vec<f64>| {
                let outer = layout.outer_of(draw);
                layout.hyper.iter().map(|i| outer[*i]).collect()
            };
            proposal.fit(&settings.earlier.iter().map(hyper).collect::<Vec<_>>(), FLOOR);
        }
        Self { stand_in, proposal, leaps: None, swaps: vec![] }
    }

    /// What the chains share after a meeting, fitted to what they have seen. At the end of the
    /// warm-up (`last`) the stand-in stays as it is, because the step size has been
    /// tuned to it, and moves of all unknowns together are prepared. What scouts have found
    /// is for swaps alone, for it is no draw of the posterior.
    #[must_use]
    pub(super) fn fitted(
        &self,
        density: &dyn LatentGaussian,
        lessons: Vec<Lesson>,
        scouts: Option<Vec<Sample>>,
        last: Option<Exploring>,
    ) -> Self {
        let mut new = self.clone();
        let (mut samples, mut outer) = (vec![], vec![]);
        for lesson in lessons {
            samples.extend(lesson.samples);
            outer.extend(lesson.outer);
        }
        let layout = density.layout();
        if last.is_none() {
            new.stand_in.fit(&samples, Trust::FULL, layout);
        }
        if let Some(scouts) = scouts {
            samples.extend(scouts);
            new.swaps = Swap::of(&samples, &self.swaps, layout);
        }
        if layout.hyper.is_empty() {
            return new;
        }
        let hyper = |outer: &Vec<f64>| layout.hyper.iter().map(|i| outer[*i]).collect();
        new.proposal.fit(&outer.iter().map(hyper).collect::<Vec<_>>(), FLOOR);
        if let Some(exploring) = last.filter(|_| has_few_unknowns(layout)) {
            new.leaps = explore(density, &new.stand_in, &outer, exploring);
        }
        new
    }
}

/// A chain at its start.
pub(super) fn first_link(density: &dyn LatentGaussian, start: &[f64]) -> Link {
    let layout = density.layout();
    let mut link = Link {
        outer: layout.outer_of(start),
        coefficients: vec![0.0; layout.n_coefficients()],
        scale: vec![1.0; layout.n_coefficients() + layout.free().len()],
        step_size: 1.0,
        ln_length: 0.0,
        n_evaluations: 0,
    };
    density.latent().coefficients(start, &mut link.coefficients);
    link
}

/// Sets the step sizes, scales and step lengths of all chains to their geometric means.
pub(super) fn agree(links: &mut [Link]) {
    let n = links.len() as f64;
    let mean = |of: &dyn Fn(&Link) -> f64| links.iter().map(of).sum::<f64>() / n;
    let ln_step = mean(&|link| link.step_size.ln());
    let ln_length = mean(&|link| link.ln_length);
    let n_scales = links.first().map_or(0, |link| link.scale.len());
    let scale: Vec<f64> = (0..n_scales).map(|i| mean(&|link| link.scale[i].ln()).exp()).collect();
    for link in links {
        link.step_size = ln_step.exp();
        link.ln_length = ln_length;
        link.scale.copy_from_slice(&scale);
    }
}

/// The first stand-in: a Gaussian variational fit by its fixed point W = E[−∇² ln L]. The mean is
/// over the stand-in's own posterior at the chains' starting hyperparameters, and in the first step
/// over a small spread about the starts.
fn first_stand_in(density: &dyn LatentGaussian, links: &[Link], seed: u64) -> StandIn {
    const PASSES: usize = 12;
    const PER_CHAIN: usize = 16;
    let layout = density.layout();
    let mut rng = Stream::StandIn.rng(seed);
    let mut latent = density.latent();
    let mut stand_in = StandIn::new(layout);
    let mut whitening = Whitening::new(layout);
    let n = layout.n_coefficients();
    let (mut z, mut w) = (vec![0.0; n], vec![0.0; n]);
    for pass in 0..PASSES {
        let mut samples = vec![];
        for link in links {
            let ln_prior = latent.set_outer(&link.outer, &mut whitening.designs);
            if !ln_prior.is_finite() || (pass > 0 && !whitening.prepare(&stand_in)) {
                continue;
            }
            for _ in 0..PER_CHAIN {
                z.fill_with(|| rng.sample(StandardNormal));
                if pass == 0 {
                    spread(&link.coefficients, &z, &mut w);
                } else {
                    whitening.coefficients(&z, &mut w);
                }
                let mut theta = vec![0.0; layout.n_latent()];
                let mut slope = theta.clone();
                whitening.latent(&w, &mut theta);
                let value = latent.slope(&theta, &mut slope);
                if value.is_finite() && slope.iter().all(|g| g.is_finite()) {
                    samples.push(Sample { theta, slope });
                }
            }
        }
        stand_in.fit(&samples, Trust::CAUTIOUS, layout);
    }
    stand_in
}

/// Coefficients near a start, a twentieth of a prior standard deviation about it.
fn spread(start: &[f64], z: &[f64], w: &mut [f64]) {
    for ((w, z), start) in w.iter_mut().zip(z).zip(start) {
        *w = start + z / 20.0;
    }
}

/// The first proposal: steps on the scale of each hyperparameter's conditional at a start.
fn first_proposal(density: &dyn LatentGaussian, start: &[f64]) -> Proposal {
    let layout = density.layout();
    let scales = conditional_scales(&mut *density.evaluator(), start, 1.0);
    let outer = layout.outer_of(&scales);
    let scale = |i: &usize| outer[*i].min(1.0);
    Proposal::new(&layout.hyper.iter().map(scale).collect::<Vec<_>>())
}
