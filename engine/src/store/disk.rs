//! How much room there is on a disk.

use std::path::Path;

/// Bytes that may still be written to the disk of `folder`, where the system tells it.
#[cfg(unix)]
pub fn free_on_disk(folder: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(folder).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}

/// Nothing is known.
#[cfg(not(unix))]
pub fn free_on_disk(_: &Path) -> Option<u64> {
    None
}
