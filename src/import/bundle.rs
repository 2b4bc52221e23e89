//! The files of a study: a folder, a zip archive or one file.
//!
//! Knows nothing of what is in them. Every file that is read is noted with its size and hash.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read as _;
use std::path::{Path, PathBuf};

use serde::Serialize;
use sha2::{Digest as _, Sha256};
use zip::ZipArchive;
use zip::result::ZipError;

use super::ImportError;

/// Most files that are looked at.
const MOST_FILES: usize = 500_000;
/// How deep folders may lie in each other.
const DEPTH: usize = 8;
/// What a compressed file, and an archive, may grow by: meshes and lists of points of CARTO grow by 4 to 9, its electrograms by 15.
const GROWTH: u64 = 64;
/// A compressed file may have this size whatever it grows by, bytes.
const SMALL: u64 = 1 << 20;

const HELP: &str = "check the path and its permissions";

/// A file that was read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Source {
    /// Its name within the folder or archive.
    pub name: String,
    /// Its size.
    pub bytes: u64,
    /// SHA-256, hexadecimal.
    pub sha256: String,
}

/// The files of a study.
#[derive(Debug)]
pub(super) struct Bundle {
    path: PathBuf,
    archive: Option<ZipArchive<File>>,
    /// Bytes that all files of the archive together may have.
    most: u64,
    /// Bytes of those that were read.
    total: u64,
    /// Names, with `/` between folders.
    names: Vec<String>,
    /// Which of these a name in lower case is.
    index: BTreeMap<String, usize>,
    /// Size in bytes and SHA-256 of what was read.
    read: BTreeMap<String, (u64, String)>,
}

impl Bundle {
    /// Lists what is at `path`.
    pub(super) fn open(path: &Path) -> Result<Self, ImportError> {
        let read = |reason: std::io::Error| unreadable(path, &reason.to_string(), HELP);
        let is_folder = fs::metadata(path).map_err(read)?.is_dir();
        let mut bundle = Self {
            path: path.into(),
            archive: None,
            most: u64::MAX,
            total: 0,
            names: vec![],
            index: BTreeMap::new(),
            read: BTreeMap::new(),
        };
        if is_folder {
            list(path, "", DEPTH, &mut bundle.names).map_err(read)?;
        } else if has_extension(&path.to_string_lossy(), "zip") {
            let file = File::open(path).map_err(read)?;
            bundle.most = SMALL.max(file.metadata().map_err(read)?.len().saturating_mul(GROWTH));
            let help = "the archive is damaged or of a rare kind; unpack it and give the folder";
            let broken = |e: ZipError| unreadable(path, &e.to_string(), help);
            let archive = ZipArchive::new(file).map_err(broken)?;
            for name in archive.file_names() {
                let name = name.map_err(broken)?;
                if !name.ends_with('/') {
                    bundle.names.push(name.into_owned());
                }
            }
            bundle.archive = Some(archive);
        } else {
            let name = path.file_name().unwrap_or(path.as_os_str());
            bundle.names.push(name.to_string_lossy().into_owned());
        }
        bundle.names.sort();
        let lower = bundle.names.iter().map(|name| name.to_lowercase());
        bundle.index = lower.zip(0..).collect();
        Ok(bundle)
    }

    /// What was given.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it is one file, not a folder or an archive.
    pub(super) fn is_file(&self) -> bool {
        self.archive.is_none() && !self.path.is_dir()
    }

    /// Names of the files, sorted.
    pub(super) fn names(&self) -> &[String] {
        &self.names
    }

    /// Names of files with this extension, upper and lower case alike.
    pub(super) fn with_extension(&self, extension: &str) -> Vec<String> {
        self.names.iter().filter(|name| has_extension(name, extension)).cloned().collect()
    }

    /// The file of this name, upper and lower case alike.
    pub(super) fn find(&self, name: &str) -> Option<String> {
        if self.names.binary_search_by(|own| own.as_str().cmp(name)).is_ok() {
            return Some(name.into());
        }
        self.index.get(&name.to_lowercase()).map(|k| self.names[*k].clone())
    }

    /// A file of [`Bundle::names`].
    pub(super) fn read(&mut self, name: &str) -> Result<Vec<u8>, ImportError> {
        let bytes = self.bytes(name, u64::MAX)?;
        let hash = format!("{:x}", Sha256::digest(&bytes));
        let n = bytes.len() as u64;
        let again = self.read.insert(name.into(), (n, hash)).is_some();
        self.total += if again { 0 } else { n };
        if self.total > self.most {
            let reason = format!("it grows to more than {GROWTH} times its size");
            return Err(unreadable(
                &self.path,
                &reason,
                "no mapping system writes such an archive",
            ));
        }
        Ok(bytes)
    }

    /// The first bytes of a file, at most `n`.
    pub(super) fn head(&mut self, name: &str, n: u64) -> Result<Vec<u8>, ImportError> {
        self.bytes(name, n)
    }

    /// What was read.
    pub(super) fn sources(self) -> Vec<Source> {
        let source = |(name, (bytes, sha256))| Source { name, bytes, sha256 };
        self.read.into_iter().map(source).collect()
    }

    fn bytes(&mut self, name: &str, most: u64) -> Result<Vec<u8>, ImportError> {
        let path = self.path.clone();
        let mut bytes = vec![];
        let Some(archive) = &mut self.archive else {
            let file = if path.is_dir() { path.join(name) } else { path };
            let read = |reason: std::io::Error| unreadable(&file, &reason.to_string(), HELP);
            let open = File::open(&file).map_err(read)?;
            open.take(most).read_to_end(&mut bytes).map_err(read)?;
            return Ok(bytes);
        };
        let within = path.join(name);
        let help = "unpack the archive (with its password, if it has one) and give the folder";
        let entry = archive.by_name(name).map_err(|e| unreadable(&within, &e.to_string(), help))?;
        let limit = SMALL.max(entry.compressed_size().saturating_mul(GROWTH));
        let mut entry = entry.take(most.min(limit + 1));
        let read = |e: std::io::Error| unreadable(&within, &e.to_string(), help);
        entry.read_to_end(&mut bytes).map_err(read)?;
        if bytes.len() as u64 > limit {
            let reason = format!("it grows to more than {GROWTH} times its compressed size");
            return Err(unreadable(&within, &reason, "no mapping system writes such a file"));
        }
        Ok(bytes)
    }
}

/// A file that another reader reads.
pub(super) fn source_of(path: &Path) -> Result<Source, ImportError> {
    let bytes = fs::read(path).map_err(|e| unreadable(path, &e.to_string(), HELP))?;
    let sha256 = format!("{:x}", Sha256::digest(&bytes));
    Ok(Source { name: path.display().to_string(), bytes: bytes.len() as u64, sha256 })
}

/// Whether a file's name ends in this extension, upper and lower case alike.
pub(super) fn has_extension(name: &str, extension: &str) -> bool {
    Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// The folder that a file lies in, with `/` at its end; empty for the outermost.
pub(super) fn folder_of(name: &str) -> &str {
    name.rfind('/').map_or("", |at| &name[..=at])
}

/// The last part of a name.
pub(super) fn base_of(name: &str) -> &str {
    &name[folder_of(name).len()..]
}

fn unreadable(path: &Path, reason: &str, help: &'static str) -> ImportError {
    ImportError::Read { file: path.display().to_string(), reason: reason.into(), help }
}

/// Adds the files below a folder; links to folders are not followed.
fn list(folder: &Path, prefix: &str, depth: usize, names: &mut Vec<String>) -> std::io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        let kind = entry.file_type()?;
        if kind.is_dir() {
            if depth > 0 {
                list(&entry.path(), &format!("{name}/"), depth - 1, names)?;
            }
        } else if kind.is_file() || entry.path().is_file() {
            names.push(name);
        }
        if names.len() > MOST_FILES {
            let reason = format!("more than {MOST_FILES} files; give the study's own folder");
            return Err(std::io::Error::other(reason));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use zip::ZipWriter;
    use zip::write::SimpleFileOptions;

    use super::*;

    fn zip(name: &str, bytes: &[u8]) -> tempfile::NamedTempFile {
        let mut file = tempfile::NamedTempFile::with_suffix(".zip").unwrap();
        let mut writer = ZipWriter::new(&mut file);
        writer.start_file(name, SimpleFileOptions::default()).unwrap();
        writer.write_all(bytes).unwrap();
        writer.finish().unwrap();
        file
    }

    #[test]
    fn files_that_are_small_each_are_not_all_read() {
        let mut file = tempfile::NamedTempFile::with_suffix(".zip").unwrap();
        let mut writer = ZipWriter::new(&mut file);
        let options = SimpleFileOptions::default();
        // 1 kB each, packed
        for i in 0..40 {
            writer.start_file(format!("{i}.txt"), options).unwrap();
            writer.write_all(&vec![0; 1 << 20]).unwrap();
        }
        writer.finish().unwrap();
        let size = fs::metadata(file.path()).unwrap().len();
        let mut bundle = Bundle::open(file.path()).unwrap();
        let names = bundle.names().to_vec();
        let n_read = names.iter().take_while(|name| bundle.read(name).is_ok()).count();
        assert_eq!(n_read as u64, (GROWTH * size) >> 20);
        assert!((1..40).contains(&n_read), "{n_read}");
        // the same file again is no more
        let mut bundle = Bundle::open(file.path()).unwrap();
        assert!((0..40).all(|_| bundle.read("0.txt").is_ok()));
    }

    #[test]
    fn a_folder_and_an_archive_hold_the_same() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("a")).unwrap();
        fs::write(folder.path().join("a/b.TXT"), "hello").unwrap();
        let archive = zip("a/b.TXT", b"hello");
        for path in [folder.path(), archive.path()] {
            let mut bundle = Bundle::open(path).unwrap();
            assert_eq!(bundle.names(), ["a/b.TXT"]);
            assert_eq!(bundle.with_extension("txt"), ["a/b.TXT"]);
            assert_eq!(bundle.find("A/B.txt").as_deref(), Some("a/b.TXT"));
            assert_eq!(bundle.read("a/b.TXT").unwrap(), b"hello");
            assert_eq!(bundle.head("a/b.TXT", 2).unwrap(), b"he");
            let sources = bundle.sources();
            assert_eq!((sources[0].name.as_str(), sources[0].bytes), ("a/b.TXT", 5));
            assert!(sources[0].sha256.starts_with("2cf24dba"));
        }
        assert_eq!((folder_of("a/b.TXT"), base_of("a/b.TXT"), folder_of("c")), ("a/", "b.TXT", ""));
    }

    #[test]
    fn a_bomb_is_refused() {
        let bomb = zip("big.txt", &vec![b' '; 8 << 20]);
        let error = Bundle::open(bomb.path()).unwrap().read("big.txt").unwrap_err().to_string();
        assert!(error.contains("more than 64 times its compressed size"), "{error}");
    }

    #[test]
    fn what_is_not_there_or_no_archive_is_said() {
        let error = Bundle::open(Path::new("no/such")).unwrap_err().to_string();
        assert!(error.starts_with("cannot read no/such: "), "{error}");
        let file = tempfile::NamedTempFile::with_suffix(".zip").unwrap();
        fs::write(file.path(), "no archive").unwrap();
        let error = Bundle::open(file.path()).unwrap_err().to_string();
        assert!(error.contains("unpack it and give the folder"), "{error}");
    }
}
