//! A simulation with an output folder: its checkpoint, its files, and how it is gone on with.

use std::path::Path;
use std::time::{Duration, Instant};

use super::drive::{Drive, Event, Watch};
use super::{Atrium, AtriumError, AtriumRecord, Beat, series};
use crate::mesh::{self, Units, write_vtp};
use crate::store::{Checkpoint, Identity, differences, seals};

/// Where a simulation is kept while it runs, in its output folder.
pub(super) const CHECKPOINT: &str = "checkpoint";
/// The maps, in the output folder.
const BEAT: &str = "beat.vtp";
/// All that a simulation leaves beside its record.
const FILES: [&str; 3] = [BEAT, "voltage.pvd", "voltage"];

/// How a simulation begins.
#[derive(Clone, Copy, Debug)]
pub struct Begin {
    /// Whether it goes on with one that was interrupted.
    pub resume: Resume,
    /// Least time between two savings of its state. They never take more than 1 % of the time.
    pub every: Duration,
}

/// Whether a simulation goes on with one that was interrupted in its output folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resume {
    /// It begins anew; one that was interrupted there is an error.
    Never,
    /// It goes on; nothing to go on with is an error.
    Always,
    /// It goes on if there is something to go on with.
    IfBegun,
}

/// How a simulation ended.
#[derive(Debug)]
pub enum Ended {
    /// It was complete before.
    Before,
    /// It came to its end now.
    Now(Box<Beat>),
    /// It was stopped; the folder holds what it goes on from.
    Interrupted,
}

impl Atrium {
    /// Simulates and writes `beat.vtp`, the series of V if it is asked for, and `simulation.json`, which
    /// comes last. A simulation that is stopped or killed goes on from its checkpoint in `folder`.
    ///
    /// # Errors
    /// [`AtriumError`]; [`AtriumError::Other`] and [`AtriumError::Checkpoint`] for a folder that holds
    /// another simulation.
    pub fn simulate_into(
        &self,
        folder: &Path,
        begin: Begin,
        watch: Watch<'_>,
    ) -> Result<Ended, AtriumError> {
        let done = Done {
            record: AtriumRecord::FILE,
            files: &FILES,
            settings: |folder| Ok(AtriumRecord::read(folder)?.settings),
        };
        let Some(checkpoint) = done.begin(folder, &self.identity, begin, watch)? else {
            series::forget(&folder.join(CHECKPOINT))?;
            return Ok(Ended::Before);
        };
        let begun = Instant::now();
        let drive = Drive { checkpoint: Some(&checkpoint), watch };
        let found = self.found(&drive, Some(folder))?;
        if let Some(reason) = checkpoint.failure() {
            (watch.on_event)(Event::NotKept(reason));
        }
        let Some((maps, summary)) = found else { return Ok(Ended::Interrupted) };
        let seconds = checkpoint.seconds_before() + begun.elapsed().as_secs_f64();
        let mut beat = self.beat(maps, summary, seconds);
        let data: Vec<(&str, &[f64])> =
            beat.maps.iter().map(|(name, values)| (name.as_str(), &values[..])).collect();
        AtriumRecord::remove(folder)?;
        write_vtp(&folder.join(BEAT), self.mesh(), &data)?;
        let there = FILES.into_iter().filter(|name| folder.join(name).exists());
        beat.record.files = seals(folder, there).map_err(AtriumError::io("read", folder))?;
        beat.record.write(folder)?;
        checkpoint.remove()?;
        series::forget(&folder.join(CHECKPOINT))?;
        Ok(Ended::Now(Box::new(beat)))
    }
}

/// What is in an output folder when all is done.
pub(super) struct Done {
    /// The record.
    pub(super) record: &'static str,
    /// All that is left beside it.
    pub(super) files: &'static [&'static str],
    /// What the results depend on, from the record in a folder.
    pub(super) settings: fn(&Path) -> Result<Identity, AtriumError>,
}

impl Done {
    /// The checkpoint of simulations that begin or go on in `folder`; `None` if they are complete.
    pub(super) fn begin(
        &self,
        folder: &Path,
        identity: &Identity,
        begin: Begin,
        watch: Watch<'_>,
    ) -> Result<Option<Checkpoint>, AtriumError> {
        let path = folder.join(CHECKPOINT);
        let is_interrupted = Checkpoint::identity(&path)?.is_some();
        let is_complete = folder.join(self.record).exists();
        let resumes = match begin.resume {
            Resume::Never => false,
            Resume::Always => true,
            Resume::IfBegun => is_interrupted || is_complete,
        };
        if !resumes {
            self.refuse_foreign(folder)?;
            return Ok(Some(Checkpoint::begin(&path, identity, begin.every)?));
        }
        if is_interrupted || !is_complete {
            return resumed(&path, identity, begin, watch).map(Some);
        }
        let differences = differences(&(self.settings)(folder)?, identity);
        if differences.is_empty() {
            // it may have been killed while it forgot what it went on from
            Checkpoint::forget(&path)?;
            return Ok(None);
        }
        Err(AtriumError::Other { folder: folder.to_owned(), differences })
    }

    /// Refuses a folder in which files have the names of these and there is no record.
    pub(super) fn refuse_foreign(&self, folder: &Path) -> Result<(), AtriumError> {
        if (self.settings)(folder).is_ok() {
            return Ok(());
        }
        let mut names = self.files.iter().chain([&self.record]).map(|name| folder.join(name));
        match names.find(|path| path.exists()) {
            Some(path) => Err(AtriumError::Foreign { path }),
            None => Ok(()),
        }
    }
}

/// The checkpoint at `path`, of simulations that go on.
pub(super) fn resumed(
    path: &Path,
    identity: &Identity,
    begin: Begin,
    watch: Watch<'_>,
) -> Result<Checkpoint, AtriumError> {
    let checkpoint = Checkpoint::resume(path, identity, begin.every)?;
    let seconds = checkpoint.seconds_before();
    (watch.on_event)(Event::Resumed { folder: path, seconds });
    Ok(checkpoint)
}

impl Beat {
    /// Reads what a simulation left in its output folder; the maps in the order of their names.
    ///
    /// # Errors
    /// [`AtriumError::Mesh`], [`AtriumError::Io`], [`AtriumError::Record`].
    pub fn read(folder: &Path) -> Result<Self, AtriumError> {
        let record = AtriumRecord::read(folder)?;
        let surface = mesh::read(&folder.join(BEAT), Units::Mm)?;
        Ok(Self { maps: surface.scalars().into_iter().collect(), record })
    }
}
