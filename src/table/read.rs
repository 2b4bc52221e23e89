//! Tables from CSV files, and as CSV text.

use std::fs;
use std::path::Path;

use super::{DataError, Table};

/// Reads a CSV file with a header line.
///
/// # Errors
/// No such file, ragged rows, no rows.
pub(super) fn read(path: &Path) -> Result<Table, DataError> {
    let file = path.display().to_string();
    let unreadable = |e: csv::Error| unreadable(&file, &e);
    let bytes = fs::read(path).map_err(|e| unreadable(e.into()))?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes.as_slice());
    let header: Vec<String> =
        reader.headers().map_err(unreadable)?.iter().map(String::from).collect();
    let (mut lines, mut cells, mut counted) = (vec![], vec![], (0, 1));
    for record in reader.records() {
        let record = record.map_err(unreadable)?;
        let begin = record.position().map_or(0, csv::Position::byte) as usize;
        // a record begins with the blank lines before it
        let blank = bytes[begin..].iter().take_while(|b| b.is_ascii_whitespace()).count();
        let passed = bytes[counted.0..begin + blank].split(|b| *b == b'\n').count() - 1;
        counted = (begin + blank, counted.1 + passed as u64);
        lines.push(counted.1);
        cells.push(record.iter().map(String::from).collect());
    }
    Table::new(file, header, lines, &cells)
}

fn unreadable(file: &str, error: &csv::Error) -> DataError {
    let reason = match error.kind() {
        csv::ErrorKind::Io(io) => io.to_string(),
        csv::ErrorKind::UnequalLengths { pos, expected_len, len } => format!(
            "line {} has {len} cells, the header has {expected_len}",
            pos.as_ref().map_or(0, csv::Position::line)
        ),
        _ => error.to_string(),
    };
    DataError::Unreadable { file: file.to_owned(), reason }
}

impl Table {
    /// The table as CSV text.
    pub fn to_csv(&self) -> String {
        let mut out = self.columns().join(",") + "\n";
        for row in 0..self.len() {
            out += &self.cells(row).join(",");
            out.push('\n');
        }
        out
    }
}
