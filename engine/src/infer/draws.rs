//! What a chain gives: transitions, draws, and all draws of a run together.

use super::error::ChainError;
use crate::store::Spool;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::io;

/// What one transition did.
#[derive(Clone, Copy, Debug)]
pub struct Transition {
    /// Mean over the trajectory's new points of min(1, exp(energy at its start − energy)).
    pub accept: f64,
    /// Energy of the point that was drawn.
    pub energy: f64,
    /// Completed doublings.
    pub depth: u32,
    /// Leapfrog steps.
    pub n_leapfrog: u32,
    /// Whether the trajectory diverged.
    pub diverging: bool,
}

impl Transition {
    /// The transition of a chain that stays where it is.
    pub(super) const NONE: Self =
        Self { accept: 1.0, energy: 0.0, depth: 0, n_leapfrog: 0, diverging: false };
}

/// One draw of a chain.
#[derive(Clone, Debug)]
pub struct Draw<'c> {
    /// The density's unknowns, `(dim)`.
    pub position: &'c [f64],
    /// Log density there.
    pub ln_density: f64,
    /// How it was made.
    pub transition: Transition,
    /// Where a trajectory that diverged began and where it diverged, each `(dim)`.
    pub divergence: Option<[Vec<f64>; 2]>,
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

/// The draws of one chain and how they were made; per-draw vectors have an entry for each.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Chain {
    /// Unconstrained positions, a row `(dim)` for each draw.
    pub draws: Spool,
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
    /// The record of independent draws with these log densities, as if a sampler had made them.
    pub fn of_independent_draws(draws: Spool, ln_density: Vec<f64>) -> Self {
        let n = ln_density.len();
        Self {
            draws,
            accept: vec![1.0; n],
            energy: ln_density.iter().map(|ln| -ln).collect(),
            ln_density,
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

    /// Draw `i`, `(dim)`. To go through many, [`Spool::each`] of `draws` reads each block once.
    ///
    /// # Errors
    /// From the disk that the draws are on, if they are on one.
    pub fn draw(&self, i: usize) -> io::Result<Cow<'_, [f64]>> {
        let dim = self.draws.width();
        Ok(match self.draws.rows(i, 0..dim)? {
            Cow::Borrowed(rows) => Cow::Borrowed(&rows[..dim]),
            Cow::Owned(mut rows) => {
                rows.truncate(dim);
                Cow::Owned(rows)
            }
        })
    }

    /// Number of divergent draws.
    pub fn n_divergences(&self) -> usize {
        self.diverging.iter().filter(|d| **d).count()
    }

    /// Whether it is what was kept of at most so many draws of `dim` unknowns, each with all that is told of it.
    pub(super) fn fits(&self, dim: usize, most_draws: usize) -> bool {
        let n = self.n_draws();
        let is_whole = [self.accept.len(), self.energy.len(), self.diverging.len()] == [n; 3]
            && [self.depth.len(), self.n_leapfrog.len()] == [n; 2]
            && self.draws.is_kept(dim)
            && self.draws.n_rows() == n;
        let is_ours = |divergence: &Divergence| {
            divergence.iteration < n && [divergence.start.len(), divergence.end.len()] == [dim; 2]
        };
        n <= most_draws && is_whole && self.divergences.iter().all(is_ours)
    }

    /// Adds a draw.
    ///
    /// # Errors
    /// From the disk that the draws go to.
    pub(super) fn record(&mut self, draw: Draw<'_>) -> io::Result<()> {
        self.draws.push(draw.position)?;
        if let Some([start, end]) = draw.divergence {
            let iteration = self.n_draws();
            self.divergences.push(Divergence { iteration, start, end });
        }
        self.ln_density.push(draw.ln_density);
        self.accept.push(draw.transition.accept);
        self.energy.push(draw.transition.energy);
        self.depth.push(draw.transition.depth);
        self.n_leapfrog.push(draw.transition.n_leapfrog);
        self.diverging.push(draw.transition.diverging);
        Ok(())
    }
}

/// A chain's draws, or why it has none.
pub type ChainResult = Result<Chain, ChainError>;
