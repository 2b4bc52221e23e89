//! A loop that is kept in its folder while it works, to go on after an interruption to the same files.
//!
//! The searches on simulated data, which take longest, leave one number each: these are kept. Each fit keeps its
//! chains as any run does, until the whole loop is done. Everything else is computed again.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use sha2::{Digest as _, Sha256};

use super::{FITS, Loop, LoopError};
use crate::criticism::Remembered;
use crate::run::{OutputFolder, RunError};
use crate::store::{Checkpoint, CheckpointError, Identity, Keeper, take_chain};

/// What searches came to, by round and search.
type Bests = BTreeMap<(usize, usize), f64>;

/// The searches on simulated data that are done.
pub(super) struct KeptSearches {
    checkpoint: Checkpoint,
    done: Mutex<Bests>,
}

impl KeptSearches {
    /// Those of a loop that begins in `out`, or goes on.
    ///
    /// # Errors
    /// An interrupted loop or fit that is in the way, is not there, or is another one.
    pub(super) fn open(of: &Loop<'_>, out: &OutputFolder) -> Result<Self, LoopError> {
        let (folder, identity) = (out.checkpoint(), identity(of));
        let opened = if of.settings.resume {
            Checkpoint::resume(&folder, &identity, Duration::ZERO)
        } else {
            // the loop's own first: that is the one to go on with
            let fits = FITS.iter().map(|fit| out.file(fit).join("checkpoint"));
            let mut all = [folder.clone()].into_iter().chain(fits);
            all.try_for_each(|own| Checkpoint::require_free(&own))
                .and_then(|()| Checkpoint::begin(&folder, &identity, Duration::ZERO))
        };
        let read = |checkpoint: Checkpoint| -> Result<Self, CheckpointError> {
            let done = take_chain::<Bests>(&checkpoint, 0)?.unwrap_or_default();
            Ok(Self { checkpoint, done: Mutex::new(done) })
        };
        opened.and_then(read).map_err(|error| RunError::from(error).into())
    }
}

impl Remembered for KeptSearches {
    fn recall(&self, round: usize, search: usize) -> Option<f64> {
        self.done.lock().unwrap_or_else(PoisonError::into_inner).get(&(round, search)).copied()
    }

    fn keep(&self, round: usize, search: usize, best: f64) {
        let mut done = self.done.lock().unwrap_or_else(PoisonError::into_inner);
        done.insert((round, search), best);
        Keeper::new(Some(&self.checkpoint), 0).keep(&*done);
    }
}

/// What a loop's numbers depend on. Threads are not in it.
fn identity(of: &Loop<'_>) -> Identity {
    let (table, search) = (&of.loaded.measurements, &of.settings.search);
    let held_out = of.joint.as_ref().map(|joint| joint.held_out().to_csv());
    let hash = |text: String| format!("{:x}", Sha256::digest(text.as_bytes()));
    let roles = table.columns().iter().map(|name| format!("{name} {:?}", table.role(name)));
    let mut identity = Identity::from([
        ("eplat's version".into(), env!("CARGO_PKG_VERSION").into()),
        ("seed".into(), search.seed.to_string()),
        ("nulls".into(), search.nulls.to_string()),
        ("rounds".into(), search.rounds.to_string()),
        ("hash of the roles of columns".into(), hash(roles.collect())),
        ("hash of the held-out table".into(), held_out.map_or("none".into(), hash)),
    ]);
    let hashes = of.loaded.hashes.iter();
    identity.extend(hashes.map(|(role, hash)| (format!("hash of the {role}"), hash.clone())));
    identity
}

/// Forgets what a loop kept, once all its files are written.
///
/// # Errors
/// [`RunError::Checkpoint`].
pub(super) fn forget(out: &OutputFolder) -> Result<(), RunError> {
    for fit in FITS {
        Checkpoint::forget(&out.file(fit).join("checkpoint"))?;
    }
    Ok(Checkpoint::forget(&out.checkpoint())?)
}
