//! Where results that are slow to compute are kept between runs, and under what name.
//!
//! A cache entry is named by a hash of everything it was computed from, so that an entry is either
//! right or absent.  Knows nothing of what is stored.

use sha2::{Digest, Sha256};
use std::env;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// The cache folder: `$EPLAT_CACHE`, else `$XDG_CACHE_HOME/eplat`, else `$HOME/.cache/eplat`.
///
/// `None` when none of the three is set; the folder need not exist yet.
pub fn folder() -> Option<PathBuf> {
    folder_from(|name| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from))
}

fn folder_from(variable: impl Fn(&str) -> Option<PathBuf>) -> Option<PathBuf> {
    variable("EPLAT_CACHE")
        .or_else(|| variable("XDG_CACHE_HOME").map(|base| base.join("eplat")))
        .or_else(|| variable("HOME").map(|home| home.join(".cache").join("eplat")))
}

/// Bytes of entries that are kept; what was not used for longest goes first.
pub const LIMIT: u64 = 4_000_000_000;

/// What was used later than this ago is not swept: a process may just have found it.
const YOUNG: Duration = Duration::from_mins(5);

/// Remembers that an entry is used. Where that cannot be written, it may be swept earlier.
pub fn used(path: &Path) {
    let _ = File::open(path).and_then(|file| file.set_modified(SystemTime::now()));
}

/// Removes the files, in `folder` and its folder `programs`, that were not used for longest, until the others
/// have `limit` bytes at most. What cannot be removed stays: a cache costs no more than room.
pub fn sweep(folder: &Path, limit: u64) {
    let entries = [folder.to_owned(), folder.join("programs")].into_iter().flat_map(fs::read_dir);
    let of = |entry: fs::DirEntry| {
        let found = entry.metadata().ok().filter(fs::Metadata::is_file)?;
        Some((found.modified().ok()?, found.len(), entry.path()))
    };
    let mut files: Vec<(SystemTime, u64, PathBuf)> =
        entries.flatten().filter_map(Result::ok).filter_map(of).collect();
    files.sort();
    let mut total: u64 = files.iter().map(|(_, bytes, _)| bytes).sum();
    for (used, bytes, path) in files {
        let is_young = used.elapsed().map_or(true, |age| age < YOUNG);
        if total <= limit || is_young {
            return;
        }
        if fs::remove_file(path).is_ok() {
            total -= bytes;
        }
    }
}

/// SHA-256 of `parts` as 64 hexadecimal digits.
///
/// Each part is hashed with its length before it: moving bytes from one part to the next changes
/// the key.
pub fn key(parts: &[&[u8]]) -> String {
    let mut hash = Sha256::new();
    for part in parts {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    format!("{:x}", hash.finalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_variable_that_is_set_wins() {
        let all = |name: &str| Some(PathBuf::from(format!("/{name}")));
        assert_eq!(folder_from(all), Some("/EPLAT_CACHE".into()));
        let without_own = |name: &str| if name == "EPLAT_CACHE" { None } else { all(name) };
        assert_eq!(folder_from(without_own), Some("/XDG_CACHE_HOME/eplat".into()));
        let home = |name: &str| if name == "HOME" { all(name) } else { None };
        assert_eq!(folder_from(home), Some("/HOME/.cache/eplat".into()));
        assert_eq!(folder_from(|_| None), None);
    }

    #[test]
    fn what_was_not_used_for_longest_goes_first() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("programs")).unwrap();
        let path = |name: &str| folder.path().join(name);
        for (hours, name) in [(1, "basis-a"), (3, "programs/b"), (2, "basis-c"), (0, "programs/d")]
        {
            fs::write(path(name), [0; 100]).unwrap();
            let age = Duration::from_hours(hours);
            let file = File::options().write(true).open(path(name)).unwrap();
            file.set_modified(SystemTime::now() - age).unwrap();
        }
        let left = || {
            let names = ["basis-a", "programs/b", "basis-c", "programs/d"];
            names.into_iter().filter(|name| path(name).exists()).collect::<Vec<_>>()
        };
        sweep(folder.path(), 400);
        assert_eq!(left().len(), 4);
        sweep(folder.path(), 399);
        assert_eq!(left(), ["basis-a", "basis-c", "programs/d"]);
        used(&path("basis-c"));
        sweep(folder.path(), 250);
        assert_eq!(left(), ["basis-c", "programs/d"]);
        // what was just used stays, however large it is
        sweep(folder.path(), 0);
        assert_eq!(left(), ["basis-c", "programs/d"]);
    }

    #[test]
    fn the_key_depends_on_content_and_on_where_parts_end() {
        // sha256 of eight zero bytes (a length) followed by nothing: printf '\0%.0s' {1..8} | sha256sum
        let empty_part = "af5570f5a1810b7af78caf4bc70a660f0df51e42baf91d4de5b2328de0e83dfc";
        assert_eq!(key(&[b""]), empty_part);
        assert_ne!(key(&[b"ab", b"c"]), key(&[b"a", b"bc"]));
        assert_ne!(key(&[b"ab"]), key(&[b"ab", b""]));
    }
}
