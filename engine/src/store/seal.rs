//! Which bytes a file or a folder holds, in 64 digits.

use std::fs::{self, File};
use std::io;
use std::path::Path;

use sha2::{Digest as _, Sha256};

/// SHA-256 of a file, hexadecimal; of a folder, that of the names and hashes of all that is in it.
///
/// # Errors
/// From the operating system.
pub fn seal_of(path: &Path) -> io::Result<String> {
    let mut hasher = Sha256::new();
    if path.is_dir() {
        let names: io::Result<Vec<_>> =
            fs::read_dir(path)?.map(|entry| Ok(entry?.file_name())).collect();
        let mut names = names?;
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
        assert_eq!(seal_of(&folder).unwrap(), whole);
        fs::rename(folder.join("draws/0"), folder.join("draws/1")).unwrap();
        assert_ne!(seal_of(&folder).unwrap(), whole);
        assert!(seal_of(&place.path().join("none")).is_err());
    }
}
