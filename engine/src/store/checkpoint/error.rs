//! What a kept run is, and why it cannot be gone on with.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::PathBuf;

use crate::store::advice;

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
    /// A file of somebody else's is where states are kept.
    #[error(
        "{} is not of eplat, and a run would replace it\n\
         help: move it away, or name another folder with --out DIR",
        path.display()
    )]
    Foreign {
        /// The file.
        path: PathBuf,
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
    #[error("cannot {action} {}: {source}\nhelp: {}", path.display(), advice(source))]
    Io {
        /// `read`, `write` or `remove`.
        action: &'static str,
        /// What.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
}

/// What differs between two runs, in words.
pub fn differences(there: &Identity, here: &Identity) -> Vec<String> {
    let names: BTreeSet<&String> = there.keys().chain(here.keys()).collect();
    let value = |identity: &Identity, name: &String| {
        identity.get(name).map_or("none".to_owned(), |value| {
            // of a hash the beginning tells
            value.chars().take(16).collect::<String>()
        })
    };
    let differ = names.into_iter().filter(|name| there.get(*name) != here.get(*name));
    differ.map(|n| format!("{n} is {} there, {} here", value(there, n), value(here, n))).collect()
}
