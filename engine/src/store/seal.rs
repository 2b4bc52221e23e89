//! Which bytes a file or a folder holds, in 64 digits.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::{Component, Path};

use sha2::{Digest as _, Sha256};

use super::TEMPORARY;

/// SHA-256 of a file, hexadecimal; of a folder, that of the names and hashes of all that is in it, but for what has a
/// temporary name: what a killed process left half-written goes at some time.
///
/// # Errors
/// From the operating system.
pub fn seal_of(path: &Path) -> io::Result<String> {
    let mut hasher = Sha256::new();
    if path.is_dir() {
        let names: io::Result<Vec<_>> =
            fs::read_dir(path)?.map(|entry| Ok(entry?.file_name())).collect();
        let mut names = names?;
        names.retain(|name| !name.to_string_lossy().starts_with(TEMPORARY));
        names.sort();
        for name in names {
            let seal = seal_of(&path.join(&name))?;
            hasher.update(format!("{}\0{seal}\n", name.to_string_lossy()));
        }
    } else {
        io::copy(&mut File::open(path)?, &mut hasher)?;
    }
    Ok(format!("{:x}", hasher.finalize()))
}

/// [`seal_of`] of each of these files and folders in `folder`, by name.
///
/// # Errors
/// From the operating system.
pub fn seals<N: AsRef<str>>(
    folder: &Path,
    names: impl IntoIterator<Item = N>,
) -> io::Result<BTreeMap<String, String>> {
    let seal = |name: N| Ok((name.as_ref().to_owned(), seal_of(&folder.join(name.as_ref()))?));
    names.into_iter().map(seal).collect()
}

/// Whether this is the name of a file or folder in a folder, of nothing below or above it.
pub fn is_name(name: &str) -> bool {
    Path::new(name).components().eq([Component::Normal(name.as_ref())])
}

/// Those of the `files` that a record in `folder` names which nobody has changed since. A name that leads out of the
/// folder is none of them.
pub fn unchanged(folder: &Path, files: &BTreeMap<String, String>) -> Vec<String> {
    let is_unchanged = |(name, seal): &(&String, &String)| {
        is_name(name)
            && !name.starts_with('.')
            && seal_of(&folder.join(name)).is_ok_and(|found| found == **seal)
    };
    files.iter().filter(is_unchanged).map(|(name, _)| name.clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_s_seal_depends_on_every_name_and_byte_in_it() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("a.zarr");
        fs::create_dir_all(folder.join("draws")).unwrap();
        fs::write(folder.join("draws/0"), "abc").unwrap();
        // printf abc | sha256sum
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(seal_of(&folder.join("draws/0")).unwrap(), abc);
        let whole = seal_of(&folder).unwrap();
        fs::write(folder.join("draws/0"), "abd").unwrap();
        assert_ne!(seal_of(&folder).unwrap(), whole);
        fs::write(folder.join("draws/0"), "abc").unwrap();
        // what a killed process left
        fs::write(folder.join(format!("draws/{TEMPORARY}x")), "ab").unwrap();
        assert_eq!(seal_of(&folder).unwrap(), whole);
        fs::rename(folder.join("draws/0"), folder.join("draws/1")).unwrap();
        assert_ne!(seal_of(&folder).unwrap(), whole);
        assert!(seal_of(&place.path().join("none")).is_err());
    }

    #[test]
    fn what_was_changed_or_is_elsewhere_is_not_a_record_s_own() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("figures");
        fs::create_dir(&folder).unwrap();
        for name in ["figures/a", "figures/b", "figures/.hidden", "c"] {
            fs::write(place.path().join(name), name).unwrap();
        }
        fs::create_dir(folder.join("below")).unwrap();
        let files = seals(&folder, ["a", "b", ".hidden", "../c", "below/../../c"]).unwrap();
        assert_eq!(unchanged(&folder, &files), ["a", "b"]);
        fs::write(folder.join("a"), "other").unwrap();
        assert_eq!(unchanged(&folder, &files), ["b"]);
        assert!(seals(&folder, ["none"]).is_err());
        for name in ["", ".", "..", "/", "/a", "a/", "a/b", "../figures"] {
            assert!(!is_name(name), "{name}");
        }
        assert!(is_name("a") && is_name(".a"));
    }
}
