//! What stops the build, and where.

use std::fmt;

/// Something wrong in a page.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Fault {
    /// The file, as a path in the project.
    pub file: String,
    /// Its line, from 1.
    pub line: usize,
    /// What is wrong, and what to do.
    pub what: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, line, what } = self;
        write!(f, "{file}:{line}: {what}")
    }
}

/// An error that lists all faults, a line each; `Ok` if there are none.
///
/// # Errors
/// If there is a fault.
pub fn refuse(mut faults: Vec<Fault>) -> anyhow::Result<()> {
    if faults.is_empty() {
        return Ok(());
    }
    faults.sort();
    faults.dedup();
    let lines: Vec<String> = faults.iter().map(Fault::to_string).collect();
    anyhow::bail!("{}", lines.join("\n"))
}
