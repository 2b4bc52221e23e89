//! Whole files: their bytes, read and written.

use super::MeshError;
use crate::store::write_file;
use std::fs;
use std::io::Write as _;
use std::path::Path;

/// Whether numbers are written as text or as bytes, where a format has both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Text, in the shortest form that reads back the same.
    Ascii,
    /// Bytes.
    Binary,
}

/// The bytes of a file.
pub(super) fn read_bytes(path: &Path) -> Result<Vec<u8>, MeshError> {
    fs::read(path).map_err(|source| MeshError::Read { path: path.into(), source })
}

/// Writes under a temporary name in the same folder and renames.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), MeshError> {
    write_file(path, |file| file.write_all(bytes))
        .map_err(|source| MeshError::Write { path: path.into(), source })
}
