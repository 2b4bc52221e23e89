//! What can be wrong with a table of measurements.

use thiserror::Error;

/// What can be wrong with a table of measurements.
#[derive(Debug, Error)]
pub enum DataError {
    /// The file cannot be opened.
    #[error(
        "cannot read {file}: {reason}\nhelp: give a CSV file with a header line and one row per measurement"
    )]
    Unreadable {
        /// File name.
        file: String,
        /// From the operating system or the CSV reader.
        reason: String,
    },
    /// No text.
    #[error("{file}: {what}, not a CSV text\nhelp: {help}")]
    NotText {
        /// File name.
        file: String,
        /// What it is.
        what: &'static str,
        /// What to do.
        help: &'static str,
    },
    /// Two columns of one name.
    #[error(
        "{file}: columns {first} and {second} are both called `{column}`\nhelp: rename one, or leave it out"
    )]
    Doubled {
        /// File name.
        file: String,
        /// The name.
        column: String,
        /// Number of the first, from 1.
        first: usize,
        /// Number of the second.
        second: usize,
    },
    /// A header at most.
    #[error(
        "{file}: the table is empty\nhelp: one row per measurement is expected below the header line"
    )]
    Empty {
        /// File name.
        file: String,
    },
    /// A column that is needed and not there.
    #[error("{file}: no column `{column}`, which {who} reads\n  the file has: {available}{guess}")]
    NoColumn {
        /// File name.
        file: String,
        /// The column asked for.
        column: String,
        /// Who asks.
        who: String,
        /// The header.
        available: String,
        /// "help: …" with the nearest name, or what to do.
        guess: String,
    },
    /// A cell that does not hold what it should.
    #[error("{file}, line {line}, column `{column}`: {problem}\nhelp: {help}")]
    Cell {
        /// File name.
        file: String,
        /// Line in the file, from 1.
        line: u64,
        /// Column name or names.
        column: String,
        /// Expected and got.
        problem: String,
        /// What to do.
        help: String,
    },
}

/// Number of letters that must be changed, added or dropped to turn one name into another; upper and
/// lower case count as the same.
pub(super) fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.to_lowercase().chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.to_lowercase().chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let substituted = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

/// The name among `known` that differs in at most two letters.
pub fn near<'k>(name: &str, known: &[&'k str]) -> Option<&'k str> {
    let (distance, near) = known.iter().map(|known| (edit_distance(known, name), *known)).min()?;
    (distance <= 2).then_some(near)
}
