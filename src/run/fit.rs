//! Draws from a problem's posterior, and what they say.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::sync::OnceLock;
use std::time::Instant;

use super::maps::{FittedMap, SurfaceMaps};
use super::verdict::{LeftOut, exact};
use super::{Problem, RunError, Watch};
use crate::diagnostics::verdict::{Questions, Verdict};
use crate::experiment::thinned;
use crate::infer::{Chain, ChainError, MetricKind, Settings};
use crate::model::{Exceedance, Model, Sampler};
use crate::report::{
    Approximation, LeaveOneOut, Posterior, Row, RunRecord, SettingsRecord, is_sampled,
};

/// Most draws that field maps are averaged over, and that later runs start from; more change nothing that can be seen.
pub(super) const KEPT: usize = 1000;

/// How a problem is fitted, besides the sampler's settings.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options<'a> {
    /// The sampler; without one, that which suits the model.
    pub sampler: Option<Sampler>,
    /// Output folder of an earlier run of this model, perhaps on fewer measurements, whose draws the
    /// chains start from: a short warm-up is then enough.
    pub warm_start: Option<&'a Path>,
    /// Events whose probability is mapped over the surface: [`Problem::exceedance`].
    pub exceed: &'a [Exceedance],
    /// Leave-one-out by importance weights alone: no measurement is left out in a fit of its own, which
    /// takes longer than the run if there are many.
    pub weights_only: bool,
    /// Who is told how it goes on, and may stop it.
    pub watch: Watch<'a>,
    /// Time that the model's compilation took, s, for the run's record.
    pub compile_seconds: f64,
}

/// How draws were made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Sampled from the posterior.
    Sampled(Sampler),
    /// From the normal approximation at the mode.
    Laplace,
    /// From the prior.
    Prior,
}

impl Method {
    /// Its name in the run's record.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sampled(sampler) => sampler.name(),
            Self::Laplace => "laplace",
            Self::Prior => "prior",
        }
    }

    /// The settings as a run's record has them.
    pub fn record(self, model: &Model, settings: &Settings) -> SettingsRecord {
        let target_accept = match self {
            Self::Sampled(sampler) => sampler.target_accept(model, settings),
            Self::Laplace | Self::Prior => None,
        };
        SettingsRecord {
            sampler: self.name().into(),
            chains: settings.chains,
            warmup: settings.warmup,
            draws: settings.draws,
            most_draws: settings.enough_after.map(|_| settings.draws),
            target_accept,
            metric: match settings.metric {
                MetricKind::Diagonal => "diag".into(),
                MetricKind::LowRank => "low-rank".into(),
            },
        }
    }
}

/// Draws as they were made.
#[derive(Debug, Default)]
pub(super) struct Drawn {
    /// The chains that came through.
    pub(super) chains: Vec<Chain>,
    /// Why the others did not.
    pub(super) failures: Vec<ChainError>,
    /// Wall time of drawing, s.
    pub(super) seconds: f64,
    /// Of it, before this process: the run was interrupted.
    pub(super) seconds_before: f64,
    /// How good the draws are, if they are from a normal approximation.
    pub(super) approximation: Option<Approximation>,
}

/// Draws from a problem's posterior (or its approximation, or its prior), and what they say.
pub struct Fit<'m> {
    pub(super) problem: Problem<'m>,
    pub(super) method: Method,
    pub(super) settings: Settings,
    /// SHA-256 of all that was read, by role.
    pub(super) hashes: BTreeMap<String, String>,
    pub(super) drawn: Drawn,
    /// At most [`KEPT`] draws, evenly spaced over all chains, of each as many.
    pub(super) kept: Vec<Vec<f64>>,
    /// Time of the compilation, s.
    pub(super) compile_seconds: f64,
    /// Time from the beginning to the last draw in this process, and of [`Fit::read`], s.
    pub(super) seconds: f64,
    /// Events whose probability is mapped.
    pub(super) exceed: Vec<Exceedance>,
    /// Whether no measurement is left out in a fit of its own.
    pub(super) weights_only: bool,
    posterior: OnceLock<Posterior>,
    maps: OnceLock<Option<SurfaceMaps>>,
    left_out: OnceLock<Option<LeftOut>>,
    pub(super) questions: OnceLock<Questions>,
    /// Time of a gradient, s: one measurement, so that every file tells the same.
    pub(super) gradient: OnceLock<f64>,
}

impl<'m> Fit<'m> {
    /// # Errors
    /// [`RunError::Draws`].
    pub(super) fn new(
        problem: &Problem<'m>,
        method: Method,
        settings: Settings,
        drawn: Drawn,
    ) -> Result<Self, RunError> {
        let kept = thinned(&drawn.chains, KEPT).map_err(RunError::draws)?;
        Ok(Self {
            problem: problem.clone(),
            method,
            settings,
            hashes: problem.loaded().hashes.clone(),
            drawn,
            kept,
            compile_seconds: 0.0,
            seconds: 0.0,
            exceed: vec![],
            weights_only: false,
            posterior: OnceLock::new(),
            maps: OnceLock::new(),
            left_out: OnceLock::new(),
            questions: OnceLock::new(),
            gradient: OnceLock::new(),
        })
    }

    /// What was fitted.
    pub fn problem(&self) -> &Problem<'m> {
        &self.problem
    }

    /// The model on its data.
    pub fn model(&self) -> &Model {
        self.problem.model()
    }

    /// How the draws were made.
    pub fn method(&self) -> Method {
        self.method
    }

    /// The chains that came through, as draws of the model's unknowns.
    pub fn chains(&self) -> &[Chain] {
        &self.drawn.chains
    }

    /// Why the other chains did not come through.
    pub fn failures(&self) -> &[ChainError] {
        &self.drawn.failures
    }

    /// At most `most` draws of the unknowns, evenly spaced over all chains.
    ///
    /// # Errors
    /// [`RunError::Draws`].
    pub fn thinned(&self, most: usize) -> Result<Vec<Vec<f64>>, RunError> {
        thinned(&self.drawn.chains, most).map_err(RunError::draws)
    }

    /// Mean, sd, quantiles and diagnostics of every parameter, element by element, in its unit.
    pub fn summary(&self) -> &[Row] {
        &self.posterior().rows
    }

    /// Everything that the draws say, in the groups that `ArviZ` knows.
    #[allow(clippy::expect_used, reason = "of draws on a disk it was made with the fit")]
    pub fn posterior(&self) -> &Posterior {
        self.posterior.get_or_init(|| self.reported().expect("no disk is used"))
    }

    /// # Errors
    /// From the disk that the draws are on, or what is reported of them.
    fn reported(&self) -> io::Result<Posterior> {
        let (measurements, seed) = (self.problem.measurements(), self.settings.seed);
        let disk = self.settings.disk.as_deref();
        let mut posterior = Posterior::new(self.model(), measurements, self.chains(), seed, disk)?;
        if !matches!(self.method, Method::Sampled(_)) {
            // Leaving a measurement out is a statement about draws from the posterior.
            posterior.loo = None;
        }
        Ok(posterior)
    }

    /// Makes all that is read from a disk, so that nothing that is asked of the fit later can fail; `watch` is told of
    /// measurements that are left out.
    ///
    /// # Errors
    /// [`RunError::Draws`].
    pub(super) fn read(mut self, watch: &Watch<'_>) -> Result<Self, RunError> {
        let begun = Instant::now();
        // each is made once
        let _ = self.posterior.set(self.reported().map_err(RunError::draws)?);
        self.left_out_watched(watch);
        let _ = self.questions.set(self.ask().map_err(RunError::draws)?);
        self.seconds += begun.elapsed().as_secs_f64();
        Ok(self)
    }

    /// Columns of numbers at draws that one thread reads at least: of those on a disk one at a time is in memory.
    pub(super) fn at_once(&self) -> usize {
        if self.settings.disk.is_some() { usize::MAX } else { 1 }
    }

    /// How well each measurement is predicted from the others; `None` without measurements, and for
    /// draws that are not from the posterior. Where importance weights cannot tell it, the measurement
    /// is left out in a short fit of its own, when this is first asked for.
    pub fn loo(&self) -> Option<&LeaveOneOut> {
        self.left_out().map(|left| &left.loo)
    }

    pub(super) fn left_out(&self) -> Option<&LeftOut> {
        self.left_out_watched(&Watch::default())
    }

    /// The same, told to `watch` as it is made.
    pub(super) fn left_out_watched(&self, watch: &Watch<'_>) -> Option<&LeftOut> {
        let made = || {
            let loo = self.posterior().loo.clone()?;
            let by_weights = self.weights_only;
            Some(if by_weights { LeftOut::by_weights(loo) } else { exact(self, loo, watch) })
        };
        self.left_out.get_or_init(made).as_ref()
    }

    /// Every field and derived quantity over the surface; empty for a model without a surface.
    pub fn maps(&self) -> &[FittedMap] {
        self.surface_maps().map_or(&[], |maps| &maps.maps)
    }

    /// Share of draws at each vertex in which something is outside its declared range; derived
    /// quantities leave these draws out. `None` for a model without a surface.
    pub fn unphysical(&self) -> Option<&[f64]> {
        self.surface_maps().map(|maps| maps.unphysical.as_slice())
    }

    pub(super) fn surface_maps(&self) -> Option<&SurfaceMaps> {
        let made = self.maps.get_or_init(|| {
            let basis = self.problem.loaded().basis()?;
            let truth = &self.problem.loaded().truth;
            Some(SurfaceMaps::new(self.model(), basis, &self.kept, truth, &self.exceed))
        });
        made.as_ref()
    }

    /// Whether the posterior is worth believing, and why.
    pub fn verdict(&self) -> Verdict {
        self.record_of_verdict().verdict
    }

    /// Whether the draws come from the posterior, whatever they say.
    pub fn converged(&self) -> bool {
        is_sampled(&self.record_of_sampling(), self.summary())
    }

    /// Everything needed to repeat the run and to judge it at a glance: `run.json`.
    pub fn record(&self) -> RunRecord {
        self.record_after(0.0)
    }
}

impl std::fmt::Debug for Fit<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut debug = f.debug_struct("Fit");
        debug.field("model", &self.model().name).field("method", &self.method);
        debug.finish_non_exhaustive()
    }
}
