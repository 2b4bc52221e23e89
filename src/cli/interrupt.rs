//! Runs that are interrupted: what identifies a run, Ctrl-C, and how to go on.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use clap::Args;
use sha2::{Digest as _, Sha256};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use super::output::OutputFolder;
use crate::error::Failure;
use crate::report::{RunRecord, Settings};
use crate::store::{Checkpoint, Identity, differences};

/// Part of a run's identity.
const STARTS: &str = "hash of the starting points";
/// Exit code of an interrupted run: that of a program that Ctrl-C ended.
pub(super) const INTERRUPTED: u8 = 130;

/// Options of how a run begins.
#[derive(Debug, Args)]
pub(super) struct BeginArgs {
    /// Go on with the interrupted run in the output folder, to the same numbers as without the
    /// interruption; nothing is done if that run is complete
    #[arg(long, conflicts_with_all = ["optimize", "laplace", "prior"])]
    pub(super) resume: bool,
    /// Start from the results of an earlier run of this model, perhaps on fewer measurements: a
    /// short --warmup is then enough
    #[arg(long, value_name = "DIR", conflicts_with_all = ["optimize", "laplace", "prior"])]
    pub(super) init: Option<PathBuf>,
    /// Least time between two savings of what --resume goes on from; they never take more than 1 %
    /// of a run
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0, conflicts_with_all = ["optimize", "laplace", "prior"])]
    checkpoint_every: f64,
}

impl BeginArgs {
    /// Least time between two savings.
    pub(super) fn every(&self) -> Result<Duration, Failure> {
        let seconds = self.checkpoint_every;
        Duration::try_from_secs_f64(seconds).map_err(|_| {
            Failure::usage(format_args!(
                "--checkpoint-every: expected seconds, 0 or more, got {seconds}\nhelp: 2 is the default"
            ))
        })
    }
}

/// Where an output folder holds its unfinished run.
fn folder(out: &OutputFolder) -> PathBuf {
    out.file("checkpoint")
}

/// What a run's draws depend on. Threads are not in it.
pub(super) fn identity(
    version: &str,
    seed: u64,
    settings: &Settings,
    hashes: &std::collections::BTreeMap<String, String>,
) -> Identity {
    let Settings { sampler, chains, warmup, draws, target_accept, metric } = settings;
    let mut identity = Identity::from([
        ("eplat's version".into(), version.into()),
        ("seed".into(), seed.to_string()),
        ("sampler".into(), sampler.clone()),
        ("chains".into(), chains.to_string()),
        ("warmup".into(), warmup.to_string()),
        ("draws".into(), draws.to_string()),
        ("target-accept".into(), target_accept.to_string()),
        ("metric".into(), metric.clone()),
    ]);
    let hashed = hashes.iter().map(|(role, hash)| (format!("hash of the {role}"), hash.clone()));
    identity.extend(hashed);
    identity
}

/// The checkpoint of a run that begins, or with `resume` goes on; `None` if it is complete already.
///
/// The chains' `starts` are part of what it is: another build of eplat may have others.
pub(super) fn open(
    out: &OutputFolder,
    identity: Identity,
    starts: &[Vec<f64>],
    resume: bool,
    every: Duration,
) -> Result<Option<Checkpoint>, Failure> {
    let folder = folder(out);
    let record = out.file("run.json");
    if resume && Checkpoint::identity(&folder)?.is_none() && record.exists() {
        is_same(out, &RunRecord::read(&record)?, &identity)?;
        return Ok(None);
    }
    let mut identity = identity;
    identity.insert(STARTS.into(), hash_of(starts));
    if !resume {
        return Ok(Some(Checkpoint::begin(&folder, &identity, every)?));
    }
    if let Some(there) = Checkpoint::identity(&folder)?
        && differences(&there, &identity).len() > 1
    {
        // they follow from what else differs, which tells more
        identity.remove(STARTS);
        identity.extend(there.get(STARTS).map(|hash| (STARTS.to_owned(), hash.clone())));
    }
    let checkpoint = Checkpoint::resume(&folder, &identity, every)?;
    let seconds = checkpoint.seconds_before();
    eprintln!("resume {}: {seconds:.1} s of sampling are done", folder.display());
    Ok(Some(checkpoint))
}

fn hash_of(starts: &[Vec<f64>]) -> String {
    let mut hasher = Sha256::new();
    for x in starts.iter().flatten() {
        hasher.update(x.to_le_bytes());
    }
    format!("{:x}", hasher.finalize())
}

/// Complains if the complete run in `out` is another one.
fn is_same(out: &OutputFolder, record: &RunRecord, here: &Identity) -> Result<(), Failure> {
    let there = identity(&record.version, record.seed, &record.settings, &record.hashes);
    let differences = differences(&there, here);
    if differences.is_empty() {
        return Ok(());
    }
    Err(Failure::new(format_args!(
        "the run in {} is complete, and another one: {}\nhelp: leave out --resume to replace it, or name another folder with --out",
        out.path().display(),
        differences.join("; ")
    )))
}

/// The flag that the first Ctrl-C or SIGTERM sets; the second ends the program at once. There is one for all
/// that a command does.
pub(super) fn stop_flag() -> Result<Arc<AtomicBool>, Failure> {
    static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    if let Some(stop) = STOP.get() {
        return Ok(Arc::clone(stop));
    }
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        flag::register_conditional_shutdown(signal, INTERRUPTED.into(), Arc::clone(&stop))
            .and_then(|_| flag::register(signal, Arc::clone(&stop)))
            .map_err(|error| Failure::new(format_args!("cannot watch for Ctrl-C: {error}")))?;
    }
    Ok(Arc::clone(STOP.get_or_init(|| stop)))
}

/// What the user is told after Ctrl-C.
pub(super) fn farewell(out: &OutputFolder) {
    eprintln!(
        "interrupted: the run is kept in {}\nhelp: go on with the same command line and --resume",
        folder(out).display()
    );
}
