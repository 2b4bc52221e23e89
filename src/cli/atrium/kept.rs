//! What an atrium simulation is, and where an interrupted one is kept.

use std::fs;
use std::time::Duration;

use serde_json::Value;

use super::AtriumArgs;
use super::files::RECORD;
use crate::error::Failure;
use crate::report::FieldDraws;
use crate::run::OutputFolder;
use crate::run::hash_file as hash;
use crate::store::{Checkpoint, Identity, differences};

impl AtriumArgs {
    /// All that the results depend on: every option, by its name, and the files that are read.
    pub(super) fn identity(&self) -> Result<Identity, Failure> {
        let mut identity =
            Identity::from([("eplat's version".into(), env!("CARGO_PKG_VERSION").to_owned())]);
        if let Value::Object(options) = serde_json::to_value(self)? {
            let given = options
                .into_iter()
                .map(|(name, value)| (name.replace('_', "-"), value.to_string()));
            identity.extend(given);
        }
        if let Some(file) = self.tissue.file() {
            identity.insert("hash of the surface".into(), hash(&file)?);
        }
        if let (Some(run), Some(_)) = (&self.tissue.run, self.draws) {
            identity.insert("hash of the draws".into(), hash(&run.join(FieldDraws::FILE))?);
        }
        Ok(identity)
    }

    /// The checkpoint of a simulation that begins, or with --resume goes on; `None` if it is complete.
    pub(super) fn open(
        &self,
        out: &OutputFolder,
        identity: &Identity,
    ) -> Result<Option<Checkpoint>, Failure> {
        let seconds = self.checkpoint_every;
        let every = Duration::try_from_secs_f64(seconds).map_err(|_| {
            Failure::usage(format_args!(
                "--checkpoint-every: expected seconds, 0 or more, got {seconds}\nhelp: 10 is the default"
            ))
        })?;
        let folder = out.file("checkpoint");
        if !self.resume {
            return Ok(Some(Checkpoint::begin(&folder, identity, every)?));
        }
        if Checkpoint::identity(&folder)?.is_none() && out.file(RECORD).exists() {
            is_same(out, identity)?;
            return Ok(None);
        }
        let checkpoint = Checkpoint::resume(&folder, identity, every)?;
        let seconds = checkpoint.seconds_before();
        eprintln!("resume {}: {seconds:.1} s of it are done", folder.display());
        Ok(Some(checkpoint))
    }
}

/// Complains if the complete simulation in `out` is another one.
fn is_same(out: &OutputFolder, here: &Identity) -> Result<(), Failure> {
    let path = out.file(RECORD);
    let bytes = fs::read(&path).map_err(|error| Failure::io("read", &path, &error))?;
    let record: Value = serde_json::from_slice(&bytes)?;
    let there: Identity = serde_json::from_value(record["settings"].clone())?;
    let differences = differences(&there, here);
    if differences.is_empty() {
        return Ok(());
    }
    Err(Failure::new(format_args!(
        "the simulation in {} is complete, and another one: {}\nhelp: leave out --resume to replace it, or name another folder with --out",
        out.path().display(),
        differences.join("; ")
    )))
}
