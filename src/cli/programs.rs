//! The compiled models in the cache: which program belongs to a model's text, and whether it still does.
//!
//! A model may consist of several files (`mod`, `include!`, …), and only the compiler knows of which. So a record
//! beside the programs names every file that it read, with a hash of each. A program is used where all of them
//! are as they were, and the program is whole. Knows nothing of how a model is compiled.
//!
//! ```text
//! programs/KEY.json   hash of the program; files and variables that the compiler read
//! programs/HASH       the program, named after its own hash
//! ```

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use crate::store::{cache, write_file_durably};

/// The program in the folder in which it is compiled.
pub(super) const PROGRAM: &str = "program";
/// What the compiler read, in that folder.
pub(super) const READ: &str = "read.d";

/// What a program was compiled from.
#[derive(Debug, Serialize, Deserialize)]
struct Record {
    /// Hash of the program.
    program: String,
    /// Hash of each file that the compiler read, by its path.
    files: BTreeMap<String, String>,
    /// Variables of the environment that the compiler read (`env!`), as they were.
    variables: BTreeMap<String, Option<String>>,
}

/// The program that was kept under `key`, if it is whole and what it was compiled from is unchanged.
pub(super) fn find(cache: &Path, key: &str) -> Option<PathBuf> {
    let record: Record = serde_json::from_slice(&fs::read(record_of(cache, key)).ok()?).ok()?;
    let is_same =
        |(path, hash): (&String, &String)| hash_of(Path::new(path)).is_ok_and(|h| h == *hash);
    let program = program_of(cache, &record.program)?;
    let is_fresh = record.files.iter().all(is_same)
        && record.variables.iter().all(|(name, value)| variable(name) == *value)
        && hash_of(&program).is_ok_and(|hash| hash == record.program);
    is_fresh.then(|| {
        cache::used(&program);
        program
    })
}

/// Keeps the program `built` under `key`, with what it was compiled from; gives its place. Both are on the disk
/// before they have their names.
pub(super) fn keep(
    cache: &Path,
    key: &str,
    built: &Path,
    sources: &Sources,
) -> io::Result<PathBuf> {
    fs::create_dir_all(cache.join("programs"))?;
    let files = sources.files.iter().map(|path| Ok((path.clone(), hash_of(Path::new(path))?)));
    let variables = sources.variables.iter().map(|name| (name.clone(), variable(name)));
    let record = Record {
        program: hash_of(built)?,
        files: files.collect::<io::Result<_>>()?,
        variables: variables.collect(),
    };
    let program = program_of(cache, &record.program).ok_or(io::ErrorKind::InvalidData)?;
    File::open(built)?.sync_all()?;
    fs::rename(built, &program)?;
    let text = serde_json::to_vec_pretty(&record)?;
    write_file_durably(&record_of(cache, key), |file| file.write_all(&text))?;
    Ok(program)
}

fn record_of(cache: &Path, key: &str) -> PathBuf {
    cache.join("programs").join(format!("{}.json", &key[..32]))
}

/// `None` for what is no hash.
fn program_of(cache: &Path, hash: &str) -> Option<PathBuf> {
    Some(cache.join("programs").join(hash.get(..32)?))
}

fn hash_of(path: &Path) -> io::Result<String> {
    Ok(cache::key(&[&fs::read(path)?]))
}

fn variable(name: &str) -> Option<String> {
    std::env::var_os(name).map(|value| value.to_string_lossy().into_owned())
}

/// What the compiler says that it read.
#[derive(Debug, Default)]
pub(super) struct Sources {
    /// Paths of files.
    pub(super) files: Vec<String>,
    /// Names of variables of the environment.
    variables: Vec<String>,
}

impl Sources {
    /// Reads what `--emit=dep-info` leaves, `target: file file …` with blanks as `\ `. What is in the folders
    /// `ours` is left out.
    pub(super) fn read(dep_info: &Path, ours: &[&Path]) -> io::Result<Self> {
        let mut sources = Self::default();
        for line in fs::read_to_string(dep_info)?.lines() {
            if let Some(variable) = line.strip_prefix("# env-dep:") {
                let name = variable.split_once('=').map_or(variable, |(name, _)| name);
                sources.variables.push(name.to_owned());
            } else if let Some((_, files)) = line.split_once(": ") {
                let files = files.replace("\\ ", "\0");
                let files = files.split(' ').filter(|file| !file.is_empty());
                let files = files.map(|file| file.replace('\0', " "));
                let is_theirs =
                    |file: &String| !ours.iter().any(|ours| Path::new(file).starts_with(ours));
                sources.files.extend(files.filter(is_theirs));
            }
        }
        sources.files.sort();
        sources.files.dedup();
        Ok(sources)
    }

    /// A file that was written to since `begun`, or is gone.
    pub(super) fn changed_since(&self, begun: SystemTime) -> Option<&str> {
        let is_changed =
            |path: &&String| fs::metadata(path).map_or(true, |found| last_change(&found) >= begun);
        self.files.iter().find(is_changed).map(String::as_str)
    }
}

/// When the file was last written to or moved there, whatever date it claims to have.
#[cfg(unix)]
fn last_change(found: &fs::Metadata) -> SystemTime {
    use std::os::unix::fs::MetadataExt as _;
    let since = std::time::Duration::new(found.ctime().max(0) as u64, found.ctime_nsec() as u32);
    SystemTime::UNIX_EPOCH + since
}

#[cfg(not(unix))]
fn last_change(found: &fs::Metadata) -> SystemTime {
    // a system without such a date has no cached programs either
    found.modified().unwrap_or_else(|_| SystemTime::now())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn what_the_compiler_read_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("read.d");
        let text = "program: /ours/main.rs /a\\ b/m.rs /a\\ b/h.in\n\n/a\\ b/m.rs:\n/a\\ b/h.in:\n\n\
                    # env-dep:DOSE=3\n# env-dep:NONE\n";
        fs::write(&path, text).unwrap();
        let sources = Sources::read(&path, &[Path::new("/ours")]).unwrap();
        assert_eq!(sources.files, ["/a b/h.in", "/a b/m.rs"]);
        assert_eq!(sources.variables, ["DOSE", "NONE"]);
    }

    #[test]
    fn a_program_is_found_while_it_and_its_files_are_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let [cache, built, source] =
            ["cache", "built", "m.rs"].map(|name| folder.path().join(name));
        let key = cache::key(&[b"a text"]);
        let keep = || {
            fs::write(&built, "a program").unwrap();
            fs::write(&source, "a text").unwrap();
            let files = vec![source.display().to_string()];
            keep(&cache, &key, &built, &Sources { files, variables: vec![] }).unwrap()
        };
        let program = keep();
        assert_eq!(find(&cache, &key).as_ref(), Some(&program));
        assert_eq!(find(&cache, &cache::key(&[b"another text"])), None);
        for (path, text) in [(&source, "an edit"), (&program, "a prog"), (&program, "")] {
            fs::write(path, text).unwrap();
            assert_eq!(find(&cache, &key), None, "{text}");
            keep();
            assert!(find(&cache, &key).is_some());
        }
        fs::write(record_of(&cache, &key), "{\"program\": \"é\"").unwrap();
        assert_eq!(find(&cache, &key), None);
    }

    #[test]
    fn a_file_that_is_written_later_has_changed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.rs");
        fs::write(&path, "").unwrap();
        let sources = Sources { files: vec![path.display().to_string()], variables: vec![] };
        std::thread::sleep(std::time::Duration::from_millis(50));
        let begun = SystemTime::now();
        assert_eq!(sources.changed_since(begun), None);
        std::thread::sleep(std::time::Duration::from_millis(50));
        fs::write(&path, "").unwrap();
        assert!(sources.changed_since(begun).is_some());
        fs::remove_file(&path).unwrap();
        assert!(sources.changed_since(begun).is_some());
    }
}
