//! Why a table cannot be read or written.

use std::path::PathBuf;

use thiserror::Error;

use crate::store::advice;

/// A table that cannot be read or written.
#[derive(Debug, Error)]
pub enum TableError {
    /// The file cannot be opened, read or written.
    #[error(
        "cannot {action} {}: {source}\nhelp: {}",
        path.display(),
        if *action == "write" { advice(source) } else { "check the path; it is relative to the folder you are in" }
    )]
    Io {
        /// "read" or "write".
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The header lacks a column.
    #[error(
        "{} has no column {column}; it has: {found}\n\
         help: the first line must name the columns {}", path.display(), required.join(", ")
    )]
    MissingColumn {
        /// The file.
        path: PathBuf,
        /// The first column that is missing.
        column: &'static str,
        /// The columns that are there.
        found: String,
        /// The columns that must be there.
        required: &'static [&'static str],
    },
    /// A row that cannot be read.
    #[error(
        "{}, line {line}{}: {problem}\n\
         help: every row needs as many cells as the header, with numbers under the columns in use",
        path.display(), at_column(column.as_deref())
    )]
    Row {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// The column's name, where it is known.
        column: Option<String>,
        /// What is wrong.
        problem: String,
    },
    /// A header but no rows, or nothing at all.
    #[error("{} has no rows\nhelp: give a header line and at least one row under it", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

fn at_column(column: Option<&str>) -> String {
    column.map(|name| format!(", column {name}")).unwrap_or_default()
}
