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
use super::restitution::Restitution;
use super::strip::{Absence, Beat, StripOutcome};
use crate::store::{NewFile, write_file};

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
    pub apd20_s1_ms: Option<f64>,
    pub apd30_s1_ms: Option<f64>,
    pub apd50_s1_ms: Option<f64>,
    pub apd90_s1_ms: Option<f64>,
    pub erp_s2_ms: Option<u32>,
    pub cv_s2_m_per_s: Option<f64>,
    pub apd20_s2_ms: Option<f64>,
    pub apd30_s2_ms: Option<f64>,
    pub apd50_s2_ms: Option<f64>,
    pub apd90_s2_ms: Option<f64>,
    pub erp_s3_ms: Option<u32>,
    /// Coefficients of CV(S2) and APD90(S2), see [`Restitution`]; empty where no curve was asked for.
    pub cv_restitution_a: Option<f64>,
    pub cv_restitution_b: Option<f64>,
    pub cv_restitution_c: Option<f64>,
    pub cv_restitution_d: Option<f64>,
    pub apd_restitution_a: Option<f64>,
    pub apd_restitution_b: Option<f64>,
    pub apd_restitution_c: Option<f64>,
    pub apd_restitution_d: Option<f64>,
    /// Why ERP_S2 (and, for the S1 beat, everything) is absent; empty where it is not.
    pub erp_s2_absence: Option<String>,
    /// Why ERP_S3 is absent; empty where it is not.
    pub erp_s3_absence: Option<String>,
}

impl OutcomeRow {
    /// The table's row number `row` (from 0): what the strip did, or why it was not simulated.
    pub fn new(
        row: usize,
        parameters: Parameters,
        outcome: &Result<StripOutcome, OutOfRange>,
    ) -> Self {
        let ParameterRow { cv_max_m_per_s, tau_in_ms, tau_out_ms, tau_open_ms, apd_max_ms } =
            parameters.into();
        let tissue = parameters.tissue();
        let done = outcome.as_ref().ok();
        let (s1, s2) = (done.and_then(|o| o.s1.ok()), done.and_then(|o| o.s2.ok()));
        let ms = |beat: Option<Beat>, of: fn(&Beat) -> Option<f64>| {
            beat.and_then(|b| of(&b)).map(|x| rounded(x, 1e3))
        };
        let cv = |beat: Option<Beat>| beat.map(|b| rounded(b.cv, 1e5));
        let curve = |of: fn(&Beat) -> f64| {
            let fit = done.and_then(|o| Restitution::fit(&o.restitution, of));
            let value = |value: fn(&Restitution) -> f64| fit.map(|f| rounded(value(&f), 1e5));
            [value(|f| f.a), value(|f| f.b), value(|f| f.c), value(|f| f.d)]
        };
        let [cv_a, cv_b, cv_c, cv_d] = curve(|b| b.cv);
        let [apd_a, apd_b, apd_c, apd_d] = curve(|b| b.apd90);
        let absence = |of: fn(&StripOutcome) -> Result<u32, Absence>| match outcome {
            Ok(outcome) => of(outcome).err().map(|absence| absence.to_string()),
            Err(out_of_range) => out_of_range.to_string().lines().next().map(String::from),
        };
        Self {
            row,
            cv_max_m_per_s,
            tau_in_ms,
            tau_out_ms,
            tau_open_ms,
            apd_max_ms,
            diffusivity_mm2_per_ms: rounded(tissue.diffusivity, 1e9),
            tau_close_ms: rounded(tissue.tau_close, 1e6),
            cv_s1_m_per_s: cv(s1),
            apd20_s1_ms: ms(s1, |b| b.apd20),
            apd30_s1_ms: ms(s1, |b| b.apd30),
            apd50_s1_ms: ms(s1, |b| b.apd50),
            apd90_s1_ms: ms(s1, |b| Some(b.apd90)),
            erp_s2_ms: done.and_then(|o| o.erp_s2.ok()),
            cv_s2_m_per_s: cv(s2),
            apd20_s2_ms: ms(s2, |b| b.apd20),
            apd30_s2_ms: ms(s2, |b| b.apd30),
            apd50_s2_ms: ms(s2, |b| b.apd50),
            apd90_s2_ms: ms(s2, |b| Some(b.apd90)),
            erp_s3_ms: done.and_then(|o| o.erp_s3.ok()),
            cv_restitution_a: cv_a,
            cv_restitution_b: cv_b,
            cv_restitution_c: cv_c,
            cv_restitution_d: cv_d,
            apd_restitution_a: apd_a,
            apd_restitution_b: apd_b,
            apd_restitution_c: apd_c,
            apd_restitution_d: apd_d,
            erp_s2_absence: absence(|o| o.erp_s2),
            erp_s3_absence: absence(|o| o.erp_s3),
        }
    }
}

/// One beat of a restitution curve.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs, reason = "the fields are those of `Beat`, each with its unit")]
pub struct CurveRow {
    /// Row of the table of parameters, from 0.
    pub row: usize,
    pub s2_ms: u32,
    pub cv_m_per_s: Option<f64>,
    pub apd20_ms: Option<f64>,
    pub apd30_ms: Option<f64>,
    pub apd50_ms: Option<f64>,
    pub apd90_ms: Option<f64>,
    /// Why there is no beat; empty where there is one.
    pub absence: Option<String>,
}

impl CurveRow {
    /// The beat at `s2` of the table's row number `row` (from 0).
    pub fn new(row: usize, s2: u32, beat: Result<Beat, Absence>) -> Self {
        let ms =
            |of: fn(&Beat) -> Option<f64>| beat.ok().and_then(|b| of(&b)).map(|x| rounded(x, 1e3));
        Self {
            row,
            s2_ms: s2,
            cv_m_per_s: beat.ok().map(|b| rounded(b.cv, 1e5)),
            apd20_ms: ms(|b| b.apd20),
            apd30_ms: ms(|b| b.apd30),
            apd50_ms: ms(|b| b.apd50),
            apd90_ms: ms(|b| Some(b.apd90)),
            absence: beat.err().map(|absence| absence.to_string()),
        }
    }
}

/// `value` to one part in `per_unit`, so that tables are short to read.
pub(crate) fn rounded(value: f64, per_unit: f64) -> f64 {
    (value * per_unit).round() / per_unit
}

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

#[cfg(test)]
mod tests {
    use super::*;
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
        assert!(message("").starts_with("FILE has no rows"));
        let missing = read("tau_in_ms\n1\n").unwrap_err();
        assert!(
            missing.starts_with("FILE has no column cv_max_m_per_s; it has: tau_in_ms\n"),
            "{missing}"
        );
    }

    fn written(row: OutcomeRow) -> Vec<(String, String)> {
        let file = tempfile::NamedTempFile::new().unwrap();
        finish_rows(new_file(file.path()).unwrap(), &[row]).unwrap();
        let mut reader = csv::Reader::from_path(file.path()).unwrap();
        let header = reader.headers().unwrap().clone();
        let cells = reader.records().next().unwrap().unwrap();
        header.iter().map(String::from).zip(cells.iter().map(String::from)).collect()
    }

    #[test]
    fn absent_values_are_empty_cells_with_a_reason() {
        let beat = Ok(Beat {
            cv: 0.712_345_6,
            apd20: None,
            apd30: Some(90.0),
            apd50: Some(140.0),
            apd90: 201.25,
        });
        let outcome = Ok(StripOutcome {
            s1: beat,
            erp_s2: Ok(310),
            s2: Err(Absence::NoActivation),
            erp_s3: Err(Absence::NoActivation),
            restitution: vec![],
        });
        let parameters = Parameters::from_array([0.7, 0.05, 10.0, 120.0, 200.0]);
        let cells = written(OutcomeRow::new(3, parameters, &outcome));
        let cell = |name: &str| cells.iter().find(|(n, _)| n == name).unwrap().1.as_str();
        assert_eq!(
            [cell("cv_s1_m_per_s"), cell("apd50_s1_ms"), cell("apd90_s1_ms")],
            ["0.71235", "140.0", "201.25"]
        );
        assert_eq!([cell("erp_s2_ms"), cell("erp_s2_absence")], ["310", ""]);
        assert_eq!([cell("apd90_s2_ms"), cell("erp_s3_ms"), cell("cv_restitution_a")], [""; 3]);
        assert_eq!(
            cell("erp_s3_absence"),
            "the conditioning stimulus did not activate the whole strip"
        );
    }

    #[test]
    fn a_set_out_of_range_is_an_absence() {
        let parameters = Parameters::from_array([0.7, 0.05, 10.0, 120.0, 900.0]);
        let out = Err(parameters.validate().unwrap_err());
        let cells = written(OutcomeRow::new(0, parameters, &out));
        let reasons = cells.iter().filter(|(_, cell)| {
            cell == "apd_max = 900 ms is outside its valid range 120 to 270 ms"
        });
        assert_eq!(reasons.count(), 2);
        assert!(cells[8..28].iter().all(|(_, cell)| cell.is_empty()));
    }
}
