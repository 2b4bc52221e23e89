//! A folder that one process alone writes to, and what killed processes left there.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

use super::atomic::sweep;

/// The file that is locked; it holds the number of the process.
const LOCK: &str = ".eplat-lock";

/// A folder that no other process writes to as long as this lives. The operating system gives it up when the
/// process ends, however it ends.
#[derive(Debug)]
pub struct FolderLock {
    path: PathBuf,
    _file: File,
    /// The folders that were made for it, the innermost first.
    made: Vec<PathBuf>,
}

/// Why a folder is not to be written to.
#[derive(Debug)]
pub enum LockError {
    /// Another process writes to it; its number, if it can be told.
    Held(Option<u32>),
    /// From the operating system.
    Io(io::Error),
}

impl From<io::Error> for LockError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl FolderLock {
    /// Locks the folder, which is made if it is not there; and removes temporary files that a killed process left
    /// there. Where a file system has no locks, nothing is refused.
    ///
    /// # Errors
    /// [`LockError::Held`], [`LockError::Io`].
    pub fn take(folder: &Path) -> Result<Self, LockError> {
        let missing =
            folder.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists());
        let made: Vec<PathBuf> = missing.map(Path::to_owned).collect();
        fs::create_dir_all(folder)?;
        let path = folder.join(LOCK);
        let file = locked(&path).inspect_err(|_| remove_empty(&made))?;
        // nobody else writes here now
        sweep(folder, |_| true);
        Ok(Self { path, _file: file, made })
    }
}

impl Drop for FolderLock {
    /// The file goes before the lock does, and folders that were made for nothing. Whether they can be removed
    /// changes no result.
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
        remove_empty(&self.made);
    }
}

fn remove_empty(folders: &[PathBuf]) {
    for folder in folders {
        let _ = fs::remove_dir(folder);
    }
}

fn locked(path: &Path) -> Result<File, LockError> {
    loop {
        let mut file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut text = String::new();
                // a number that cannot be read is not told
                let _ = file.read_to_string(&mut text);
                return Err(LockError::Held(text.trim().parse().ok()));
            }
            Err(TryLockError::Error(_)) => return Ok(file),
        }
        if is_at(&file, path) {
            file.set_len(0)?;
            writeln!(file, "{}", std::process::id())?;
            return Ok(file);
        }
        // its owner removed it between our opening and locking it
    }
}

/// Whether the open file is still the one of this name.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let of = |found: fs::Metadata| (found.dev(), found.ino());
    file.metadata().is_ok_and(|own| fs::metadata(path).is_ok_and(|there| of(there) == of(own)))
}

#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_process_at_a_time_and_nothing_is_left() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("a/b");
        let lock = FolderLock::take(&folder).unwrap();
        match FolderLock::take(&folder) {
            Err(LockError::Held(Some(process))) => assert_eq!(process, std::process::id()),
            other => panic!("{other:?}"),
        }
        drop(lock);
        assert!(!place.path().join("a").exists());
        // one that a killed process left locks nobody out
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join(LOCK), "1\n").unwrap();
        fs::write(folder.join(".eplat-tmp-abc"), "half").unwrap();
        fs::create_dir(folder.join(".eplat-tmp-def")).unwrap();
        fs::write(folder.join(".tmpmine"), "a user's").unwrap();
        drop(FolderLock::take(&folder).unwrap());
        let left: Vec<_> = fs::read_dir(&folder).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(left, [".tmpmine"]);
    }
}
