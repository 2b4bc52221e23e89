//! What an interrupted run goes on from: a folder with one file per chain, each rewritten now and
//! then by its own chain, so that no chain waits for another.
//!
//! ```text
//! identity.json   what is run, as name and value; goes last, so a folder without it is nothing
//! common          what all chains share since their last meeting (blocked sampler)
//! chain-0 …       magic · SHA-256 of the identity · state (postcard) · CRC-32 of all before
//! draws-0 …       magic · draws of the chain, added to as they are made: its state has the last of them, and a
//!                 CRC-32 of each block of the others; there once they fill a block
//! ```
//! A state holds every number to the bit, so that the rest of the run is what it would have been.
//! Knows nothing of what a state consists of.

mod error;
mod keeper;

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Read as _, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use flate2::{Crc, CrcWriter};
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest as _, Sha256};

use super::atomic::TEMPORARY;
use crate::store::{Spool, write_file_durably};

pub use error::{CheckpointError, Identity, differences};
pub(crate) use keeper::take_chains;
pub use keeper::{Keeper, take_chain};

/// First bytes of every file of states and draws; the number changes with the layout of what follows.
const MAGIC: &[u8; 8] = b"eplatCK3";
const DIGEST: usize = 32;
const CRC: usize = 4;
const IDENTITY: &str = "identity.json";
const COMMON: &str = "common";
const CHAIN: &str = "chain-";
const DRAWS: &str = "draws-";
/// What files of every layout begin with.
const FAMILY: &[u8] = b"eplatCK";

/// Where a run is kept while it samples.
#[derive(Debug)]
pub struct Checkpoint {
    folder: PathBuf,
    digest: [u8; DIGEST],
    every: Duration,
    begun: Instant,
    /// Wall time before the interruption, s.
    seconds_before: f64,
    /// States read and not yet taken up, by file.
    kept: Mutex<BTreeMap<String, Vec<u8>>>,
    /// What chains share, until a chain that depends on it is written.
    common: Mutex<Option<Vec<u8>>>,
    failure: OnceLock<String>,
}

impl Checkpoint {
    /// For a run that begins; each chain is kept at most once in `every`.
    ///
    /// # Errors
    /// [`CheckpointError::Occupied`] where an interrupted run has chains to lose;
    /// [`CheckpointError::Foreign`]; [`CheckpointError::Io`].
    pub fn begin(
        folder: &Path,
        identity: &Identity,
        every: Duration,
    ) -> Result<Self, CheckpointError> {
        Self::require_free(folder)?;
        if let Some(path) = foreign(folder).map_err(io_error("read", folder))? {
            return Err(CheckpointError::Foreign { path });
        }
        remove(folder)?;
        fs::create_dir_all(folder).map_err(io_error("write", folder))?;
        let path = folder.join(IDENTITY);
        let text = serde_json::to_vec_pretty(identity).map_err(io::Error::from);
        text.and_then(|text| write_file_durably(&path, |file| file.write_all(&text)))
            .map_err(io_error("write", &path))?;
        Ok(Self::new(folder, identity, every))
    }

    /// Refuses a folder with the chains of an interrupted run.
    ///
    /// # Errors
    /// [`CheckpointError::Occupied`], [`CheckpointError::Io`].
    pub fn require_free(folder: &Path) -> Result<(), CheckpointError> {
        if folder.join(IDENTITY).exists() && !states(folder)?.is_empty() {
            return Err(CheckpointError::Occupied { folder: folder.to_owned() });
        }
        Ok(())
    }

    /// For a run that goes on where it was interrupted.
    ///
    /// # Errors
    /// [`CheckpointError::Nothing`], [`CheckpointError::Differs`], [`CheckpointError::Damaged`],
    /// [`CheckpointError::Io`].
    pub fn resume(
        folder: &Path,
        identity: &Identity,
        every: Duration,
    ) -> Result<Self, CheckpointError> {
        let Some(there) = Self::identity(folder)? else {
            return Err(CheckpointError::Nothing { folder: folder.to_owned() });
        };
        let differences = differences(&there, identity);
        if !differences.is_empty() {
            return Err(CheckpointError::Differs { folder: folder.to_owned(), differences });
        }
        let mut new = Self::new(folder, identity, every);
        let mut kept = BTreeMap::new();
        for name in states(folder)? {
            let (seconds, state) = new.read(&name)?;
            new.seconds_before = new.seconds_before.max(seconds);
            kept.insert(name, state);
        }
        new.kept = Mutex::new(kept);
        Ok(new)
    }

    fn new(folder: &Path, identity: &Identity, every: Duration) -> Self {
        let text = format!("{identity:?}");
        Self {
            folder: folder.to_owned(),
            digest: Sha256::digest(text.as_bytes()).into(),
            every,
            begun: Instant::now(),
            seconds_before: 0.0,
            kept: Mutex::default(),
            common: Mutex::default(),
            failure: OnceLock::new(),
        }
    }

    /// What the interrupted run in `folder` is; `None` if there is none.
    ///
    /// # Errors
    /// [`CheckpointError::Damaged`], [`CheckpointError::Io`].
    pub fn identity(folder: &Path) -> Result<Option<Identity>, CheckpointError> {
        let path = folder.join(IDENTITY);
        if !path.exists() {
            return Ok(None);
        }
        let text = fs::read(&path).map_err(io_error("read", &path))?;
        let damaged =
            |e: serde_json::Error| CheckpointError::Damaged { path, reason: e.to_string() };
        serde_json::from_slice(&text).map(Some).map_err(damaged)
    }

    /// Whether chains go on from what was kept.
    pub fn has_states(&self) -> bool {
        !lock(&self.kept).is_empty()
    }

    /// Wall time before the interruption, s.
    pub fn seconds_before(&self) -> f64 {
        self.seconds_before
    }

    /// Why a state could not be written, if one could not.
    pub fn failure(&self) -> Option<&str> {
        self.failure.get().map(String::as_str)
    }

    /// Forgets the run, once its results are written.
    ///
    /// # Errors
    /// [`CheckpointError::Io`].
    pub fn remove(self) -> Result<(), CheckpointError> {
        remove(&self.folder)
    }

    /// Forgets the run that is kept in `folder`, if there is one.
    ///
    /// # Errors
    /// [`CheckpointError::Io`].
    pub fn forget(folder: &Path) -> Result<(), CheckpointError> {
        remove(folder)
    }

    /// Seconds and state of a file, checked.
    fn read(&self, name: &str) -> Result<(f64, Vec<u8>), CheckpointError> {
        let path = self.folder.join(name);
        let mut bytes = fs::read(&path).map_err(io_error("read", &path))?;
        let damaged = |reason: &str| CheckpointError::Damaged { path, reason: reason.into() };
        if bytes.len() < MAGIC.len() + DIGEST + CRC || !bytes.starts_with(MAGIC) {
            return Err(damaged("expected the state of a chain, got something else or part of it"));
        }
        let crc = bytes.split_off(bytes.len() - CRC);
        if checksum(&bytes) != crc[..] {
            return Err(damaged("the file is not whole: its checksum does not fit"));
        }
        let (head, state) = bytes.split_at(MAGIC.len() + DIGEST);
        if head[MAGIC.len()..] != self.digest {
            return Err(damaged("the state is of another run"));
        }
        let (seconds, n_left) = match postcard::take_from_bytes(state) {
            Ok((seconds, rest)) => (seconds, rest.len()),
            Err(error) => return Err(damaged(&error.to_string())),
        };
        // in place: it may be large
        bytes.drain(..bytes.len() - n_left);
        Ok((seconds, bytes))
    }

    /// Takes up the state of `name`, once; `None` if it was not kept.
    ///
    /// # Errors
    /// [`CheckpointError::Damaged`].
    pub(crate) fn take<T: DeserializeOwned>(
        &self,
        name: &str,
    ) -> Result<Option<T>, CheckpointError> {
        let Some(state) = lock(&self.kept).remove(name) else { return Ok(None) };
        postcard::from_bytes(&state).map(Some).map_err(|error| CheckpointError::Damaged {
            path: self.folder.join(name),
            reason: error.to_string(),
        })
    }

    /// Takes up what the chains shared.
    ///
    /// # Errors
    /// [`CheckpointError::Damaged`].
    pub(crate) fn take_common<T: DeserializeOwned>(&self) -> Result<Option<T>, CheckpointError> {
        self.take(COMMON)
    }

    /// That a state, that of a chain or what the chains share, cannot be one of this run. States have no
    /// seal against forgery, so whoever takes one up asks whether it fits.
    pub fn misfit(&self, chain: Option<usize>) -> CheckpointError {
        let name = chain.map_or(COMMON.into(), keeper::name_of);
        let reason = "the state is none that this run can come to".into();
        CheckpointError::Damaged { path: self.folder.join(name), reason }
    }

    /// Where draws of `width` numbers go, of chain number `chain`.
    pub(crate) fn draws(&self, chain: usize, width: usize) -> Spool {
        Spool::kept(width, self.path_of_draws(chain), MAGIC)
    }

    /// Takes up the draws that a chain's state tells of.
    ///
    /// # Errors
    /// [`CheckpointError::Damaged`] where they are not there, [`CheckpointError::Io`].
    pub(crate) fn take_draws(
        &self,
        chain: usize,
        draws: &mut Spool,
        kept: Spool,
    ) -> Result<(), CheckpointError> {
        let path = self.path_of_draws(chain);
        if draws.take_up(kept).map_err(io_error("read", &path))? {
            return Ok(());
        }
        let reason = format!("it does not hold the draws that {} tells of", keeper::name_of(chain));
        Err(CheckpointError::Damaged { path, reason })
    }

    /// The file with the draws of a chain.
    pub(crate) fn path_of_draws(&self, chain: usize) -> PathBuf {
        self.folder.join(format!("{DRAWS}{chain}"))
    }

    /// What all chains share from here on; written with the first of them, if any is.
    pub(crate) fn share(&self, state: &impl Serialize) {
        match postcard::to_stdvec(state) {
            Ok(bytes) => *lock(&self.common) = Some(bytes),
            Err(error) => self.fail(&error),
        }
    }

    /// Keeps a state, once the `draws` that it tells of are on the disk.
    fn keep(&self, name: &str, state: &impl Serialize, draws: Option<&Spool>) {
        let mut common = lock(&self.common);
        let result = match &*common {
            Some(bytes) => self.write(COMMON, |file| file.write_all(bytes)),
            None => Ok(()),
        };
        *common = None;
        drop(common);
        let synced = result.and_then(|()| draws.map_or(Ok(()), Spool::sync));
        let written = synced.and_then(|()| {
            self.write(name, |file| {
                postcard::to_io(state, file).map(drop).map_err(io::Error::other)
            })
        });
        if let Err(error) = written {
            self.fail(&error);
        }
    }

    fn write(
        &self,
        name: &str,
        fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> io::Result<()> {
        let seconds = self.seconds_before + self.begun.elapsed().as_secs_f64();
        write_file_durably(&self.folder.join(name), |file| {
            let mut file = CrcWriter::new(file);
            file.write_all(MAGIC)?;
            file.write_all(&self.digest)?;
            file.write_all(&seconds.to_le_bytes())?;
            fill(&mut file)?;
            let crc = file.crc().sum().to_le_bytes();
            file.into_inner().write_all(&crc)
        })
    }

    fn fail(&self, error: &dyn std::fmt::Display) {
        // the first failure is the one to report
        let _ = self.failure.set(format!("{}: {error}", self.folder.display()));
    }
}

/// Names of the states in a checkpoint, sorted.
fn states(folder: &Path) -> Result<Vec<String>, CheckpointError> {
    let names = names(folder).map_err(io_error("read", folder))?;
    Ok(names.into_iter().filter(|name| name == COMMON || name.starts_with(CHAIN)).collect())
}

/// Whether a file has the name of a state, or of draws.
fn is_named(name: &str) -> bool {
    name == COMMON || name.starts_with(CHAIN) || name.starts_with(DRAWS)
}

/// Whether a file begins as states and draws do.
fn is_ours(path: &Path) -> io::Result<bool> {
    if !path.is_file() {
        return Ok(false);
    }
    // no more of it than that: it may be large
    let mut begin = vec![];
    fs::File::open(path)?.take(FAMILY.len() as u64).read_to_end(&mut begin)?;
    Ok(begin == FAMILY)
}

/// A file that has the name of a state or of draws and is none: somebody else's.
fn foreign(folder: &Path) -> io::Result<Option<PathBuf>> {
    if !folder.exists() {
        return Ok(None);
    }
    for name in names(folder)? {
        let path = folder.join(&name);
        if is_named(&name) && !is_ours(&path)? {
            return Ok(Some(path));
        }
        if name == IDENTITY && serde_json::from_slice::<Identity>(&fs::read(&path)?).is_err() {
            return Ok(Some(path));
        }
    }
    Ok(None)
}

fn names(folder: &Path) -> io::Result<Vec<String>> {
    let entries = fs::read_dir(folder)?.flatten();
    let mut names: Vec<String> =
        entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.sort();
    Ok(names)
}

/// Removes what a checkpoint consists of, and what a killed process left half-written there; the
/// identity first: what is left if this is interrupted counts as nothing. The folder goes if nobody
/// else put anything there.
fn remove(folder: &Path) -> Result<(), CheckpointError> {
    let goes = |name: &String| {
        let is_ours = || is_named(name) && is_ours(&folder.join(name)).unwrap_or(false);
        name == IDENTITY || name.starts_with(TEMPORARY) || is_ours()
    };
    let remove = || {
        if !folder.exists() {
            return Ok(());
        }
        let mut ours: Vec<String> = names(folder)?.into_iter().filter(goes).collect();
        ours.sort_by_key(|name| name != IDENTITY);
        ours.iter().try_for_each(|name| fs::remove_file(folder.join(name)))?;
        match fs::remove_dir(folder) {
            Err(error) if error.kind() == io::ErrorKind::DirectoryNotEmpty => Ok(()),
            done => done,
        }
    };
    remove().map_err(io_error("remove", folder))
}

fn io_error(
    action: &'static str,
    path: &Path,
) -> impl FnOnce(io::Error) -> CheckpointError + use<> {
    let path = path.to_owned();
    move |source| CheckpointError::Io { action, path, source }
}

fn checksum(bytes: &[u8]) -> [u8; CRC] {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum().to_le_bytes()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
