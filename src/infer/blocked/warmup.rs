//! The warm-up of all chains together: a first stand-in, then stages of adaptation.

use super::chain::{Common, Kept, Lesson, Link, Run};
use super::latent::LatentGaussian;
use super::proposal::Proposal;
use super::stand_in::{Sample, StandIn, Trust};
use super::whiten::Whitening;
use crate::infer::adapt::conditional_scales;
use crate::infer::{ChainError, ChainFailure, Phase, Progress, Settings};
use crate::random::Stream;
use rand::RngExt;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A chain's state, or why it has ended.
pub(super) type Chained = Result<Link, ChainError>;

/// Ends of the stages, as shares of the warm-up. Many: chains under a stand-in that claims too much
/// spread slowly, so that its successor, fitted to their draws, still claims too much, if less.
pub(super) const STAGES: [f64; 6] = [0.1, 0.2, 0.3, 0.4, 0.6, 1.0];

/// What a stage starts from; after the last stage of warm-up, sampling.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Shared {
    stage: usize,
    /// Transitions of earlier stages.
    before: usize,
    stand_in: StandIn,
    proposal: Proposal,
    pub(super) links: Vec<Chained>,
}

impl Shared {
    /// Draws of an earlier run that can stand for the first stage.
    const ENOUGH: usize = 80;

    /// At the chains' starts. Draws of an earlier run shape the proposal; the stand-in is of the
    /// present likelihood, which may have terms where those draws are far off.
    pub(super) fn new(
        density: &dyn LatentGaussian,
        starts: &[Vec<f64>],
        settings: &Settings,
    ) -> Self {
        let links: Vec<Chained> = starts.iter().map(|start| Ok(link(density, start))).collect();
        let stand_in = first_stand_in(density, &links, settings.seed);
        let proposal = first_proposal(density, &starts[0]);
        let mut new = Self { stage: 0, before: 0, stand_in, proposal, links };
        if settings.earlier.len() >= Self::ENOUGH && !density.layout().hyper.is_empty() {
            let layout = density.layout();
            let hyper = |draw: &Vec<f64>| {
                let outer = layout.outer_of(draw);
                layout.hyper.iter().map(|i| outer[*i]).collect()
            };
            new.proposal.fit(&settings.earlier.iter().map(hyper).collect::<Vec<_>>());
            new.stage = 1;
        }
        new
    }

    /// What chains need in this stage. From here on an interrupted run goes on from this.
    pub(super) fn common<'a>(
        &'a self,
        density: &'a dyn LatentGaussian,
        settings: &'a Settings,
        progress: &'a dyn Progress,
    ) -> Common<'a> {
        if let Some(checkpoint) = progress.checkpoint()
            && !self.links.iter().any(is_stopped)
        {
            checkpoint.share(self);
        }
        let Self { stage, before, stand_in, proposal, .. } = self;
        Common { density, settings, progress, stand_in, proposal, stage: *stage, before: *before }
    }
}

fn is_stopped(chained: &Chained) -> bool {
    matches!(chained, Err(ChainError { failure: ChainFailure::Stopped, .. }))
}

/// Ends the chains that were through the stage when others were stopped in it: what the next one starts
/// from is not known, so that a state of it must not be kept. Resumed, they go through the stage again.
fn stop_all(links: &mut [Chained], settings: &Settings, iteration: usize) {
    for (chain, link) in links.iter_mut().enumerate() {
        if let Ok(Link { outer, block, .. }) = link {
            let (position, seed) = ([&outer[..], block].concat(), settings.seed);
            let (phase, failure) = (Phase::Warmup, ChainFailure::Stopped);
            *link = Err(ChainError { chain, seed, phase, iteration, position, failure });
        }
    }
}

/// Runs `f` for every chain that has come this far on the threads at hand, results in order; it is
/// given what was kept of the chain in this stage.
pub(super) fn for_each_chain<T: Send>(
    common: Common<'_>,
    links: &[Chained],
    kept: &mut Vec<Option<Kept>>,
    f: impl Fn(usize, &Link, Option<Kept>) -> Result<T, ChainError> + Sync + Send,
) -> Vec<Result<T, ChainError>> {
    let of_stage = |kept: Option<Kept>| kept.filter(|(stage, ..)| *stage == common.stage);
    let kept = std::mem::take(kept).into_iter().chain(std::iter::repeat_with(|| None));
    let chains: Vec<_> = links.iter().zip(kept.map(of_stage)).enumerate().collect();
    let run = |(chain, (link, kept)): (usize, (&Chained, Option<Kept>))| match link {
        Ok(link) => f(chain, link, kept),
        Err(error) => Err(error.clone()),
    };
    chains.into_par_iter().map(run).collect()
}

/// The stages of warm-up that `shared` has before it.
pub(super) fn warm_up(
    density: &dyn LatentGaussian,
    mut shared: Shared,
    kept: &mut Vec<Option<Kept>>,
    settings: &Settings,
    progress: &dyn Progress,
) -> Shared {
    while let Some(end) = STAGES.get(shared.stage) {
        let n = (settings.warmup as f64 * end).round() as usize - shared.before;
        let common = shared.common(density, settings, progress);
        let learn = |chain: usize, link: &Link, kept: Option<Kept>| {
            let (state, learning) = kept.map_or((None, None), |(_, state, l, _)| (Some(state), l));
            Run::new(common, chain, link, state)?.learn(n, link, learning)
        };
        let ended = for_each_chain(common, &shared.links, kept, learn);
        let mut lessons = vec![];
        shared.links = vec![];
        for result in ended {
            shared.links.push(result.map(|(link, lesson)| {
                lessons.push(lesson);
                link
            }));
        }
        if shared.links.iter().any(is_stopped) {
            stop_all(&mut shared.links, settings, shared.before);
            return shared;
        }
        shared.before += n;
        shared.stage += 1;
        let is_last = shared.stage == STAGES.len();
        if !lessons.is_empty() {
            // the last stage has tuned the step size to the stand-in: it stays
            let stand_in = (!is_last).then_some(&mut shared.stand_in);
            fit(density, stand_in, &mut shared.proposal, lessons);
        }
        agree(&mut shared.links);
    }
    shared
}

/// A chain at its start.
fn link(density: &dyn LatentGaussian, start: &[f64]) -> Link {
    let layout = density.layout();
    let mut link = Link {
        outer: layout.outer_of(start),
        block: vec![0.0; layout.n_block()],
        scale: vec![1.0; layout.n_block() + layout.free().len()],
        step_size: 1.0,
        ln_length: 0.0,
        n_grad: 0,
        seconds: 0.0,
    };
    density.latent().block(start, &mut link.block);
    link
}

/// A Gaussian variational fit by its fixed point W = E[−∇² ln L], the mean over the stand-in's own
/// posterior at the chains' starting hyperparameters, first over a spread about the starts.
fn first_stand_in(density: &dyn LatentGaussian, links: &[Chained], seed: u64) -> StandIn {
    const PASSES: usize = 12;
    const PER_CHAIN: usize = 16;
    let layout = density.layout();
    let mut rng = Stream::StandIn.rng(seed);
    let mut latent = density.latent();
    let mut stand_in = StandIn::new(layout);
    let mut whitening = Whitening::new(layout);
    let (mut z, mut w) = (vec![0.0; layout.n_block()], vec![0.0; layout.n_block()]);
    for pass in 0..PASSES {
        let mut samples = vec![];
        for link in links.iter().flatten() {
            let ln_prior = latent.set_outer(&link.outer, &mut whitening.design);
            if !ln_prior.is_finite() || (pass > 0 && !whitening.prepare(&stand_in)) {
                continue;
            }
            for _ in 0..PER_CHAIN {
                z.fill_with(|| rng.sample(StandardNormal));
                if pass == 0 {
                    spread(&link.block, &z, &mut w);
                } else {
                    whitening.block(&z, &mut w);
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
fn spread(block: &[f64], z: &[f64], w: &mut [f64]) {
    for ((w, z), start) in w.iter_mut().zip(z).zip(block) {
        *w = start + z / 20.0;
    }
}

/// Steps on the scale of each hyperparameter's conditional at a start.
fn first_proposal(density: &dyn LatentGaussian, start: &[f64]) -> Proposal {
    let layout = density.layout();
    let scales = conditional_scales(&mut *density.evaluator(), start, 1.0);
    let outer = layout.outer_of(&scales);
    let scale = |i: &usize| outer[*i].min(1.0);
    Proposal::new(&layout.hyper.iter().map(scale).collect::<Vec<_>>())
}

/// Fits what the chains share to what they have seen.
fn fit(
    density: &dyn LatentGaussian,
    stand_in: Option<&mut StandIn>,
    proposal: &mut Proposal,
    lessons: Vec<Lesson>,
) {
    let (mut samples, mut hyper) = (vec![], vec![]);
    for lesson in lessons {
        samples.extend(lesson.samples);
        hyper.extend(lesson.hyper);
    }
    if let Some(stand_in) = stand_in {
        stand_in.fit(&samples, Trust::FULL, density.layout());
    }
    if !density.layout().hyper.is_empty() {
        proposal.fit(&hyper);
    }
}

/// Gives all chains the geometric means of their step sizes, scales and lengths.
fn agree(links: &mut [Chained]) {
    let n = links.iter().flatten().count() as f64;
    let mean = |of: &dyn Fn(&Link) -> f64| links.iter().flatten().map(of).sum::<f64>() / n;
    let ln_step = mean(&|link| link.step_size.ln());
    let ln_length = mean(&|link| link.ln_length);
    let n_scales = links.iter().flatten().next().map_or(0, |link| link.scale.len());
    let scale: Vec<f64> = (0..n_scales).map(|i| mean(&|link| link.scale[i].ln()).exp()).collect();
    for link in links.iter_mut().flatten() {
        link.step_size = ln_step.exp();
        link.ln_length = ln_length;
        link.scale.copy_from_slice(&scale);
    }
}
