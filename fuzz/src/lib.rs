//! Fuzzing of all that eplat reads: a target for each reader ([`NAMES`]), with what must hold of what it accepts.
//!
//! On the stable compiler, mutations of valid files, ten CPU minutes a target (a third number gives other mutations):
//!
//! ```sh
//! cargo run --release --manifest-path fuzz/Cargo.toml -- all 600
//! ```
//!
//! Each mutation is written to a file: with `TMPDIR` on a disk in memory (`/dev/shm`) it goes some fifteen times faster.
//!
//! With coverage guidance, which needs a nightly compiler and `cargo install cargo-fuzz`:
//!
//! ```sh
//! cargo run --release --manifest-path fuzz/Cargo.toml -- corpus fuzz/corpus
//! cargo +nightly fuzz run --features libfuzzer ply -- -dict=fuzz/words.dict -max_total_time=600 -timeout=2
//! ```
//!
//! `tests/mutated.rs` does the first for about a minute in all, in every run of the tests.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a panic is what is looked for")]

#[allow(dead_code, reason = "tests/mutated.rs counts mutations, this crate has a time for them")]
mod mutation;
mod readers;
mod seeds;

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use peak_alloc::PeakAlloc;
use readers::{TARGETS, target};
use tempfile::TempDir;

#[global_allocator]
static COUNTED: PeakAlloc = PeakAlloc;

fn counted(read: &mut dyn FnMut()) -> usize {
    COUNTED.reset_peak_usage();
    let before = COUNTED.current_usage();
    read();
    COUNTED.peak_usage().saturating_sub(before)
}

/// Names of the targets.
pub const NAMES: [&str; TARGETS.len()] = {
    let mut names = [""; TARGETS.len()];
    let mut i = 0;
    while i < names.len() {
        names[i] = TARGETS[i].name;
        i += 1;
    }
    names
};

/// The seeds of a target in a folder of their own, with what they hold.
type Workshop = (TempDir, Vec<(PathBuf, Vec<u8>)>);

thread_local! {
    static WORKSHOPS: RefCell<BTreeMap<&'static str, Workshop>> = RefCell::default();
}

fn workshop(name: &str) -> Workshop {
    let folder = tempfile::tempdir().unwrap();
    let seeds = (target(name).seeds)(folder.path()).into_iter();
    let seeds = seeds.map(|path| (path.clone(), std::fs::read(path).unwrap())).collect();
    (folder, seeds)
}

/// Reads `bytes` in the place of a seed of a target: the first byte tells of which, the others are the file.
pub fn feed(name: &str, bytes: &[u8]) {
    let Some((which, bytes)) = bytes.split_first() else { return };
    WORKSHOPS.with_borrow_mut(|workshops| {
        let (_, seeds) = workshops.entry(target(name).name).or_insert_with(|| workshop(name));
        let (path, whole) = &seeds[usize::from(*which) % seeds.len()];
        std::fs::write(path, bytes).unwrap();
        (target(name).read)(path);
        std::fs::write(path, whole).unwrap();
    });
}

/// Writes the seeds of every target as [`feed`] takes them, to begin from: `FOLDER/TARGET/NUMBER`.
pub fn write_corpus(folder: &Path) {
    for name in NAMES {
        let to = folder.join(name);
        std::fs::create_dir_all(&to).unwrap();
        for (i, (_, bytes)) in workshop(name).1.into_iter().enumerate() {
            let which = u8::try_from(i).unwrap();
            std::fs::write(to.join(i.to_string()), [vec![which], bytes].concat()).unwrap();
        }
    }
}

/// Reads mutations of a target's seeds for so much CPU time; how many. Another `seed` gives other mutations.
///
/// # Panics
/// Where a reader panics, accepts what should have been refused, takes more than two CPU seconds or more memory than it
/// may.
pub fn mutate(name: &str, time: Duration, seed: u64) -> usize {
    mutation::survives(target(name), mutation::Effort::Time(time), seed, counted)
}
