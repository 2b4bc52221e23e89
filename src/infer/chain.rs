//! One NUTS chain: its warm-up and its draws, from a start or from where it was interrupted.

use super::adapt::{Warmup, conditional_scales};
use super::hamiltonian::{Hamiltonian, Metric};
use super::moments::Moments;
use super::nuts::{Nuts, NutsState};
use super::sample::{Reporter, is_usable};
use super::{
    Chain, ChainError, ChainFailure, ChainResult, Divergence, LogDensity, Phase, Progress, Settings,
};
use crate::random::Stream;
use crate::store::Keeper;
use std::time::Instant;

/// An interrupted chain: its point, in warm-up the next iteration with what it has learnt, its draws.
pub(super) type Kept = (NutsState, Option<(usize, Warmup)>, Chain);

/// One chain under way.
pub(super) struct Run<'a> {
    chain: usize,
    settings: &'a Settings,
    progress: &'a dyn Progress,
    reporter: Reporter<'a>,
    keeper: Keeper<'a>,
}

impl<'a> Run<'a> {
    pub(super) fn new(chain: usize, settings: &'a Settings, progress: &'a dyn Progress) -> Self {
        let reporter = Reporter::new(chain, settings, progress);
        let keeper = Keeper::new(progress.checkpoint(), chain);
        Self { chain, settings, progress, reporter, keeper }
    }

    /// From `start` and what is `learnt` beforehand, or from where it was interrupted.
    pub(super) fn run(
        &mut self,
        density: &dyn LogDensity,
        start: &[f64],
        learnt: &Moments,
        kept: Option<Kept>,
    ) -> ChainResult {
        let mut nuts = self.begin(density, start);
        let (mut adapting, mut chain) = match kept {
            Some((state, adapting, chain)) => {
                nuts.restore(state);
                (adapting, chain)
            }
            None => (Some((0, self.begin_warmup(&mut nuts, learnt)?)), Chain::default()),
        };
        if let Some((done, adapt)) = &mut adapting {
            self.warm_up(&mut nuts, *done, adapt, &mut chain)?;
            chain.step_size = adapt.final_step_size();
            chain.n_grad_warmup = nuts.n_evaluations();
            chain.inv_metric = nuts.hamiltonian().metric.inverse_mass(start.len());
        }
        self.draw(&mut nuts, chain)
    }

    fn begin<'d>(&self, density: &'d dyn LogDensity, start: &[f64]) -> Nuts<'d> {
        let scale = conditional_scales(&mut *density.evaluator(), start, 1.0);
        let hamiltonian = Hamiltonian::new(density.evaluator(), Metric::Diagonal(scale));
        let rng = Stream::Chain(self.chain).rng(self.settings.seed);
        Nuts::new(hamiltonian, start, self.settings.max_depth, rng)
    }

    fn begin_warmup(&self, nuts: &mut Nuts, learnt: &Moments) -> Result<Warmup, ChainError> {
        if !is_usable(nuts) {
            return Err(self.error(Phase::Warmup, 0, nuts, ChainFailure::NoSupport));
        }
        let Settings { warmup, target_accept, metric, .. } = *self.settings;
        Warmup::begin(nuts, metric, warmup, target_accept, learnt)
            .ok_or_else(|| self.error(Phase::Warmup, 0, nuts, ChainFailure::NoStepSize))
    }

    /// Adapts from iteration `done` on.
    fn warm_up(
        &mut self,
        nuts: &mut Nuts,
        done: usize,
        adapt: &mut Warmup,
        chain: &mut Chain,
    ) -> Result<(), ChainError> {
        let (begun, before) = (Instant::now(), chain.seconds_warmup);
        for iteration in done..self.settings.warmup {
            self.pause(Phase::Warmup, iteration, nuts, Some((iteration, adapt)), chain)?;
            let transition = nuts.transition(adapt.step_size());
            adapt.update(iteration, nuts, &transition);
            chain.seconds_warmup = before + begun.elapsed().as_secs_f64();
            self.reporter.report(Phase::Warmup, iteration, &transition, adapt.step_size());
        }
        Ok(())
    }

    fn draw(&mut self, nuts: &mut Nuts, mut chain: Chain) -> ChainResult {
        let (begun, before) = (Instant::now(), chain.seconds_sampling);
        self.reporter.divergences = chain.n_divergences();
        let mut start = nuts.point.position.clone();
        for iteration in chain.n_draws()..self.settings.draws {
            self.pause(Phase::Sampling, iteration, nuts, None, &chain)?;
            start.copy_from_slice(&nuts.point.position);
            let transition = nuts.transition(chain.step_size);
            chain.record(&nuts.point.position, nuts.point.ln_density, &transition);
            if transition.diverging {
                let end = nuts.divergent_position().to_vec();
                chain.divergences.push(Divergence { iteration, start: start.clone(), end });
            }
            chain.seconds_sampling = before + begun.elapsed().as_secs_f64();
            self.reporter.report(Phase::Sampling, iteration, &transition, chain.step_size);
        }
        chain.n_grad_sampling = nuts.n_evaluations() - chain.n_grad_warmup;
        Ok(chain)
    }

    /// Between two transitions: keeps the chain now and then, and stops on request.
    fn pause(
        &mut self,
        phase: Phase,
        iteration: usize,
        nuts: &Nuts,
        adapting: Option<(usize, &mut Warmup)>,
        chain: &Chain,
    ) -> Result<(), ChainError> {
        let stops = self.progress.should_stop();
        // written as it is read, as `Kept`
        if self.keeper.is_due(stops) {
            self.keeper.keep(&(nuts.state(), adapting, chain));
        }
        if stops {
            return Err(self.error(phase, iteration, nuts, ChainFailure::Stopped));
        }
        Ok(())
    }

    fn error(
        &self,
        phase: Phase,
        iteration: usize,
        nuts: &Nuts,
        failure: ChainFailure,
    ) -> ChainError {
        let position = nuts.point.position.clone();
        ChainError {
            chain: self.chain,
            seed: self.settings.seed,
            phase,
            iteration,
            position,
            failure,
        }
    }
}
