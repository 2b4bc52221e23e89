//! What can go wrong in inference, as texts a person can act on.

use super::progress::Phase;
use crate::store::{CheckpointError, advice};
use serde::{Deserialize, Serialize};
use std::io;
use std::path::PathBuf;

/// Input that cannot be sampled, found before any chain starts.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InferError {
    /// A count that must be positive.
    #[error("sampler setting `{name}`: expected at least {least}, got {got}\nhelp: {help}")]
    TooSmall {
        /// The setting.
        name: &'static str,
        /// Its least value.
        least: usize,
        /// The value given.
        got: usize,
        /// What to do.
        help: &'static str,
    },
    /// `target_accept` outside (0, 1).
    #[error(
        "sampler setting `target_accept`: expected a number strictly between 0 and 1, got {got}\n\
         help: 0.95 is the default; towards 0.99 for fewer divergences, towards 0.8 for speed"
    )]
    TargetAccept {
        /// The value given.
        got: f64,
    },
    /// `max_depth` outside 1..=20.
    #[error(
        "sampler setting `max_depth`: expected 1 to 20, got {got}\n\
         help: 10 is the default: at most 1023 leapfrog steps per draw"
    )]
    MaxDepth {
        /// The value given.
        got: u32,
    },
    /// A density without unknowns.
    #[error(
        "nothing to sample: the model has no unknowns\n\
         help: declare at least one `param` or `field`"
    )]
    NoUnknowns,
    /// Not one start per chain.
    #[error(
        "starting points: expected {expected}, one per chain, got {got}\n\
         help: pass `jittered_starts(.., chains, ..)` made with the same number of chains"
    )]
    StartCount {
        /// Number of chains.
        expected: usize,
        /// Starts given.
        got: usize,
    },
    /// A start of the wrong length.
    #[error(
        "starting point of chain {}: expected {expected} coordinates, got {got}\n\
         help: a start has one unconstrained number per unknown, `LogDensity::dim()` in all",
        .chain + 1
    )]
    StartLength {
        /// The chain, from 0.
        chain: usize,
        /// Dimension of the density.
        expected: usize,
        /// Length given.
        got: usize,
    },
    /// A draw of an earlier run of the wrong length.
    #[error(
        "draw of an earlier run: expected {expected} coordinates, got {got}\n\
         help: a draw has one unconstrained number per unknown, `LogDensity::dim()` in all"
    )]
    EarlierLength {
        /// Dimension of the density.
        expected: usize,
        /// Length given.
        got: usize,
    },
    /// No density at the initial point.
    #[error(
        "the initial point has no support: its log density is {ln_density} (expected a finite \
         number with a finite gradient)\n\
         help: choose ranges or priors under which every observation is possible at the start"
    )]
    NoSupport {
        /// Log density there.
        ln_density: f64,
        /// The point.
        position: Vec<f64>,
    },
    /// A climb that ended on no mode.
    #[error(
        "no mode reached after {iterations} iterations: the largest gradient entry is {gradient_norm:.1e}; \
         the density may have no maximum\n\
         help: sample instead, or use tighter priors: the joint mode of a hierarchical model may not exist"
    )]
    NoMode {
        /// Iterations used.
        iterations: usize,
        /// Largest absolute gradient entry.
        gradient_norm: f64,
    },
    /// A mode at which the density does not fall off in every direction.
    #[error(
        "no normal approximation at the mode: the log density does not fall off along unknown {unknown} \
         (curvature {curvature:.2e}, expected below 0)\n\
         help: sample instead, or use a tighter prior on it"
    )]
    NotConcave {
        /// The unknown that moves most along the worst direction, from 0.
        unknown: usize,
        /// Second derivative along that direction; NaN next to a wall.
        curvature: f64,
    },
    /// No jittered point with support.
    #[error(
        "starting point of chain {} (seed {seed}): no point with a finite log density among \
         {tried} tried near the optimum\n\
         help: the optimum lies on the edge of the support; check priors and observations there",
        .chain + 1
    )]
    NoStart {
        /// The chain, from 0.
        chain: usize,
        /// The seed.
        seed: u64,
        /// Points tried.
        tried: usize,
    },
    /// A single chain that cannot begin.
    #[error(transparent)]
    Chain(#[from] ChainError),
    /// What was kept of an interrupted run cannot be used.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// Draws that the disk of [`Settings::disk`](super::Settings::disk) does not take, or give back.
    #[error("draws on the disk of {} cannot be written or read: {source}\nhelp: {}", folder.display(), advice(source))]
    Disk {
        /// The folder.
        folder: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The thread pool could not be made.
    #[error(
        "cannot start {threads} threads: {reason}\n\
         help: lower the number of threads"
    )]
    Threads {
        /// Threads asked for.
        threads: usize,
        /// The system's answer.
        reason: String,
    },
}

/// Why one chain ended without its draws.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error, Serialize, Deserialize)]
#[non_exhaustive]
pub enum ChainFailure {
    /// Density or gradient not finite at the start.
    #[error(
        "the log density or its gradient is not finite at the starting point\n\
         help: check the observations that have no support there; in Rust, start from `jittered_starts`"
    )]
    NoSupport,
    /// Density or gradient not finite where the chain has come to.
    #[error(
        "the chain has run away: the log density or its gradient is not finite where it has come to\n\
         help: the posterior may be improper; give priors to the unknowns that no measurement holds"
    )]
    RanAway,
    /// No step size gives an acceptable leapfrog step.
    #[error(
        "no step size between 1e-30 and 1e30 suits the starting point\n\
         help: the gradient may be wrong or the density flat; compare it with finite differences"
    )]
    NoStepSize,
    /// The disk that the draws go to does not take them.
    #[error(
        "cannot write {what}\nhelp: make room there, then give the command again with --resume"
    )]
    NotWritten {
        /// The file or the folder, and the system's answer.
        what: String,
    },
    /// [`super::Progress::should_stop`] said so.
    #[error("stopped on request\nhelp: run again for the full number of draws")]
    Stopped,
}

/// A chain that failed, with all that is needed to see it fail again.
#[derive(Clone, Debug, thiserror::Error, Serialize, Deserialize)]
#[error("chain {} (seed {seed}), {phase} iteration {iteration}: {failure}", .chain + 1)]
pub struct ChainError {
    /// The chain, from 0.
    pub chain: usize,
    /// The seed of the run.
    pub seed: u64,
    /// Warm-up or sampling.
    pub phase: Phase,
    /// Iteration within the phase, from 0.
    pub iteration: usize,
    /// Unconstrained position, `(dim)`.
    pub position: Vec<f64>,
    /// What happened.
    pub failure: ChainFailure,
}
