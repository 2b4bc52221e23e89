//! The chains of a run: their steps, and around these progress, checkpoints and meetings.

use super::draws::{Chain, ChainResult, Transition};
use super::error::{ChainError, ChainFailure, InferError};
use super::markov::Together;
use super::progress::{ChainProgress, Phase, Progress};
use super::settings::Settings;
use crate::store::{Checkpoint, Keeper, Spool, take_chains};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// An interrupted chain: how often it had met the others, its state and its draws.
type Kept<C> = (usize, <C as Together>::State, Chain);

/// All chains after a meeting: how many meetings there had been, and for each chain its draws or
/// its failure.
type Met<C> = (usize, Vec<Result<(<C as Together>::State, Chain), ChainError>>);

/// Runs chains that have been begun. If they were interrupted, it goes on with them. Uses the
/// threads of the current pool; the results are in order.
///
/// # Errors
/// [`InferError::Checkpoint`].
pub(super) fn run<C: Together>(
    chains: Vec<Result<C, ChainError>>,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Vec<ChainResult>, InferError> {
    let under = |(i, chain): (usize, Result<C, ChainError>)| {
        chain.map(|chain| Under::new(i, chain, settings, progress))
    };
    let mut chains: Vec<_> = chains.into_iter().enumerate().map(under).collect();
    if let Some(checkpoint) = progress.checkpoint() {
        restore(&mut chains, checkpoint)?;
    }
    let round = settings.enough_after.unwrap_or(settings.draws);
    // a chain is in the round of the one that has most draws
    let drawn = chains.iter().flatten().map(|under| under.record.n_draws()).max().unwrap_or(0);
    let mut until = round * drawn.div_ceil(round).max(1);
    loop {
        until = until.min(settings.draws);
        chains.par_iter_mut().for_each(|chain| go_on(chain, |under| under.advance(until)));
        let was_stopped = chains.iter().any(is_stopped);
        if was_stopped {
            // what the next round starts from is not known: resumed, all go through this one again
            for chain in &mut chains {
                go_on(chain, Under::stop_at_meeting);
            }
        }
        if chains.iter().flatten().any(|under| under.chain.must_meet()) {
            meet(&mut chains, progress.checkpoint());
        } else if was_stopped || until == settings.draws || is_enough(&chains, progress) {
            return Ok(chains.into_iter().map(|chain| chain.map(Under::end)).collect());
        } else {
            until += round;
        }
    }
}

/// Whether there are chains, and their draws are enough.
fn is_enough<C>(chains: &[Result<Under<'_, C>, ChainError>], progress: &dyn Progress) -> bool {
    let records: Vec<&Chain> = chains.iter().flatten().map(|under| &under.record).collect();
    records.is_empty() || progress.is_enough(&records)
}

/// Does something with a chain that has not failed. If this fails, the chain counts as failed.
fn go_on<C>(chain: &mut Result<C, ChainError>, with: impl Fn(&mut C) -> Result<(), ChainError>) {
    if let Err(error) = chain.as_mut().map_or(Ok(()), with) {
        *chain = Err(error);
    }
}

fn is_stopped<C>(chain: &Result<C, ChainError>) -> bool {
    matches!(chain, Err(ChainError { failure: ChainFailure::Stopped, .. }))
}

/// Takes up what was saved, of each chain its newest state. This is the chain's own file if it was
/// written since the last meeting.
fn restore<C: Together>(
    chains: &mut [Result<Under<'_, C>, ChainError>],
    checkpoint: &Checkpoint,
) -> Result<(), InferError> {
    let met: Option<Met<C>> = checkpoint.take_common()?;
    if met.as_ref().is_some_and(|(_, met)| met.len() != chains.len()) {
        return Err(checkpoint.misfit(None).into());
    }
    let (n_meetings, met) = match met {
        Some((n, met)) => (Some(n), met.into_iter().map(Some).collect()),
        None => (None, vec![]),
    };
    let kept: Vec<Option<Kept<C>>> = take_chains(checkpoint, chains.len())?;
    let met = met.into_iter().chain(std::iter::repeat_with(|| None));
    let mut n_met = None;
    for (index, ((chain, kept), met)) in chains.iter_mut().zip(kept).zip(met).enumerate() {
        let own = kept.filter(|(n, ..)| n_meetings.is_none_or(|met| met == *n));
        let misfit = checkpoint.misfit(own.is_some().then_some(index));
        let state = own.map(|(_, state, record)| Ok((state, record))).or(met);
        match (state, &mut *chain) {
            (Some(Err(error)), _) => *chain = Err(error),
            (Some(Ok((state, record))), Ok(under)) => {
                if !under.fits(&state, &record) {
                    return Err(misfit.into());
                }
                under.take_up(record)?;
                if let Err(error) = under.chain.restore(state) {
                    *chain = Err(error);
                }
            }
            _ => {}
        }
        // chains go on together
        let n = chain.as_ref().map(|under| under.chain.n_meetings()).ok();
        if n.is_some() && n_met.is_some() && n != n_met {
            return Err(misfit.into());
        }
        n_met = n.or(n_met);
    }
    Ok(())
}

/// Lets the chains meet, and saves them. An interruption after this goes on from here.
fn meet<C: Together>(
    chains: &mut [Result<Under<'_, C>, ChainError>],
    checkpoint: Option<&Checkpoint>,
) {
    let met = C::meet(chains.iter_mut().flatten().map(|under| &mut under.chain).collect());
    let mut met = met.into_iter();
    for chain in chains.iter_mut().filter(|chain| chain.is_ok()) {
        if let Some(Err(error)) = met.next() {
            *chain = Err(error);
        }
    }
    let n = chains.iter().flatten().map(|under| under.chain.n_meetings()).next();
    if let (Some(checkpoint), Some(n)) = (checkpoint, n) {
        let states: Vec<_> = chains.iter().map(kept).collect();
        // written as it is read, as `Met`
        checkpoint.share(&(n, states));
    }
}

/// A chain with its draws, or its failure.
fn kept<'u, C: Together>(
    chain: &'u Result<Under<'_, C>, ChainError>,
) -> Result<(C::State, &'u Chain), ChainError> {
    let kept = |under: &'u Under<'_, C>| (under.chain.state(), &under.record);
    chain.as_ref().map(kept).map_err(Clone::clone)
}

/// Where the draws of chain number `index` go.
fn draws_of(index: usize, dim: usize, settings: &Settings, progress: &dyn Progress) -> Spool {
    progress.checkpoint().map_or_else(
        || Spool::new(dim, settings.draws, settings.disk.as_deref()),
        |checkpoint| checkpoint.draws(index, dim),
    )
}

/// One chain under way.
struct Under<'a, C> {
    index: usize,
    chain: C,
    /// Its draws so far.
    record: Chain,
    settings: &'a Settings,
    progress: &'a dyn Progress,
    keeper: Keeper<'a>,
    /// Divergences in the present phase.
    divergences: usize,
    reported: Instant,
}

impl<'a, C: Together> Under<'a, C> {
    const REPORT_EVERY: Duration = Duration::from_millis(250);

    fn new(index: usize, chain: C, settings: &'a Settings, progress: &'a dyn Progress) -> Self {
        Self {
            index,
            record: Chain {
                draws: draws_of(index, chain.dim(), settings, progress),
                ..Chain::default()
            },
            chain,
            settings,
            progress,
            keeper: Keeper::new(progress.checkpoint(), index),
            divergences: 0,
            reported: Instant::now(),
        }
    }

    /// Goes on from the draws that were kept.
    fn take_up(&mut self, kept: Chain) -> Result<(), InferError> {
        let mut draws = std::mem::take(&mut self.record.draws);
        if let Some(checkpoint) = self.progress.checkpoint() {
            checkpoint.take_draws(self.index, &mut draws, kept.draws)?;
        }
        self.record = Chain { draws, ..kept };
        Ok(())
    }

    /// Whether the chain can have come to this state with this record.
    fn fits(&self, state: &C::State, record: &Chain) -> bool {
        record.fits(self.chain.dim(), self.settings.draws)
            && self.chain.fits(state, record.n_draws())
    }

    /// To the next meeting, or to so many draws.
    fn advance(&mut self, draws: usize) -> Result<(), ChainError> {
        let (begun, before) = (Instant::now(), self.record.seconds_warmup);
        while self.chain.phase() == Phase::Warmup && !self.chain.must_meet() {
            let iteration = self.chain.n_adapted();
            self.pause(iteration)?;
            if let Some(transition) = self.chain.adapt()? {
                self.record.seconds_warmup = before + begun.elapsed().as_secs_f64();
                self.report(Phase::Warmup, iteration, &transition);
            }
        }
        if self.chain.phase() == Phase::Sampling { self.sample(draws) } else { Ok(()) }
    }

    fn sample(&mut self, draws: usize) -> Result<(), ChainError> {
        let (begun, before) = (Instant::now(), self.record.seconds_sampling);
        self.record.step_size = self.chain.step_size();
        self.divergences = self.record.n_divergences();
        for iteration in self.record.n_draws()..draws {
            self.pause(iteration)?;
            let draw = self.chain.draw()?;
            let transition = draw.transition;
            if let Err(error) = self.record.record(draw) {
                return Err(self.chain.error(iteration, self.not_written(&error)));
            }
            self.record.seconds_sampling = before + begun.elapsed().as_secs_f64();
            self.report(Phase::Sampling, iteration, &transition);
        }
        Ok(())
    }

    fn not_written(&self, error: &std::io::Error) -> ChainFailure {
        let kept = self.progress.checkpoint().map(|kept| kept.path_of_draws(self.index));
        let to = kept.or_else(|| self.settings.disk.clone()).unwrap_or_default();
        ChainFailure::NotWritten { what: format!("{}: {error}", to.display()) }
    }

    fn end(self) -> Chain {
        let [n_grad_warmup, n_grad_sampling] = self.chain.n_evaluations();
        Chain { n_grad_warmup, n_grad_sampling, ..self.record }
    }

    /// What is done between two transitions: saves the chain now and then, and stops on request.
    fn pause(&mut self, iteration: usize) -> Result<(), ChainError> {
        let stops = self.progress.should_stop();
        if self.keeper.is_due(stops) {
            // written as it is read, as `Kept`
            let state = (self.chain.n_meetings(), self.chain.state(), &self.record);
            self.keeper.keep_with(&state, Some(&self.record.draws));
        }
        if stops { Err(self.chain.error(iteration, ChainFailure::Stopped)) } else { Ok(()) }
    }

    fn stop_at_meeting(&mut self) -> Result<(), ChainError> {
        if self.chain.must_meet() {
            return Err(self.chain.error(self.chain.n_adapted(), ChainFailure::Stopped));
        }
        Ok(())
    }

    /// Tells the watcher where the chain stands, now and then and at the end of each phase.
    fn report(&mut self, phase: Phase, iteration: usize, transition: &Transition) {
        self.divergences += usize::from(transition.diverging);
        let Settings { warmup, draws, .. } = *self.settings;
        let (before, last) = match phase {
            Phase::Warmup => (0, iteration + 1 == warmup),
            Phase::Sampling => (warmup, iteration + 1 == draws),
        };
        if last || self.reported.elapsed() >= Self::REPORT_EVERY {
            self.reported = Instant::now();
            self.progress.report(&ChainProgress {
                chain: self.index,
                phase,
                iteration: before + iteration + 1,
                total: warmup + draws,
                divergences: self.divergences,
                step_size: self.chain.step_size(),
            });
        }
    }
}

#[cfg(test)]
#[path = "forged_tests.rs"]
mod forged_tests;
