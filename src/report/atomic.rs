//! Files and folders that appear whole or not at all.
//!
//! Both are made in a temporary folder beside their final place and renamed.  (A plain temporary file would be
//! readable by its owner only; a file made in a temporary folder has the permissions that the user's umask gives.)

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::ReportError;

/// Writes a file by `fill`, under a temporary name that becomes `path` once everything is on disk.
///
/// # Errors
/// [`ReportError::Write`]; then a file that was at `path` before is still there, untouched.
pub(super) fn write_file(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), ReportError> {
    let write = || {
        let workshop = temporary_sibling(path)?;
        let unfinished = workshop.path().join("file");
        let mut file = BufWriter::new(File::create_new(&unfinished)?);
        fill(&mut file)?;
        file.flush()?;
        drop(file);
        fs::rename(&unfinished, path)
    };
    write().map_err(ReportError::write(path))
}

/// Writes `text` as a file that appears whole or not at all.
///
/// # Errors
/// [`ReportError::Write`].
pub fn write_text(path: &Path, text: &str) -> Result<(), ReportError> {
    write_file(path, |file| file.write_all(text.as_bytes()))
}

/// Makes a folder by `fill`, under a temporary name that becomes `path` once everything is on disk.
///
/// A folder that was at `path` is moved aside first, and back if the new one cannot take its place.
///
/// # Errors
/// [`ReportError::Write`]; then a folder that was at `path` before is still there.
pub(super) fn write_folder(
    path: &Path,
    fill: impl FnOnce(&Path) -> io::Result<()>,
) -> Result<(), ReportError> {
    let write = || {
        let workshop = temporary_sibling(path)?;
        let (new, old) = (workshop.path().join("new"), workshop.path().join("old"));
        fs::create_dir(&new)?;
        fill(&new)?;
        let replaces = path.exists();
        if replaces {
            fs::rename(path, &old)?;
        }
        fs::rename(&new, path).inspect_err(|_| {
            // The first error is the one to report; this move only undoes the one above.
            let _ = replaces.then(|| fs::rename(&old, path));
        })
    };
    write().map_err(ReportError::write(path))
}

/// A temporary folder in the folder of `path`, removed when dropped.
fn temporary_sibling(path: &Path) -> io::Result<tempfile::TempDir> {
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty());
    tempfile::Builder::new().prefix(".eplat-").tempdir_in(parent.unwrap_or(Path::new(".")))
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
