//! Files and folders that appear whole or not at all: written under a temporary name beside their
//! final place, then renamed.
//!
//! Knows nothing of what is in them.

use std::collections::BTreeSet;
use std::error::Error;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use tempfile::NamedTempFile;

/// How the names of unfinished files and folders begin. What a killed process left of them is removed by the next
/// one that writes to the folder.
pub const TEMPORARY: &str = ".eplat-tmp-";

/// A file that gets its name only when it is whole; dropped before that, it leaves no trace.
#[derive(Debug)]
pub struct NewFile {
    path: PathBuf,
    temporary: NamedTempFile,
}

impl NewFile {
    /// Makes the temporary file beside `path`; called before long work, it finds out early that the
    /// folder cannot be written.
    ///
    /// # Errors
    /// A folder that is missing or cannot be written; a `path` that is itself a folder.
    pub fn create(path: &Path) -> io::Result<Self> {
        if path.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        sweep_stale(folder_of(path));
        let mut builder = tempfile::Builder::new();
        builder.prefix(TEMPORARY);
        // A temporary file is private; the one it becomes gets the permissions of any new file.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        // The error's own text would name the temporary file.
        let temporary = builder.tempfile_in(folder_of(path)).map_err(|e| plain(&e))?;
        hold(temporary.as_file());
        Ok(Self { path: path.to_owned(), temporary })
    }

    /// The file to write to.
    pub fn file(&mut self) -> &mut File {
        self.temporary.as_file_mut()
    }

    /// Where it will be.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives the file its name; one that was there before is replaced.
    ///
    /// # Errors
    /// From the operating system.
    pub fn finish(self) -> io::Result<()> {
        self.temporary.persist(&self.path).map_err(|e| plain(&e.error))?;
        Ok(())
    }
}

/// Writes a file by `fill`, under a temporary name that becomes `path` once everything is written.
///
/// # Errors
/// From the operating system or `fill`; then a file that was at `path` before is still there,
/// untouched.
pub fn write_file(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
) -> io::Result<()> {
    let mut new = NewFile::create(path)?;
    let mut writer = BufWriter::new(new.file());
    fill(&mut writer)?;
    writer.flush()?;
    drop(writer);
    new.finish()
}

/// As [`write_file`], and on the disk before it has its name: a loss of power leaves the new file
/// or the old one.
///
/// # Errors
/// Those of [`write_file`].
pub fn write_file_durably(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
) -> io::Result<()> {
    write_file(path, |file| {
        fill(file)?;
        file.flush()?;
        file.get_ref().sync_all()
    })
}

/// How the name begins under which a folder lies aside while another takes its place.
const ASIDE: &str = ".eplat-old-";

/// Makes a folder by `fill`, under a temporary name that becomes `path` once everything is written.
///
/// A folder that was at `path` changes places with the new one, so that one of them is there at every moment. On a file
/// system that cannot do that it lies aside for a moment: whoever was killed then is helped by [`put_back`].
///
/// # Errors
/// From the operating system or `fill`; then a folder that was at `path` before is still there.
pub fn write_folder(path: &Path, fill: impl FnOnce(&Path) -> io::Result<()>) -> io::Result<()> {
    write_folder_by(path, fill, exchange)
}

fn write_folder_by(
    path: &Path,
    fill: impl FnOnce(&Path) -> io::Result<()>,
    exchange: impl FnOnce(&Path, &Path) -> io::Result<()>,
) -> io::Result<()> {
    put_back(path)?;
    sweep_stale(folder_of(path));
    let workshop = tempfile::Builder::new().prefix(TEMPORARY).tempdir_in(folder_of(path))?;
    let _held = File::open(workshop.path()).inspect(hold);
    let new = workshop.path().join("new");
    fs::create_dir(&new)?;
    fill(&new)?;
    if !path.exists() {
        return fs::rename(&new, path);
    }
    if exchange(&new, path).is_ok() {
        // the old one goes with the workshop
        return Ok(());
    }
    let old = aside(path)?;
    fs::rename(path, &old)?;
    fs::rename(&new, path).inspect_err(|_| {
        // The first error is the one to report; this move only undoes the one above.
        let _ = fs::rename(&old, path);
    })?;
    fs::remove_dir_all(old)
}

/// Puts a folder back that a killed process left aside while it replaced it with another.
///
/// # Errors
/// From the operating system.
pub fn put_back(path: &Path) -> io::Result<()> {
    let Ok(old) = aside(path) else { return Ok(()) };
    match (old.is_dir(), path.exists()) {
        (true, false) => fs::rename(old, path),
        // the other had taken its place
        (true, true) => fs::remove_dir_all(old),
        (false, _) => Ok(()),
    }
}

fn aside(path: &Path) -> io::Result<PathBuf> {
    let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
    let mut aside = OsString::from(ASIDE);
    aside.push(name);
    Ok(folder_of(path).join(aside))
}

/// Two files or folders change places at once.
///
/// # Errors
/// The file system cannot do that; from the operating system.
#[cfg(any(target_os = "linux", target_vendor = "apple"))]
fn exchange(one: &Path, other: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, one, CWD, other, RenameFlags::EXCHANGE)?)
}

#[cfg(not(any(target_os = "linux", target_vendor = "apple")))]
fn exchange(_: &Path, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// What to do about a file or folder that cannot be written.
pub fn advice(error: &io::Error) -> &'static str {
    use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
    let mut cause: Option<&(dyn Error + 'static)> = Some(error);
    while let Some(found) = cause {
        let system = found.downcast_ref::<io::Error>();
        let kind = system.map(io::Error::kind);
        if matches!(kind, Some(StorageFull | QuotaExceeded | FileTooLarge)) {
            return "make room there, or write elsewhere; then give the command again";
        }
        // what writes a format wraps the system's error in its own
        let inner =
            system.and_then(io::Error::get_ref).map(|inner| inner as &(dyn Error + 'static));
        let in_table = found.downcast_ref::<csv::Error>().and_then(|error| match error.kind() {
            csv::ErrorKind::Io(error) => Some(error as &(dyn Error + 'static)),
            _ => None,
        });
        cause = inner.or(in_table).or_else(|| found.source());
    }
    "check that the folder exists and is writable"
}

/// Age from which a temporary file that nobody holds is of a process that was killed.
const STALE: Duration = Duration::from_mins(1);

/// Locks a temporary file or folder as long as this process has it open: nobody sweeps it. A file system without
/// locks has no sweeping either.
fn hold(file: &File) {
    let _ = file.try_lock();
}

/// Removes what killed processes left half-written in a folder; once for each folder. Nothing depends on it, so
/// what cannot be removed stays.
fn sweep_stale(folder: &Path) {
    static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let is_first = SWEPT.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned());
    if !is_first {
        return;
    }
    sweep(folder, is_stale);
}

/// Removes those temporary files and folders in a folder that `is_left` says are of nobody.
pub(super) fn sweep(folder: &Path, is_left: impl Fn(&Path) -> bool) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if entry.file_name().to_string_lossy().starts_with(TEMPORARY) && is_left(&path) {
            let _ = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
        }
    }
}

fn is_stale(path: &Path) -> bool {
    let age = |found: fs::Metadata| found.modified().ok()?.elapsed().ok();
    let is_old = fs::metadata(path).ok().and_then(age).is_some_and(|age| age > STALE);
    // on Windows a folder cannot be opened, and stays
    is_old && File::open(path).is_ok_and(|file| file.try_lock().is_ok())
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn plain(error: &io::Error) -> io::Error {
    error.raw_os_error().map_or_else(|| error.kind().into(), io::Error::from_raw_os_error)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(folder: &Path) -> Vec<String> {
        let names = fs::read_dir(folder).unwrap();
        names.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_debris() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.json");
        write_file(&path, |file| file.write_all(b"old")).unwrap();
        let failure = write_file(&path, |file| {
            file.write_all(b"half of the new")?;
            Err(io::Error::other("disk full"))
        });
        assert!(failure.unwrap_err().to_string().contains("disk full"));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(entries(folder.path()), ["run.json"]);
    }

    #[test]
    fn a_folder_is_replaced_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("posterior.zarr");
        let fill = |name: &'static str| move |new: &Path| fs::write(new.join(name), b"");
        write_folder(&path, fill("first")).unwrap();
        write_folder(&path, fill("second")).unwrap();
        assert_eq!(entries(&path), ["second"]);
        let failure = write_folder(&path, |_| Err(io::Error::other("disk full")));
        assert!(failure.is_err());
        assert_eq!(entries(&path), ["second"]);
        assert_eq!(entries(folder.path()), ["posterior.zarr"]);
    }

    /// Both ways to replace a folder; on Linux the first is always used on the file systems that tests run on.
    #[test]
    fn whoever_is_killed_while_a_folder_is_replaced_loses_neither() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("la");
        let fill = |name: &'static str| move |new: &Path| fs::write(new.join(name), b"");
        write_folder(&path, fill("first")).unwrap();
        // the old one lies aside, and the process is gone
        let old = aside(&path).unwrap();
        fs::rename(&path, &old).unwrap();
        let failure = write_folder(&path, |_| Err(io::Error::other("disk full")));
        assert!(failure.is_err());
        assert_eq!(entries(&path), ["first"]);
        // killed when the new one had its place
        fs::create_dir(&old).unwrap();
        write_folder_by(&path, fill("second"), |_, _| Err(io::ErrorKind::Unsupported.into()))
            .unwrap();
        assert_eq!(entries(&path), ["second"]);
        assert_eq!(entries(place.path()), ["la"]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_folder_that_is_replaced_is_there_at_every_moment() {
        use std::sync::atomic::{AtomicBool, Ordering};
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("la");
        let fill = |new: &Path| fs::write(new.join("file"), b"");
        write_folder(&path, fill).unwrap();
        let is_done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let look = || {
                let mut n_missed = 0;
                while !is_done.load(Ordering::Relaxed) {
                    n_missed += usize::from(!path.join("file").exists());
                }
                n_missed
            };
            let watcher = scope.spawn(look);
            for _ in 0..2000 {
                write_folder(&path, fill).unwrap();
            }
            is_done.store(true, Ordering::Relaxed);
            assert_eq!(watcher.join().unwrap(), 0);
        });
    }

    #[test]
    fn a_full_disk_is_told_from_other_faults_whoever_met_it() {
        let full = || io::Error::from(io::ErrorKind::StorageFull);
        for error in [full(), io::Error::other(full()), io::Error::other(io::Error::other(full()))]
        {
            assert!(advice(&error).starts_with("make room"), "{error:?}");
        }
        let denied = io::Error::other(io::Error::from(io::ErrorKind::PermissionDenied));
        assert!(advice(&denied).starts_with("check"));
    }

    #[cfg(unix)]
    #[test]
    fn what_killed_processes_left_is_swept_and_what_is_being_written_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let [left, held, young] =
            ["left", "held", "young"].map(|name| folder.path().join(format!("{TEMPORARY}{name}")));
        let old = std::time::SystemTime::now() - 2 * STALE;
        for path in [&left, &held, &young] {
            fs::write(path, "half").unwrap();
        }
        let being_written = File::options().write(true).open(&held).unwrap();
        hold(&being_written);
        for path in [&left, &held] {
            File::options().write(true).open(path).unwrap().set_modified(old).unwrap();
        }
        write_file(&folder.path().join("file"), |_| Ok(())).unwrap();
        assert!(!left.exists() && held.exists() && young.exists());
    }

    #[cfg(unix)]
    #[test]
    fn others_can_read_what_the_umask_lets_them_read() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        let plain = folder.path().join("plain");
        fs::write(&plain, b"").unwrap();
        let path = folder.path().join("file");
        write_file(&path, |_| Ok(())).unwrap();
        assert_eq!(mode(&path), mode(&plain));
    }
}
