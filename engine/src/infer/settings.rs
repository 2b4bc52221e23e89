//! How to sample: the settings of a run.

use super::density::LogDensity;
use super::error::InferError;
use serde::{Deserialize, Serialize};
use std::panic::resume_unwind;
use std::path::PathBuf;
use std::{io, thread};

/// The shape of the inverse mass matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum MetricKind {
    /// A scale per coordinate, and directions in which the draws spread more or less than these tell.
    #[default]
    LowRank,
    /// One scale per coordinate, by Fisher divergence.
    Diagonal,
}

/// How to sample.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Number of chains.
    pub chains: usize,
    /// The most warm-up transitions per chain, not kept. NUTS chains that agree earlier go on to their
    /// draws.
    pub warmup: usize,
    /// Draws kept per chain.
    pub draws: usize,
    /// After so many draws of each chain, and after each further so many, [`Progress::is_enough`](super::Progress::is_enough)
    /// is asked; `draws` is then the most.
    pub enough_after: Option<usize>,
    /// Mean acceptance that the step size is tuned to, in (0, 1). If `None`, NUTS takes 0.8 and
    /// the blocked sampler 0.95.
    pub target_accept: Option<f64>,
    /// Most doublings per transition, 1 to 20.
    pub max_depth: u32,
    /// Seed of all random streams.
    pub seed: u64,
    /// Number of threads; 0 means one per core.  Does not change any number.
    pub threads: usize,
    /// The shape of the metric.
    pub metric: MetricKind,
    /// Draws of a similar density, each `(dim)`. The warm-up begins with what they tell about
    /// scales, so that it can be short. If empty, it begins with no such knowledge.
    pub earlier: Vec<Vec<f64>>,
    /// Folder on whose disk draws go in blocks of 2 MB, in files without names; without one they stay in memory. Where a
    /// run is kept ([`Progress::checkpoint`](super::Progress::checkpoint)) they are in its folder. Does not change any
    /// number.
    pub disk: Option<PathBuf>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            chains: 4,
            warmup: 1000,
            draws: 1000,
            enough_after: None,
            target_accept: None,
            max_depth: 10,
            seed: 1,
            threads: 0,
            metric: MetricKind::default(),
            earlier: vec![],
            disk: None,
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
        let round = self.enough_after.unwrap_or(self.draws);
        least("enough_after", round, 1, "50 draws of each chain make a round")?;
        let help = "1000 is the default; step size and metric are learnt in warm-up";
        least("warmup", self.warmup, Self::LEAST_WARMUP, help)?;
        if let Some(got) = self.target_accept
            && !(got > 0.0 && got < 1.0)
        {
            return Err(InferError::TargetAccept { got });
        }
        if !(1..=20).contains(&self.max_depth) {
            return Err(InferError::MaxDepth { got: self.max_depth });
        }
        Ok(())
    }
}

impl Settings {
    /// Does `work` on a pool of as many threads as the settings say.
    ///
    /// A thread of another pool that calls this only waits. If it were to install the work itself, it would
    /// meanwhile begin more work of its own pool, with a pool for that, and so on: all fits of a study would begin before
    /// the first of them is done.
    pub(crate) fn on_threads<T: Send>(
        &self,
        work: impl FnOnce() -> T + Send,
    ) -> Result<T, InferError> {
        let threads = self.threads;
        let refused = |reason| InferError::Threads { threads, reason };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|error| refused(error.to_string()))?;
        thread::scope(|scope| {
            let working = thread::Builder::new().spawn_scoped(scope, || pool.install(work));
            let done = working.map_err(|error| refused(error.to_string()))?.join();
            Ok(done.unwrap_or_else(|panic| resume_unwind(panic)))
        })
    }

    /// What the disk that draws go to said.
    pub(super) fn disk_error(&self, source: io::Error) -> InferError {
        InferError::Disk { folder: self.disk.clone().unwrap_or_default(), source }
    }
}

/// Checks that the settings make sense, and that there is one start of the right length per chain.
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
