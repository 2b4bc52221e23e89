//! How much memory there is, so that what cannot fit is refused before it is begun.

use std::fs;

/// Bytes of memory that are free, where the system tells it.
pub fn available() -> Option<u64> {
    let told = fs::read_to_string("/proc/meminfo").ok()?;
    let line = told.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? << 10)
}

/// Whether so many numbers of eight bytes are more than the free memory: the bytes that they take, and those that
/// are free, if so.
pub fn exceeds(numbers: u128) -> Option<(u128, u64)> {
    let (bytes, free) = (numbers.saturating_mul(8), available()?);
    (bytes > u128::from(free)).then_some((bytes, free))
}
