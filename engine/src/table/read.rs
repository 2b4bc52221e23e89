//! Tables from CSV files, and as CSV text.

use std::fs;
use std::path::Path;

use super::cells::Cells;
use super::{DataError, Table, csv_line, decode, from_cell, habits};

/// Reads a CSV file with a header line, as programs and spreadsheets write them: see
/// [`habits`].
///
/// # Errors
/// No such file, no text, ragged rows, no rows, two columns of one name, a number that may be read in
/// two ways.
pub(super) fn read(path: &Path) -> Result<Table, DataError> {
    let file = path.display().to_string();
    let unreadable = |e: csv::Error| unreadable(&file, &e);
    let raw = fs::read(path).map_err(|e| unreadable(e.into()))?;
    if let Some((what, help)) = habits::packed(&raw) {
        return Err(DataError::NotText { file, what, help });
    }
    let (text, n_comments) = habits::without_comments(decode(&raw));
    // a first line that tells Excel the separator
    let named = text.lines().next().and_then(|line| line.trim().strip_prefix("sep="));
    let (delimiter, skipped) = match named.map(str::as_bytes) {
        Some([sign]) => (*sign, text.find('\n').map_or(text.len(), |at| at + 1)),
        _ => (habits::delimiter(&text), 0),
    };
    let bytes = &text.as_bytes()[skipped..];
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).delimiter(delimiter).from_reader(bytes);
    let mut header: Vec<String> = reader
        .headers()
        .map_err(unreadable)?
        .iter()
        .map(|name| habits::plain(from_cell(without_marks(name))))
        .collect();
    let (mut lines, mut cells) = (vec![], Cells::new(header.len()));
    let mut counted = (0, 1 + u64::from(skipped > 0));
    for record in reader.records() {
        let record = record.map_err(unreadable)?;
        if delimiter != b',' && record.iter().all(str::is_empty) {
            continue; // a row of separators alone
        }
        let begin = record.position().map_or(0, csv::Position::byte) as usize;
        // a record begins with the blank lines before it
        let blank = bytes[begin..].iter().take_while(|b| b.is_ascii_whitespace()).count();
        let passed = bytes[counted.0..begin + blank].split(|b| *b == b'\n').count() - 1;
        counted = (begin + blank, counted.1 + passed as u64);
        lines.push(counted.1);
        cells.push(record.iter().map(from_cell));
    }
    // the cells are all that is needed from here on
    drop(reader);
    drop(text);
    drop(raw);
    let mut cells = habits::without_empty_columns(&mut header, cells);
    if let Some((first, second)) = habits::doubled(&header) {
        let column = header[first].clone();
        return Err(DataError::Doubled { file, column, first: first + 1, second: second + 1 });
    }
    let mut notes = vec![];
    if n_comments > 0 {
        notes.push(format!("{n_comments} lines that begin with # are left out"));
    }
    if delimiter != b',' {
        let at = |row: usize, column: usize, problem: String| DataError::Cell {
            file: file.clone(),
            line: lines[row],
            column: header[column].clone(),
            problem,
            help: "write numbers as 1234.5, or with decimal commas and nothing between thousands"
                .into(),
        };
        let has_commas = habits::decimal_commas(&mut cells, &at)?;
        let sign = if delimiter == b'\t' { "tabs" } else { "semicolons" };
        let commas = if has_commas { " and decimal commas" } else { "" };
        notes.push(format!("read with {sign} between cells{commas}"));
    }
    Ok(Table::new(file, header, lines, &cells)?.with_notes(notes))
}

/// A name without byte order marks around it: files that were put together begin with several.
fn without_marks(name: &str) -> &str {
    name.trim_matches(|c: char| c == '\u{feff}' || c.is_whitespace())
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
    /// The table as CSV text; [`read`] gives it back.
    pub fn to_csv(&self) -> String {
        let header: Vec<&str> = self.columns().iter().map(String::as_str).collect();
        let rows = (0..self.len()).map(|row| self.cells(row));
        std::iter::once(header).chain(rows).map(csv_line).collect()
    }
}
