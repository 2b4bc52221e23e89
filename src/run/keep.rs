//! Runs that are kept while they sample: what identifies one, and how it goes on.

use std::collections::BTreeMap;
use std::time::Duration;

use sha2::{Digest as _, Sha256};

use super::{Event, OutputFolder, RunError, Watch};
use crate::report::{RunRecord, SettingsRecord};
use crate::store::{Checkpoint, Identity, differences};

/// Part of a run's identity.
const STARTS: &str = "hash of the starting points";

/// How a run is kept in its output folder, to go on after an interruption.
#[derive(Clone, Copy, Debug)]
pub struct Keep {
    /// Goes on with the interrupted run in the folder, to the same numbers as without the interruption.
    pub resume: bool,
    /// Least time between two savings of a chain.
    pub every: Duration,
    /// What the run goes on from stays when it is complete: it is a part of something longer.
    pub stays: bool,
}

impl Default for Keep {
    fn default() -> Self {
        Self { resume: false, every: Duration::from_secs(2), stays: false }
    }
}

impl Keep {
    /// For a folder in which the run may have begun, or even be complete: it goes on if so.
    ///
    /// # Errors
    /// [`RunError::Checkpoint`].
    pub fn going_on(out: &OutputFolder) -> Result<Self, RunError> {
        let has_begun = Checkpoint::identity(&out.checkpoint())?.is_some();
        Ok(Self { resume: has_begun || out.file("run.json").exists(), ..Self::default() })
    }
}

/// What a run's draws depend on. Threads are not in it.
pub(super) fn identity(
    version: &str,
    seed: u64,
    settings: &SettingsRecord,
    hashes: &BTreeMap<String, String>,
) -> Identity {
    let SettingsRecord { sampler, chains, warmup, draws, most_draws, target_accept, metric } =
        settings;
    let draws = match most_draws {
        Some(most) => format!("until there are enough, {most} at most"),
        None => draws.to_string(),
    };
    let mut identity = Identity::from([
        ("eplat's version".into(), version.into()),
        ("seed".into(), seed.to_string()),
        ("sampler".into(), sampler.clone()),
        ("chains".into(), chains.to_string()),
        ("warmup".into(), warmup.to_string()),
        ("draws".into(), draws),
        ("target-accept".into(), target_accept.map_or("none".into(), |target| target.to_string())),
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
    mut identity: Identity,
    starts: &[Vec<f64>],
    keep: &Keep,
    watch: &Watch<'_>,
) -> Result<Option<Checkpoint>, RunError> {
    let (folder, record) = (out.checkpoint(), out.file("run.json"));
    if keep.resume && Checkpoint::identity(&folder)?.is_none() && record.exists() {
        is_same(out, &RunRecord::read(&record)?, &identity)?;
        // it may have been killed while it forgot what it went on from
        Checkpoint::forget(&folder)?;
        return Ok(None);
    }
    identity.insert(STARTS.into(), hash_of(starts));
    if !keep.resume {
        return Ok(Some(Checkpoint::begin(&folder, &identity, keep.every)?));
    }
    if let Some(there) = Checkpoint::identity(&folder)?
        && differences(&there, &identity).len() > 1
    {
        // they follow from what else differs, which tells more
        identity.remove(STARTS);
        identity.extend(there.get(STARTS).map(|hash| (STARTS.to_owned(), hash.clone())));
    }
    let checkpoint = Checkpoint::resume(&folder, &identity, keep.every)?;
    watch.tell(&Event::Resumed { folder: &folder, seconds: checkpoint.seconds_before() });
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
fn is_same(out: &OutputFolder, record: &RunRecord, here: &Identity) -> Result<(), RunError> {
    let there = identity(&record.version, record.seed, &record.settings, &record.hashes);
    let differences = differences(&there, here);
    if differences.is_empty() {
        return Ok(());
    }
    Err(RunError::AnotherRun { folder: out.path().to_owned(), differences })
}
