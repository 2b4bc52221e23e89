//! Several NUTS chains in parallel: settings, draws, progress.
//!
//! One `ChaCha8` stream per chain makes results the same, bit for bit, on any number of threads.

use super::LogDensity;
use super::chain::{Kept, Run};
use super::error::{ChainError, InferError};
use super::moments::Moments;
use super::nuts::{Nuts, Transition};
use crate::store::{Checkpoint, take_chains};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::time::{Duration, Instant};

/// The shape of the inverse mass matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum MetricKind {
    /// One scale per coordinate, by Fisher divergence.
    #[default]
    Diagonal,
    /// The covariance of the warm-up draws, correlations shrunk.
    Dense,
}

/// How to sample.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Number of chains.
    pub chains: usize,
    /// Warm-up transitions per chain, not kept.
    pub warmup: usize,
    /// Draws kept per chain.
    pub draws: usize,
    /// Mean acceptance that the step size is tuned to, in (0, 1).
    pub target_accept: f64,
    /// Most doublings per transition, 1 to 20.
    pub max_depth: u32,
    /// Seed of all random streams.
    pub seed: u64,
    /// Number of threads; 0 means one per core.  Does not change any number.
    pub threads: usize,
    /// The shape of the metric.
    pub metric: MetricKind,
    /// Draws of a similar density, each `(dim)`: warm-up begins with what they tell about scales,
    /// so that it can be short. Empty: it begins with nothing.
    pub earlier: Vec<Vec<f64>>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            chains: 4,
            warmup: 1000,
            draws: 1000,
            target_accept: 0.95,
            max_depth: 10,
            seed: 1,
            threads: 0,
            metric: MetricKind::Diagonal,
            earlier: vec![],
        }
    }
}

impl Settings {
    /// The least warm-up from which a step size and a metric can be learnt.
    const LEAST_WARMUP: usize = 20;

    /// Checks every setting.
    ///
    /// # Errors
    /// [`InferError::TooSmall`], [`InferError::TargetAccept`], [`InferError::MaxDepth`].
    pub fn validate(&self) -> Result<(), InferError> {
        let least = |name, got, least, help| {
            if got < least {
                return Err(InferError::TooSmall { name, least, got, help });
            }
            Ok(())
        };
        least("chains", self.chains, 1, "4 is the default; R̂ needs at least 2")?;
        least("draws", self.draws, 1, "1000 per chain is the default")?;
        let help = "1000 is the default; step size and metric are learnt in warm-up";
        least("warmup", self.warmup, Self::LEAST_WARMUP, help)?;
        if !(self.target_accept > 0.0 && self.target_accept < 1.0) {
            return Err(InferError::TargetAccept { got: self.target_accept });
        }
        if !(1..=20).contains(&self.max_depth) {
            return Err(InferError::MaxDepth { got: self.max_depth });
        }
        Ok(())
    }
}

/// Warm-up or sampling.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Phase {
    /// Step size and metric adapt; draws are dropped.
    Warmup,
    /// Nothing adapts; draws are kept.
    Sampling,
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Warmup => "warm-up",
            Self::Sampling => "sampling",
        })
    }
}

/// Where one chain stands.
#[derive(Clone, Copy, Debug)]
pub struct ChainProgress {
    /// The chain, from 0.
    pub chain: usize,
    /// Warm-up or sampling.
    pub phase: Phase,
    /// Transitions done, over both phases.
    pub iteration: usize,
    /// Transitions in all.
    pub total: usize,
    /// Divergences in the present phase.
    pub divergences: usize,
    /// Present step size.
    pub step_size: f64,
}

/// Watches a run and may end it.
pub trait Progress: Sync {
    /// Called about four times per second and chain, and at the end of each phase.
    fn report(&self, progress: &ChainProgress);
    /// Asked before every transition; `true` ends the chain with
    /// [`super::ChainFailure::Stopped`].
    fn should_stop(&self) -> bool {
        false
    }
    /// Where the run is kept while it samples, and goes on from.
    fn checkpoint(&self) -> Option<&Checkpoint> {
        None
    }
}

/// Shows nothing and never stops.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn report(&self, _: &ChainProgress) {}
}

/// A divergent transition: both ends show which part of the density caused it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Divergence {
    /// The draw, from 0.
    pub iteration: usize,
    /// Unconstrained position from which the transition started, `(dim)`.
    pub start: Vec<f64>,
    /// Unconstrained position at which it diverged, `(dim)`; may not be finite.
    pub end: Vec<f64>,
}

/// The draws of one chain and how they were made; per-draw vectors have `draws` entries.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Chain {
    /// Unconstrained positions, row-major `(n_draws, dim)`.
    pub draws: Vec<f64>,
    /// Log density of each draw.
    pub ln_density: Vec<f64>,
    /// Mean acceptance over each trajectory.
    pub accept: Vec<f64>,
    /// Energy of each draw, for E-BFMI.
    pub energy: Vec<f64>,
    /// Doublings of each trajectory.
    pub depth: Vec<u32>,
    /// Leapfrog steps of each trajectory.
    pub n_leapfrog: Vec<u32>,
    /// Whether each trajectory diverged.
    pub diverging: Vec<bool>,
    /// The divergent transitions of the sampling phase.
    pub divergences: Vec<Divergence>,
    /// Step size of the sampling phase.
    pub step_size: f64,
    /// Inverse mass matrix: its diagonal `(dim)`, or row-major `(dim, dim)` if dense.
    pub inv_metric: Vec<f64>,
    /// Density evaluations up to the end of warm-up.
    pub n_grad_warmup: u64,
    /// Density evaluations while sampling.
    pub n_grad_sampling: u64,
    /// Wall time of the warm-up, s.
    pub seconds_warmup: f64,
    /// Wall time of the sampling, s.
    pub seconds_sampling: f64,
}

impl Chain {
    /// What a sampler would say of `n` independent draws; positions and densities are to be filled in.
    pub fn of_independent_draws(n: usize) -> Self {
        Self {
            accept: vec![1.0; n],
            depth: vec![0; n],
            n_leapfrog: vec![0; n],
            diverging: vec![false; n],
            n_grad_sampling: n as u64,
            ..Self::default()
        }
    }

    /// Number of draws.
    pub fn n_draws(&self) -> usize {
        self.ln_density.len()
    }

    /// Draw `i`, `(dim)`.
    pub fn draw(&self, i: usize) -> &[f64] {
        let dim = self.draws.len() / self.n_draws().max(1);
        &self.draws[i * dim..(i + 1) * dim]
    }

    /// Number of divergent draws.
    pub fn n_divergences(&self) -> usize {
        self.diverging.iter().filter(|d| **d).count()
    }

    pub(super) fn record(&mut self, position: &[f64], ln_density: f64, transition: &Transition) {
        self.draws.extend_from_slice(position);
        self.ln_density.push(ln_density);
        self.accept.push(transition.accept);
        self.energy.push(transition.energy);
        self.depth.push(transition.depth);
        self.n_leapfrog.push(transition.n_leapfrog);
        self.diverging.push(transition.diverging);
    }
}

/// A chain's draws, or why it has none.
pub type ChainResult = Result<Chain, ChainError>;

/// Samples `density` with one NUTS chain from each of `starts`, each `(dim)`.
///
/// The result has one entry per chain, in order; the failure of one leaves the others alone.
///
/// # Errors
/// Those of [`Settings::validate`]; [`InferError::NoUnknowns`], [`InferError::StartCount`],
/// [`InferError::StartLength`], [`InferError::EarlierLength`] for positions that do not fit; [`InferError::Checkpoint`];
/// [`InferError::Threads`].
pub fn sample(
    density: &dyn LogDensity,
    starts: &[Vec<f64>],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Vec<ChainResult>, InferError> {
    check_starts(density, starts, settings)?;
    let kept: Vec<Option<Kept>> = take_chains(progress.checkpoint(), starts.len())?;
    let learnt = Moments::of(density, &settings.earlier, settings.metric == MetricKind::Dense);
    let chains: Vec<_> = starts.iter().zip(kept).enumerate().collect();
    let run = |(chain, (start, kept)): (usize, (&Vec<f64>, Option<Kept>))| {
        Run::new(chain, settings, progress).run(density, start, &learnt, kept)
    };
    Ok(thread_pool(settings)?.install(|| chains.into_par_iter().map(run).collect()))
}

/// Settings that make sense, and one start of the right length per chain.
pub(super) fn check_starts(
    density: &dyn LogDensity,
    starts: &[Vec<f64>],
    settings: &Settings,
) -> Result<(), InferError> {
    settings.validate()?;
    let dim = density.dim();
    if dim == 0 {
        return Err(InferError::NoUnknowns);
    }
    if starts.len() != settings.chains {
        return Err(InferError::StartCount { expected: settings.chains, got: starts.len() });
    }
    if let Some(chain) = starts.iter().position(|start| start.len() != dim) {
        return Err(InferError::StartLength { chain, expected: dim, got: starts[chain].len() });
    }
    if let Some(draw) = settings.earlier.iter().find(|draw| draw.len() != dim) {
        return Err(InferError::EarlierLength { expected: dim, got: draw.len() });
    }
    Ok(())
}

/// As many threads as the settings say.
pub(super) fn thread_pool(settings: &Settings) -> Result<rayon::ThreadPool, InferError> {
    let threads = settings.threads;
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| InferError::Threads { threads, reason: error.to_string() })
}

/// Tells the watcher of a run where one chain stands, now and then.
pub(super) struct Reporter<'a> {
    chain: usize,
    settings: &'a Settings,
    progress: &'a dyn Progress,
    /// Divergences in the present phase.
    pub(super) divergences: usize,
    reported: Instant,
}

impl<'a> Reporter<'a> {
    const REPORT_EVERY: Duration = Duration::from_millis(250);

    pub(super) fn new(chain: usize, settings: &'a Settings, progress: &'a dyn Progress) -> Self {
        Self { chain, settings, progress, divergences: 0, reported: Instant::now() }
    }

    pub(super) fn report(
        &mut self,
        phase: Phase,
        iteration: usize,
        transition: &Transition,
        step_size: f64,
    ) {
        self.divergences += usize::from(transition.diverging);
        let Settings { warmup, draws, .. } = *self.settings;
        let (before, last) = match phase {
            Phase::Warmup => (0, iteration + 1 == warmup),
            Phase::Sampling => (warmup, iteration + 1 == draws),
        };
        if last || self.reported.elapsed() >= Self::REPORT_EVERY {
            self.reported = Instant::now();
            self.progress.report(&ChainProgress {
                chain: self.chain,
                phase,
                iteration: before + iteration + 1,
                total: warmup + draws,
                divergences: self.divergences,
                step_size,
            });
        }
    }
}

/// Whether density and gradient are finite at the chain's point.
pub(super) fn is_usable(nuts: &Nuts) -> bool {
    nuts.point.ln_density.is_finite() && nuts.point.gradient.iter().all(|g| g.is_finite())
}

#[cfg(test)]
#[path = "sample_tests.rs"]
mod tests;
