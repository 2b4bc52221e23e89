//! Making draws: sampling, alone or kept in a folder; the normal approximation; the prior.

use std::collections::BTreeMap;
use std::sync::Once;
use std::time::Instant;

use super::check::placed;
use super::fit::{Drawn, Fit, Method, Options};
use super::inputs::hash_file;
use super::mode::climb;
use super::needs::{InMemory, Needs};
use super::results::{Results, VERSION};
use super::{Event, Keep, OutputFolder, Problem, RunError, Watch, keep, unknowns, warm_start};
use crate::diagnostics::importance;
use crate::infer::{
    Chain, ChainError, ChainFailure, ChainProgress, InferError, Laplace, LaplaceDraws,
    LogDensity as _, Progress, Settings,
};
use crate::model::{Model, Sampler};
use crate::report::{Approximation, has_enough};
use crate::store::Checkpoint;

/// How a run into a folder ended.
#[derive(Debug)]
pub enum Ended<'m> {
    /// The results are written.
    Now(Box<Fit<'m>>, Box<Results>),
    /// They were there already.
    Before,
    /// The run was stopped, and is kept to go on.
    Stopped,
}

impl<'m> Problem<'m> {
    /// Samples the posterior, with the sampler that suits the model.
    ///
    /// A chain that fails is told by [`Fit::failures`]; the others make the fit.
    ///
    /// # Errors
    /// [`RunError::Infer`] for settings or a model that cannot be sampled; [`RunError::EveryChainFailed`].
    pub fn fit(&self, settings: &Settings) -> Result<Fit<'m>, RunError> {
        self.fit_with(settings, &Options::default())
    }

    /// Samples the posterior.
    ///
    /// # Errors
    /// Those of [`Problem::fit`]; [`RunError::WarmStart`]; [`RunError::Stopped`].
    pub fn fit_with(
        &self,
        settings: &Settings,
        options: &Options<'_>,
    ) -> Result<Fit<'m>, RunError> {
        let job = Job::new(self, settings, options, InMemory::Once)?;
        let (drawn, _) = job.sample(None)?;
        job.fit(some_chains(drawn.ok_or(RunError::Stopped)?)?)
    }

    /// Samples the posterior, kept in the folder `out` while it samples, and writes the results there. Draws go to its
    /// disk; where there is not enough memory, what is reported of them does too.
    ///
    /// # Errors
    /// Those of [`Problem::fit_with`] and [`Fit::write`]; [`RunError::Checkpoint`] for an interrupted
    /// run that is in the way or is not there; [`RunError::AnotherRun`].
    pub fn run_into(
        &self,
        out: &OutputFolder,
        settings: &Settings,
        options: &Options<'_>,
        keep: &Keep,
    ) -> Result<Ended<'m>, RunError> {
        let settings = &Settings { disk: Some(out.path().to_owned()), ..settings.clone() };
        let job = Job::new(self, settings, options, InMemory::Never)?;
        let record = job.method().record(job.problem.model(), &job.settings);
        let identity = keep::identity(VERSION, job.settings.seed, &record, &job.hashes);
        let opened = keep::open(out, identity, &job.starts, keep, &options.watch)?;
        let Some(checkpoint) = opened else { return Ok(Ended::Before) };
        let (drawn, checkpoint) = job.sample(Some(checkpoint))?;
        let Some(drawn) = drawn else { return Ok(Ended::Stopped) };
        let forget = || checkpoint.map_or(Ok(()), Checkpoint::remove);
        match some_chains(drawn) {
            Err(error) => {
                forget()?;
                Err(error)
            }
            Ok(drawn) => {
                let fit = job.fit(drawn)?;
                let results = fit.write_into(out)?;
                if !keep.stays {
                    forget()?;
                }
                Ok(Ended::Now(Box::new(fit), Box::new(results)))
            }
        }
    }

    /// Draws from the prior: what the model says before the measurements have a say.
    ///
    /// # Errors
    /// [`RunError::Infer`] for settings that make no sense, [`RunError::Memory`], [`RunError::Model`] for a
    /// model whose prior cannot be drawn from.
    pub fn prior(&self, settings: &Settings, options: &Options<'_>) -> Result<Fit<'m>, RunError> {
        settings.validate()?;
        let needs = Needs::of(self, settings, InMemory::Once);
        let settings = needs.placed(settings, &options.watch)?;
        let begun = Instant::now();
        let chains = self.model().prior_draws(&settings)?;
        options.watch.tell(&Event::Prior { model: self.model().name });
        let seconds = begun.elapsed().as_secs_f64();
        let drawn = Drawn { chains, seconds, ..Drawn::default() };
        self.without_sampling(Method::Prior, settings, drawn, options)
    }

    /// Draws from the normal approximation at the mode: as many chains as the settings say, corrected by
    /// their importance weights where these can be relied on; else as they are, to be looked at.
    ///
    /// # Errors
    /// [`RunError::Memory`], [`RunError::Infer`] where no mode is found, [`RunError::NotConcave`] where the mode
    /// is no maximum.
    pub fn laplace(&self, settings: &Settings, options: &Options<'_>) -> Result<Fit<'m>, RunError> {
        settings.validate()?;
        let needs = Needs::of(self, settings, InMemory::Twice);
        let settings = needs.placed(settings, &options.watch)?;
        let begun = Instant::now();
        let problem = self.corrected()?;
        let model = problem.model();
        problem.tell_doubts(&options.watch);
        problem.tell_triangulation(&options.watch);
        let optimum = climb(model).map_err(|error| placed(model, error))?;
        let laplace = Laplace::at(model, &optimum).map_err(|error| named(model, error))?;
        options.watch.tell(&Event::Laplace { model: model.name });
        let made = laplace.draws(model, &settings)?;
        let log_ratios: Vec<f64> = made.iter().flat_map(|d| d.log_ratios.clone()).collect();
        let importance = importance(&log_ratios);
        let quality = Approximation::new(&importance);
        let chains = if quality.is_reliable() {
            LaplaceDraws::resample(&made, &importance.weights, &settings)?
        } else {
            made.into_iter().map(|d| d.chain).collect()
        };
        let (seconds, approximation) = (begun.elapsed().as_secs_f64(), Some(quality));
        let drawn = Drawn { chains, seconds, approximation, ..Drawn::default() };
        problem.without_sampling(Method::Laplace, settings, drawn, options)
    }

    fn without_sampling(
        &self,
        method: Method,
        settings: Settings,
        drawn: Drawn,
        options: &Options<'_>,
    ) -> Result<Fit<'m>, RunError> {
        let seconds = self.seconds() + drawn.seconds;
        let is_on_disk = settings.disk.is_some();
        let mut fit = Fit::new(self, method, settings, drawn)?;
        fit.exceed = options.exceed.to_vec();
        fit.weights_only = options.weights_only;
        (fit.compile_seconds, fit.seconds) = (options.compile_seconds, seconds);
        if is_on_disk { fit.read(&options.watch) } else { Ok(fit) }
    }
}

/// The error with the unknown's name in place of its number.
fn named(model: &Model, source: InferError) -> RunError {
    match source {
        InferError::NotConcave { unknown, .. } => {
            let unknown = model.unknown_names()[unknown].clone();
            RunError::NotConcave { unknown, source }
        }
        other => other.into(),
    }
}

/// The draws, if there are any.
fn some_chains(drawn: Drawn) -> Result<Drawn, RunError> {
    if drawn.chains.is_empty() {
        return Err(RunError::EveryChainFailed { failures: drawn.failures });
    }
    Ok(drawn)
}

/// What is sampled, and how.
struct Job<'a, 'm> {
    problem: Problem<'m>,
    sampler: Sampler,
    settings: Settings,
    hashes: BTreeMap<String, String>,
    /// One per chain.
    starts: Vec<Vec<f64>>,
    options: &'a Options<'a>,
    needs: Needs,
    begun: Instant,
}

impl<'a, 'm> Job<'a, 'm> {
    fn new(
        problem: &Problem<'m>,
        settings: &Settings,
        options: &'a Options<'a>,
        draws: InMemory,
    ) -> Result<Self, RunError> {
        settings.validate()?;
        let begun = Instant::now();
        let sampler = options.sampler.unwrap_or_else(|| Sampler::of(problem.model()));
        // before the climbs, which are as many as the chains
        let needs = Needs::of(problem, settings, draws);
        let mut settings = needs.placed(settings, &options.watch)?;
        let (problem, starts) = problem.corrected_with_starts(sampler, &settings)?;
        let model = problem.model();
        let mut hashes = problem.loaded().hashes.clone();
        let starts = match options.warm_start {
            Some(folder) => {
                hashes.insert("init".into(), hash_file(&folder.join(unknowns::FILE))?);
                warm_start::starts(folder, model, starts, &mut settings, &options.watch)?
            }
            None => starts,
        };
        problem.tell_doubts(&options.watch);
        problem.tell_triangulation(&options.watch);
        Ok(Self { problem, sampler, settings, hashes, starts, options, needs, begun })
    }

    fn method(&self) -> Method {
        Method::Sampled(self.sampler)
    }

    /// Since the problem began to be loaded, s.
    fn seconds(&self) -> f64 {
        self.problem.seconds() + self.begun.elapsed().as_secs_f64()
    }

    /// Samples, kept in `checkpoint`, which is given back; no draws if stopped.
    fn sample(
        &self,
        checkpoint: Option<Checkpoint>,
    ) -> Result<(Option<Drawn>, Option<Checkpoint>), RunError> {
        let (model, watch) = (self.problem.model(), &self.options.watch);
        watch.tell(&Event::Sampling {
            model: model.name,
            n_unknowns: model.dim(),
            sampler: self.sampler,
            settings: &self.settings,
            seconds: self.seconds(),
            bytes: self.needs.taken(&self.settings) as u64,
        });
        let sampling = Instant::now();
        let kept = Kept { watch, checkpoint, warned: Once::new(), model, seed: self.settings.seed };
        let results = self.sampler.sample(model, &self.starts, &self.settings, &kept)?;
        let checkpoint = kept.checkpoint;
        let seconds_before = checkpoint.as_ref().map_or(0.0, Checkpoint::seconds_before);
        let seconds = seconds_before + sampling.elapsed().as_secs_f64();
        let mut drawn = Drawn { seconds, seconds_before, ..Drawn::default() };
        for result in results {
            match result {
                Ok(chain) => drawn.chains.push(chain),
                Err(ChainError { failure: ChainFailure::Stopped, .. }) => {
                    return Ok((None, checkpoint));
                }
                // what was kept stays, to be gone on with where there is room
                Err(error @ ChainError { failure: ChainFailure::NotWritten { .. }, .. }) => {
                    return Err(InferError::Chain(error).into());
                }
                Err(error) => {
                    watch.tell(&Event::ChainFailed(&error));
                    drawn.failures.push(error);
                }
            }
        }
        let n_draws = drawn.chains.iter().map(Chain::n_draws).sum();
        watch.tell(&Event::Sampled { n_draws, seconds });
        Ok((Some(drawn), checkpoint))
    }

    fn fit(self, drawn: Drawn) -> Result<Fit<'m>, RunError> {
        let (seconds, method) = (self.seconds(), self.method());
        let is_read = self.needs.draws_in_memory == InMemory::Never || self.settings.disk.is_some();
        let mut fit = Fit::new(&self.problem, method, self.settings, drawn)?;
        fit.hashes = self.hashes;
        fit.exceed = self.options.exceed.to_vec();
        fit.weights_only = self.options.weights_only;
        (fit.compile_seconds, fit.seconds) = (self.options.compile_seconds, seconds);
        if is_read { fit.read(&self.options.watch) } else { Ok(fit) }
    }
}

/// Tells where the chains stand, keeps the run, and ends it on request.
struct Kept<'a> {
    watch: &'a Watch<'a>,
    checkpoint: Option<Checkpoint>,
    warned: Once,
    model: &'a Model,
    seed: u64,
}

impl Progress for Kept<'_> {
    fn report(&self, progress: &ChainProgress) {
        self.watch.tell(&Event::Progress(progress));
        if let Some(reason) = self.checkpoint.as_ref().and_then(Checkpoint::failure) {
            self.warned.call_once(|| self.watch.tell(&Event::NotKept { reason }));
        }
    }

    fn should_stop(&self) -> bool {
        self.watch.should_stop()
    }

    fn is_enough(&self, chains: &[&Chain]) -> bool {
        // a disk that cannot be read is told when the draws are summarised
        has_enough(self.model, chains, self.seed).unwrap_or(true)
    }

    fn checkpoint(&self) -> Option<&Checkpoint> {
        self.checkpoint.as_ref()
    }
}
