//! CSV tables of strip parameters and strip outcomes.
//!
//! Columns are found by name, in any order; unknown ones are ignored.  An absent value is an empty
//! cell.  Files are written under a temporary name and renamed, so a file that exists is whole.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::cell::{OutOfRange, Parameters};
use super::strip::StripOutcome;
use crate::atomic::{NewFile, write_file};

/// A table that cannot be read or written.
#[derive(Debug, Error)]
pub enum TableError {
    /// The file cannot be opened, read or written.
    #[error(
        "cannot {action} {}: {source}\nhelp: check that the path exists and that you may {action} there",
        path.display()
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
    /// A parameter outside its valid range.
    #[error("{}, line {line}: {source}", path.display())]
    Parameter {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// Which parameter, and its range.
        source: OutOfRange,
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

/// A row type that knows its columns.
pub trait Columns {
    /// The columns that must be there.
    const REQUIRED: &'static [&'static str];
}

/// One parameter set, with units in the column names.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the fields are those of `Parameters`, each with its unit")]
pub struct ParameterRow {
    pub cv_max_m_per_s: f64,
    pub tau_in_ms: f64,
    pub tau_out_ms: f64,
    pub tau_open_ms: f64,
    pub apd_max_ms: f64,
}

impl Columns for ParameterRow {
    const REQUIRED: &'static [&'static str] =
        &["cv_max_m_per_s", "tau_in_ms", "tau_out_ms", "tau_open_ms", "apd_max_ms"];
}

impl From<Parameters> for ParameterRow {
    fn from(p: Parameters) -> Self {
        Self {
            cv_max_m_per_s: p.cv_max,
            tau_in_ms: p.tau_in,
            tau_out_ms: p.tau_out,
            tau_open_ms: p.tau_open,
            apd_max_ms: p.apd_max,
        }
    }
}

impl From<ParameterRow> for Parameters {
    fn from(row: ParameterRow) -> Self {
        Self {
            cv_max: row.cv_max_m_per_s,
            tau_in: row.tau_in_ms,
            tau_out: row.tau_out_ms,
            tau_open: row.tau_open_ms,
            apd_max: row.apd_max_ms,
        }
    }
}

/// One parameter set and what the strip did with it.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs, reason = "the fields are those of `Parameters`, `Tissue` and `StripOutcome`")]
pub struct OutcomeRow {
    pub row: usize,
    pub cv_max_m_per_s: f64,
    pub tau_in_ms: f64,
    pub tau_out_ms: f64,
    pub tau_open_ms: f64,
    pub apd_max_ms: f64,
    pub diffusivity_mm2_per_ms: f64,
    pub tau_close_ms: f64,
    pub cv_s1_m_per_s: Option<f64>,
    pub apd90_s1_ms: Option<f64>,
    pub erp_s2_ms: Option<u32>,
    pub cv_s2_m_per_s: Option<f64>,
    pub apd90_s2_ms: Option<f64>,
    pub erp_s3_ms: Option<u32>,
    /// Why ERP_S2 (and, for the S1 beat, everything) is absent; empty where it is not.
    pub erp_s2_absence: Option<String>,
    /// Why ERP_S3 is absent; empty where it is not.
    pub erp_s3_absence: Option<String>,
}

impl OutcomeRow {
    /// The table's row number `row` (from 0).
    pub fn new(row: usize, parameters: Parameters, outcome: &StripOutcome) -> Self {
        let ParameterRow { cv_max_m_per_s, tau_in_ms, tau_out_ms, tau_open_ms, apd_max_ms } =
            parameters.into();
        let tissue = parameters.tissue();
        Self {
            row,
            cv_max_m_per_s,
            tau_in_ms,
            tau_out_ms,
            tau_open_ms,
            apd_max_ms,
            diffusivity_mm2_per_ms: rounded(tissue.diffusivity, 1e9),
            tau_close_ms: rounded(tissue.tau_close, 1e6),
            cv_s1_m_per_s: outcome.s1.ok().map(|beat| rounded(beat.cv, 1e5)),
            apd90_s1_ms: outcome.s1.ok().map(|beat| rounded(beat.apd90, 1e3)),
            erp_s2_ms: outcome.erp_s2.ok(),
            cv_s2_m_per_s: outcome.s2.ok().map(|beat| rounded(beat.cv, 1e5)),
            apd90_s2_ms: outcome.s2.ok().map(|beat| rounded(beat.apd90, 1e3)),
            erp_s3_ms: outcome.erp_s3.ok(),
            erp_s2_absence: outcome.erp_s2.err().map(|absence| absence.to_string()),
            erp_s3_absence: outcome.erp_s3.err().map(|absence| absence.to_string()),
        }
    }
}

/// `value` to one part in `per_unit`, so that tables are short to read.
pub(crate) fn rounded(value: f64, per_unit: f64) -> f64 {
    (value * per_unit).round() / per_unit
}

/// Reads parameter sets and checks that each is in its valid range.
///
/// # Errors
/// An unreadable file, a missing column, a cell that is no number, a value out of range, no rows.
pub fn read_parameters(path: &Path) -> Result<Vec<Parameters>, TableError> {
    let rows = read_rows::<ParameterRow>(path)?;
    let checked = rows.into_iter().map(|(line, row)| {
        let parameters = Parameters::from(row);
        let error = |source| TableError::Parameter { path: path.to_owned(), line, source };
        parameters.validate().map(|()| parameters).map_err(error)
    });
    checked.collect()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ep::{Absence, Beat};

    const HEADER: &str = "tau_in_ms,cv_max_m_per_s,tau_out_ms,tau_open_ms,apd_max_ms\n";

    fn read(text: &str) -> Result<Vec<Parameters>, String> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        let in_file =
            |e: TableError| e.to_string().replace(&file.path().display().to_string(), "FILE");
        read_parameters(file.path()).map_err(in_file)
    }

    #[test]
    fn columns_are_found_by_name() {
        let rows = read(&format!("{HEADER}0.05, 0.7, 10, 120, 200\n")).unwrap();
        assert_eq!(rows, vec![Parameters::from_array([0.7, 0.05, 10.0, 120.0, 200.0])]);
    }

    #[test]
    fn bad_tables_name_the_place() {
        let message = |rows: &str| read(&format!("{HEADER}{rows}")).unwrap_err();
        let good = "0.05,0.7,10,120,200\n";
        assert!(
            message(&format!("{good}0.05,0.7,x,120,200\n"))
                .starts_with("FILE, line 3, column tau_out_ms: invalid float literal")
        );
        assert!(message(&format!("{good}0.05,0.7,10\n")).starts_with("FILE, line 3: "));
        assert!(message("0.05,0.7,10,120,900\n").starts_with("FILE, line 2: apd_max = 900 ms is"));
        assert!(message("0.05,0.7,NaN,120,200\n").starts_with("FILE, line 2: tau_out = NaN ms is"));
        assert!(message("").starts_with("FILE has no rows"));
        let missing = read("tau_in_ms\n1\n").unwrap_err();
        assert!(
            missing.starts_with("FILE has no column cv_max_m_per_s; it has: tau_in_ms\n"),
            "{missing}"
        );
    }

    #[test]
    fn absent_values_are_empty_cells_with_a_reason() {
        let beat = Ok(Beat { cv: 0.712_345_6, apd90: 201.25 });
        let outcome = StripOutcome {
            s1: beat,
            erp_s2: Ok(310),
            s2: Err(Absence::NoActivation),
            erp_s3: Err(Absence::NoActivation),
        };
        let parameters = Parameters::from_array([0.7, 0.05, 10.0, 120.0, 200.0]);
        let row = OutcomeRow::new(3, parameters, &outcome);
        let file = tempfile::NamedTempFile::new().unwrap();
        finish_rows(new_file(file.path()).unwrap(), &[row]).unwrap();
        let text = std::fs::read_to_string(file.path()).unwrap();
        assert!(
            text.contains("0.71235,201.25,310,,,,,the conditioning stimulus did not"),
            "{text}"
        );
    }
}
