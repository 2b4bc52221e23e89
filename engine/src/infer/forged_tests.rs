//! Checkpoints with a right checksum whose contents are not right: refused by the name of the file, or gone on
//! with. Nothing panics, and nothing runs for ever.

use super::*;
use crate::infer::blocked::Blocked;
use crate::infer::integrated::Integrated;
use crate::infer::nuts::Nuts;
use crate::infer::start::jittered_starts;
use crate::manifold::Basis;
use crate::model::{Declare, Model, Sampler};
use crate::prelude::*;
use crate::store::test_forgeries::{changes_length, forgeries};
use crate::store::{CheckpointError, Identity, take_chain};
use crate::table::Measurements;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

model! {
    /// Integrated: normal about a field.
    model Numbers;
    param noise ~ HalfNormal(1.0);
    field f(x) = m + alpha * gp(Matern52(rho), K = 6) where {
        m ~ Normal(1.0, 2.0); alpha ~ HalfNormal(2.0); rho ~ InvGamma(3.0, 60.0);
    }
    observe number(x): Number ~ Normal(f(x), noise);
}

model! {
    /// Blocked, with an unknown beside the field.
    model Events;
    param slope ~ Normal(0.0, 0.5);
    field f(x) in -2.0..2.0 = m + alpha * gp(Rbf(rho), K = 6) where {
        m ~ Normal(-1.0, 0.5); alpha ~ InvGamma(3.0, 2.0); rho ~ LogNormal(3.5, 0.5);
    }
    let rate(x) = f(x) + slope;
    observe number(x): Count ~ PoissonLog(rate(x));
}

fn basis() -> Basis {
    let entry = |i: usize| if i.is_multiple_of(6) { 0.1 } else { (i as f64 * 0.7).sin() * 0.2 };
    Basis {
        eigenvalues: (0..6).map(|k| 4e-4 * f64::from(k)).collect(),
        eigenfunctions: (0..30 * 6).map(entry).collect(),
    }
}

fn table() -> Measurements {
    let cells = |line: String| line.split(',').map(String::from).collect::<Vec<_>>();
    let rows = (0..6).map(|i| cells(format!("number,{},{}", 4 * i, i % 4))).collect();
    let header = cells("protocol,vertex,value".into());
    let mut table = Measurements::from_cells("test", header, rows).unwrap();
    table.place_at_indices(30).unwrap();
    table
}

/// Stops all chains when a transition has been asked for so many times.
struct Cut {
    checkpoint: Checkpoint,
    left: AtomicUsize,
}

impl Progress for Cut {
    fn report(&self, _: &ChainProgress) {}
    fn should_stop(&self) -> bool {
        let one_less = |n: usize| n.checked_sub(1);
        self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, one_less).is_err()
    }
    fn checkpoint(&self) -> Option<&Checkpoint> {
        Some(&self.checkpoint)
    }
}

struct Job {
    model: Model,
    sampler: Sampler,
    starts: Vec<Vec<f64>>,
    settings: Settings,
    folder: PathBuf,
}

/// Long enough that nothing is kept but at the end.
const SELDOM: Duration = Duration::from_hours(1);

impl Job {
    fn new(model: Model, sampler: Sampler, place: &Path) -> Self {
        let settings =
            Settings { chains: 2, warmup: 20, draws: 6, threads: 1, ..Settings::default() };
        let starts = jittered_starts(&model, &model.initial(), 2, 1).unwrap();
        Self { model, sampler, starts, settings, folder: place.join("checkpoint") }
    }

    fn sample(&self, checkpoint: Checkpoint, left: usize) -> Result<Vec<ChainResult>, InferError> {
        let cut = Cut { checkpoint, left: left.into() };
        self.sampler.sample(&self.model, &self.starts, &self.settings, &cut)
    }

    fn resume(&self) -> Checkpoint {
        Checkpoint::resume(&self.folder, &Identity::new(), SELDOM).unwrap()
    }

    /// The checkpoint of a run that was interrupted after so many transitions, with all its files.
    fn interrupted(&self, transitions: usize) -> Vec<(PathBuf, Vec<u8>)> {
        Checkpoint::forget(&self.folder).unwrap();
        let checkpoint = Checkpoint::begin(&self.folder, &Identity::new(), SELDOM).unwrap();
        self.sample(checkpoint, transitions).unwrap();
        let files = std::fs::read_dir(&self.folder).unwrap().map(|entry| entry.unwrap().path());
        files.map(|path| (path.clone(), std::fs::read(path).unwrap())).collect()
    }

    /// Goes on from a state that is not right; whether it was refused, by the name of `file`.
    fn is_refused(&self, file: &str, what: &str) -> bool {
        let sampled = catch_unwind(AssertUnwindSafe(|| self.sample(self.resume(), usize::MAX)));
        match sampled.unwrap_or_else(|_| panic!("{file}, {what}: a panic")) {
            Ok(_) => false,
            Err(InferError::Checkpoint(CheckpointError::Damaged { path, .. })) => {
                // of chains that are not together, either may be the one
                assert!(path.ends_with(file) || what.contains("meetings"), "{what}: {path:?}");
                true
            }
            Err(error) => panic!("{file}, {what}: {error}"),
        }
    }
}

/// How many forgeries were tried, and how many were refused.
#[derive(Debug, Default)]
struct Tally {
    tried: usize,
    refused: usize,
}

/// Forges what a chain kept, and what the chains shared, in all ways.
fn forge<C: Together>(job: &Job, transitions: usize) -> Tally {
    let mut count = Tally::default();
    let files = job.interrupted(transitions);
    let restore = || {
        for (path, bytes) in &files {
            std::fs::write(path, bytes).unwrap();
        }
    };
    let mut tell = |file: &str, what: &str| {
        count.tried += 1;
        let refused = job.is_refused(file, what);
        count.refused += usize::from(refused);
        // a list of another length is never what it was; of the stages of a warm-up some may be left out
        let is_wrong = changes_length(what) && !what.contains(".stages");
        assert!(refused || !is_wrong, "{file}, {what}: accepted");
        restore();
    };
    let chains = [0, 1].map(|chain| job.folder.join(format!("chain-{chain}")));
    let kept = chains.iter().position(|path| path.exists()).unwrap();
    let own: Kept<C> = take_chain(&job.resume(), kept).unwrap().unwrap();
    forgeries(&serde_json::to_value(&own).unwrap(), "", &mut |what, forged| {
        let Ok(forged) = serde_json::from_value::<Kept<C>>(forged) else { return };
        Keeper::new(Some(&job.resume()), kept).keep(&forged);
        tell(&format!("chain-{kept}"), what);
    });
    let Some(met) = job.resume().take_common::<Met<C>>().unwrap() else { return count };
    forgeries(&serde_json::to_value(&met).unwrap(), "", &mut |what, forged| {
        let Ok(forged) = serde_json::from_value::<Met<C>>(forged) else { return };
        let checkpoint = job.resume();
        checkpoint.share(&forged);
        Keeper::new(Some(&checkpoint), kept).keep(&own);
        // so that what is shared is taken up
        for path in chains.iter().filter(|path| path.exists()) {
            std::fs::remove_file(path).unwrap();
        }
        tell("common", what);
    });
    count
}

/// After how many transitions a run is interrupted: in the first round of the warm-up, after a meeting, and while sampling.
const CUTS: [usize; 3] = [8, 29, 46];

fn check<C: Together>(model: &dyn Declare, sampler: Sampler, transitions: usize) {
    let place = tempfile::tempdir().unwrap();
    let model = Model::new(model, Some(&basis()), &table()).unwrap();
    let job = Job::new(model, sampler, place.path());
    let Tally { tried, refused } = forge::<C>(&job, transitions);
    assert!(tried > 60 && 5 * refused > tried, "{refused} of {tried} refused");
}

#[test]
fn of_nuts() {
    for cut in CUTS {
        check::<Nuts<'_>>(&Events, Sampler::Nuts, cut);
    }
}

// one test for each place: together they take minutes

#[test]
fn of_the_blocked_sampler_in_its_first_round() {
    check::<Blocked<'_>>(&Events, Sampler::Blocked, CUTS[0]);
}

#[test]
fn of_the_blocked_sampler_after_a_meeting() {
    check::<Blocked<'_>>(&Events, Sampler::Blocked, CUTS[1]);
}

#[test]
fn of_the_blocked_sampler_while_sampling() {
    check::<Blocked<'_>>(&Events, Sampler::Blocked, CUTS[2]);
}

#[test]
fn of_the_integrated_sampler() {
    for cut in CUTS {
        check::<Integrated<'_>>(&Numbers, Sampler::Integrated, cut);
    }
}
