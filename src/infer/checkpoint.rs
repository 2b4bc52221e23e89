//! What an interrupted run goes on from: a folder with one file per chain, each rewritten now and
//! then by its own chain, so that no chain waits for another.
//!
//! ```text
//! identity.json   what is run, as name and value; goes last, so a folder without it is nothing
//! common          what all chains share since their last meeting (blocked sampler)
//! chain-0 …       magic · SHA-256 of the identity · state (postcard) · CRC-32 of all before
//! ```
//! A state holds every number to the bit, so that the rest of the run is what it would have been.
//! Knows nothing of what a state consists of.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use flate2::{Crc, CrcWriter};
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest as _, Sha256};

use crate::atomic::write_file_durably;

/// First bytes of every state; the number changes with the layout of what follows.
const MAGIC: &[u8; 8] = b"eplatCK1";
const DIGEST: usize = 32;
const CRC: usize = 4;
const IDENTITY: &str = "identity.json";
const COMMON: &str = "common";

/// What is run: every setting and input that the draws depend on, by the name a user knows it by.
pub type Identity = BTreeMap<String, String>;

/// Why a run cannot be kept or gone on with.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// There is no interrupted run.
    #[error(
        "no interrupted run in {}\nhelp: leave out --resume to start one, or name its folder with --out",
        folder.display()
    )]
    Nothing {
        /// Where it was looked for.
        folder: PathBuf,
    },
    /// The interrupted run is another one.
    #[error(
        "the interrupted run in {} is another one: {}\n\
         help: repeat its command line with --resume, or delete the folder to give it up",
        folder.display(),
        differences.join("; ")
    )]
    Differs {
        /// The checkpoint.
        folder: PathBuf,
        /// Name, value there, value here.
        differences: Vec<String>,
    },
    /// A new run would destroy an interrupted one.
    #[error(
        "{} holds an interrupted run\n\
         help: go on with it by --resume, write elsewhere with --out DIR, or delete the folder to give it up",
        folder.display()
    )]
    Occupied {
        /// The checkpoint.
        folder: PathBuf,
    },
    /// A file is not whole, or is not of this run.
    #[error(
        "{}: {reason}\nhelp: the run cannot go on from here; delete the folder {} and start anew",
        path.display(),
        path.parent().unwrap_or(path).display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The operating system said no.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// `read`, `write` or `remove`.
        action: &'static str,
        /// What.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
}

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
    /// [`CheckpointError::Io`].
    pub fn begin(
        folder: &Path,
        identity: &Identity,
        every: Duration,
    ) -> Result<Self, CheckpointError> {
        if folder.join(IDENTITY).exists() && files(folder)?.len() > 1 {
            return Err(CheckpointError::Occupied { folder: folder.to_owned() });
        }
        remove(folder)?;
        fs::create_dir_all(folder).map_err(io_error("write", folder))?;
        let path = folder.join(IDENTITY);
        let text = serde_json::to_vec_pretty(identity).map_err(io::Error::from);
        text.and_then(|text| write_file_durably(&path, |file| file.write_all(&text)))
            .map_err(io_error("write", &path))?;
        Ok(Self::new(folder, identity, every))
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
        for name in files(folder)?.into_iter().filter(|name| name != IDENTITY) {
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
        let state = bytes.split_off(MAGIC.len() + DIGEST);
        if bytes[MAGIC.len()..] != self.digest {
            return Err(damaged("the state is of another run"));
        }
        match postcard::take_from_bytes(&state) {
            Ok((seconds, rest)) => Ok((seconds, rest.to_vec())),
            Err(error) => Err(damaged(&error.to_string())),
        }
    }

    /// Takes up the state of `name`, once; `None` if it was not kept.
    ///
    /// # Errors
    /// [`CheckpointError::Damaged`].
    pub(super) fn take<T: DeserializeOwned>(
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
    pub(super) fn take_common<T: DeserializeOwned>(&self) -> Result<Option<T>, CheckpointError> {
        self.take(COMMON)
    }

    /// What all chains share from here on; written with the first of them, if any is.
    pub(super) fn share(&self, state: &impl Serialize) {
        match postcard::to_stdvec(state) {
            Ok(bytes) => *lock(&self.common) = Some(bytes),
            Err(error) => self.fail(&error),
        }
    }

    fn keep(&self, name: &str, state: &impl Serialize) {
        let mut common = lock(&self.common);
        let result = match &*common {
            Some(bytes) => self.write(COMMON, |file| file.write_all(bytes)),
            None => Ok(()),
        };
        *common = None;
        drop(common);
        let written = result.and_then(|()| {
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

/// Keeps one chain now and then: so seldom that keeping costs no more than a hundredth of its time.
pub(super) struct Keeper<'a> {
    checkpoint: Option<&'a Checkpoint>,
    name: String,
    due: Instant,
}

impl<'a> Keeper<'a> {
    /// Time between two savings, in units of the time that one takes.
    const COST: u32 = 100;

    pub(super) fn new(checkpoint: Option<&'a Checkpoint>, chain: usize) -> Self {
        let due = Instant::now() + checkpoint.map_or(Duration::ZERO, |c| c.every);
        Self { checkpoint, name: name_of(chain), due }
    }

    /// Between two transitions: whether it is time to keep the chain, or the chain `stops` here.
    pub(super) fn is_due(&self, stops: bool) -> bool {
        self.checkpoint.is_some() && (stops || Instant::now() >= self.due)
    }

    /// Keeps the chain.
    pub(super) fn keep(&mut self, state: &impl Serialize) {
        let Some(checkpoint) = self.checkpoint else { return };
        let begun = Instant::now();
        checkpoint.keep(&self.name, state);
        self.due = Instant::now() + checkpoint.every.max(Self::COST * begun.elapsed());
    }
}

/// The states of all chains, as far as they were kept.
///
/// # Errors
/// [`CheckpointError::Damaged`].
pub(super) fn take_chains<T: DeserializeOwned>(
    checkpoint: Option<&Checkpoint>,
    chains: usize,
) -> Result<Vec<Option<T>>, CheckpointError> {
    let take = |chain| checkpoint.map_or(Ok(None), |c| c.take(&name_of(chain)));
    (0..chains).map(take).collect()
}

fn name_of(chain: usize) -> String {
    format!("chain-{chain}")
}

/// What differs between two runs, in words.
pub fn differences(there: &Identity, here: &Identity) -> Vec<String> {
    let names: std::collections::BTreeSet<&String> = there.keys().chain(here.keys()).collect();
    let value = |identity: &Identity, name: &String| {
        identity.get(name).map_or("none".to_owned(), |value| {
            // of a hash the beginning tells
            value.chars().take(16).collect::<String>()
        })
    };
    let differ = names.into_iter().filter(|name| there.get(*name) != here.get(*name));
    differ.map(|n| format!("{n} is {} there, {} here", value(there, n), value(here, n))).collect()
}

/// Names of the whole files in a checkpoint, sorted.
fn files(folder: &Path) -> Result<Vec<String>, CheckpointError> {
    let entries = fs::read_dir(folder).map_err(io_error("read", folder))?;
    let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<String> = names.filter(|name| !name.starts_with('.')).collect();
    names.sort();
    Ok(names)
}

/// The identity first: what is left if this is interrupted counts as nothing.
fn remove(folder: &Path) -> Result<(), CheckpointError> {
    let gone = |result: io::Result<()>| match result {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    };
    gone(fs::remove_file(folder.join(IDENTITY)))
        .and_then(|()| gone(fs::remove_dir_all(folder)))
        .map_err(io_error("remove", folder))
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
