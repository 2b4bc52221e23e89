//! Reading and writing rows of CSV.

use std::io::Write as _;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{Columns, ParameterRow, TableError};
use crate::ep::Parameters;
use crate::store::{NewFile, write_file};

/// Reads parameter sets, in their valid ranges or not.
///
/// # Errors
/// An unreadable file, a missing column, a cell that is no number, no rows.
pub fn read_parameters(path: &Path) -> Result<Vec<Parameters>, TableError> {
    let rows = read_rows::<ParameterRow>(path)?;
    Ok(rows.into_iter().map(|(_, row)| row.into()).collect())
}

/// Reads the rows of a table, each with the line it begins on.
///
/// # Errors
/// An unreadable file, a missing column, a cell that cannot be parsed, no rows.
pub fn read_rows<R: DeserializeOwned + Columns>(path: &Path) -> Result<Vec<(u64, R)>, TableError> {
    let open = |source| TableError::Io { action: "read", path: path.to_owned(), source };
    let file = std::fs::File::open(path).map_err(open)?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(file);
    let header = reader.headers().map_err(|e| row_error(path, None, &e))?.clone();
    let missing = R::REQUIRED.iter().find(|&&column| !header.iter().any(|name| name == column));
    if let Some(column) = missing {
        let found = header.iter().collect::<Vec<_>>().join(", ");
        let path = path.to_owned();
        return Err(TableError::MissingColumn { path, column, found, required: R::REQUIRED });
    }
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| row_error(path, Some(&header), &e))?;
        let line = record.position().map_or(0, csv::Position::line);
        let row =
            record.deserialize(Some(&header)).map_err(|e| row_error(path, Some(&header), &e))?;
        rows.push((line, row));
    }
    if rows.is_empty() {
        return Err(TableError::Empty { path: path.to_owned() });
    }
    Ok(rows)
}

/// Says where in the file `error` is.
fn row_error(path: &Path, header: Option<&csv::StringRecord>, error: &csv::Error) -> TableError {
    let (mut column, mut problem) = (None, error.to_string());
    if let csv::ErrorKind::Deserialize { err, .. } = error.kind() {
        let field = err.field().and_then(|index| header?.get(index as usize));
        column = field.map(str::to_owned);
        problem = err.kind().to_string();
    }
    let line = error.position().map_or(1, csv::Position::line);
    TableError::Row { path: path.to_owned(), line, column, problem }
}

/// Makes the file `path` that is yet to be filled: see [`NewFile::create`].
///
/// # Errors
/// [`TableError::Io`].
pub fn new_file(path: &Path) -> Result<NewFile, TableError> {
    NewFile::create(path).map_err(failure(path))
}

/// Writes `rows` as CSV and gives the file its name.
///
/// # Errors
/// [`TableError::Io`].
pub fn finish_rows<R: Serialize>(mut file: NewFile, rows: &[R]) -> Result<(), TableError> {
    let path = file.path().to_owned();
    let mut writer = csv::Writer::from_writer(file.file());
    let written = rows.iter().try_for_each(|row| writer.serialize(row));
    written.map_err(std::io::Error::from).and_then(|()| writer.flush()).map_err(failure(&path))?;
    drop(writer);
    file.finish().map_err(failure(&path))
}

/// Writes `text` to `path`.
///
/// # Errors
/// [`TableError::Io`].
pub fn write_text(path: &Path, text: &str) -> Result<(), TableError> {
    write_file(path, |file| file.write_all(text.as_bytes())).map_err(failure(path))
}

fn failure(path: &Path) -> impl Fn(std::io::Error) -> TableError {
    move |source| TableError::Io { action: "write", path: path.to_owned(), source }
}
