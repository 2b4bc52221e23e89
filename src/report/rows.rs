//! Every measurement beside what is predicted of it: `rows.csv`, and the share of them in their intervals.

use std::path::Path;

use serde::Serialize;

use super::ReportError;
use crate::store::write_file;
use crate::table::{Measurements, SITE, as_cell, from_cell};

/// Shares of probability of the central intervals that measurements are counted in.
pub const LEVELS: [f64; 4] = [0.5, 0.8, 0.9, 0.95];
/// Which of [`LEVELS`] the page draws and `rows.csv` tells.
const NINETY: usize = 2;

/// What is predicted of one measurement, noise included; of a bracket, of its middle.
#[derive(Clone, Debug)]
pub struct Predicted {
    /// 5, 50 and 95 % quantiles; NaN if nothing is predicted.
    pub quantiles: [f64; 3],
    /// Whether the measurement lies in the central interval of each of [`LEVELS`]. A bracket does if it
    /// is one of those between the ends of the interval, on the grid of its own width.
    pub inside: [bool; 4],
}

/// How a measurement was left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LeftOutBy {
    /// By Pareto-smoothed importance weights of the posterior's draws.
    Weights,
    /// By such weights, with the coefficients of the fields integrated out.
    Integrated,
    /// In a fit of its own.
    Fit,
}

impl LeftOutBy {
    /// From the cheapest to the dearest.
    pub const ALL: [Self; 3] = [Self::Weights, Self::Integrated, Self::Fit];

    /// Its name in a table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Weights => "weights",
            Self::Integrated => "integrated",
            Self::Fit => "fit",
        }
    }

    /// That of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|by| by.name() == name)
    }
}

/// One measurement and its predictions.
#[derive(Clone, Debug)]
pub struct PredictedRow {
    /// Line of the table.
    pub line: u64,
    /// Its `observe` statement.
    pub protocol: String,
    /// Its site: the label in the table, else its vertex; empty if it has neither.
    pub site: String,
    /// Unit of all its numbers.
    pub unit: String,
    /// The ends of a bracket, infinite where it is open; of a number, twice the number.
    pub measured: [f64; 2],
    /// From the posterior, which has seen it.
    pub fitted: Predicted,
    /// From all other measurements; absent where that is not known.
    pub left_out: Option<(Predicted, LeftOutBy)>,
}

/// All measurements, and those that belong together.
#[derive(Clone, Debug, Default)]
pub struct Predictions {
    /// In the order of the model's statements.
    pub rows: Vec<PredictedRow>,
    /// Names of sets, with indices into `rows`: all, each statement, each label of a text column.
    pub sets: Vec<(String, Vec<usize>)>,
}

/// How many measurements of a set lie in their intervals.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Count {
    pub(super) n: usize,
    /// For each of [`LEVELS`].
    pub(super) inside: [usize; 4],
}

impl Count {
    fn of<'p>(all: impl Iterator<Item = &'p Predicted>) -> Self {
        all.fold(Self::default(), |mut count, predicted| {
            count.n += 1;
            for (n, is_inside) in count.inside.iter_mut().zip(predicted.inside) {
                *n += usize::from(is_inside);
            }
            count
        })
    }
}

impl Predictions {
    /// Of a set: with the measurements, and from the others alone.
    pub(super) fn counts(&self, set: &[usize]) -> [Count; 2] {
        let rows = || set.iter().map(|i| &self.rows[*i]);
        let left_out = rows().filter_map(|row| Some(&row.left_out.as_ref()?.0));
        [Count::of(rows().map(|row| &row.fitted)), Count::of(left_out)]
    }
}

impl Predicted {
    /// Whether the measurement lies in the central 90 % interval.
    pub fn is_inside(&self) -> bool {
        self.inside[NINETY]
    }

    fn cells(&self) -> [String; 4] {
        let [q5, q50, q95] = self.quantiles.map(|q| q.to_string());
        [q5, q50, q95, self.is_inside().to_string()]
    }
}

impl PredictedRow {
    /// A row of a table, of which nothing is predicted yet.
    pub fn at(table: &Measurements, row: usize, protocol: &str, unit: &str) -> Self {
        let site = table.cell(row, SITE).map(str::to_owned);
        let vertex = || table.vertex(row).map(|v| v.to_string());
        Self {
            line: table.line(row),
            protocol: protocol.to_owned(),
            site: site.or_else(vertex).unwrap_or_default(),
            unit: unit.to_owned(),
            measured: [f64::NAN; 2],
            fitted: Predicted { quantiles: [f64::NAN; 3], inside: [false; LEVELS.len()] },
            left_out: None,
        }
    }

    /// Whether there is a measurement.
    pub fn is_measured(&self) -> bool {
        !self.measured[0].is_nan()
    }

    /// Line and site, in words.
    pub(super) fn place(&self) -> String {
        match self.site.as_str() {
            "" => format!("line {}", self.line),
            site => format!("line {} (site {site})", self.line),
        }
    }

    /// Line, site, protocol, unit, and what was measured.
    fn head(&self) -> Vec<String> {
        let known = |x: f64| if x.is_nan() { String::new() } else { x.to_string() };
        let [lower, upper] = self.measured.map(known);
        let unit = super::text::shown(&self.unit).to_owned();
        vec![
            self.line.to_string(),
            as_cell(&self.site),
            as_cell(&self.protocol),
            unit,
            lower,
            upper,
        ]
    }

    fn cells(&self) -> Vec<String> {
        let mut cells = self.head();
        cells.extend(self.fitted.cells());
        match &self.left_out {
            Some((predicted, by)) => {
                cells.extend(predicted.cells());
                cells.push(by.name().to_owned());
            }
            None => cells.extend(std::iter::repeat_n(String::new(), 5)),
        }
        cells
    }
}

/// Titles of `rows.csv`.
const TITLES: [&str; 15] = [
    "line",
    "site",
    "protocol",
    "unit",
    "measured_lower",
    "measured_upper",
    "predicted_q5",
    "predicted_q50",
    "predicted_q95",
    "inside",
    "loo_q5",
    "loo_q50",
    "loo_q95",
    "loo_inside",
    "loo_by",
];

/// Writes `rows.csv`, one line per measurement; `inside` asks for the central 90 % interval.
///
/// # Errors
/// [`ReportError::Write`].
pub fn write_rows(path: &Path, rows: &[PredictedRow]) -> Result<(), ReportError> {
    write_file(path, |file| {
        let mut table = csv::Writer::from_writer(file);
        table.write_record(TITLES)?;
        rows.iter().try_for_each(|row| table.write_record(row.cells()))?;
        table.flush()
    })
    .map_err(ReportError::write(path))
}

/// A row of a table that was not fitted: what is predicted of it, and moments of the prediction.
#[derive(Clone, Copy, Debug)]
pub struct Forecasted<'f> {
    /// The row.
    pub row: &'f PredictedRow,
    /// Posterior mean of the value about which the likelihood spreads.
    pub expected: f64,
    /// Mean of replicates, noise included.
    pub mean: f64,
    /// Their standard deviation.
    pub sd: f64,
}

/// Writes `predictions.csv`, one line per row; `inside` is empty where nothing was measured.
///
/// # Errors
/// [`ReportError::Write`].
pub fn write_forecast<'f>(
    path: &Path,
    rows: impl Iterator<Item = Forecasted<'f>>,
) -> Result<(), ReportError> {
    write_file(path, |file| {
        let mut table = csv::Writer::from_writer(file);
        let moments = ["expected", "mean", "sd"];
        table.write_record(TITLES[..6].iter().chain(&moments).chain(&TITLES[6..10]))?;
        for Forecasted { row, expected, mean, sd } in rows {
            let mut cells = row.head();
            cells.extend([expected, mean, sd].map(|x| x.to_string()));
            let [quantiles @ .., inside] = row.fitted.cells();
            cells.extend(quantiles);
            cells.push(if row.is_measured() { inside } else { String::new() });
            table.write_record(cells)?;
        }
        table.flush()
    })
    .map_err(ReportError::write(path))
}

/// Reads what [`write_rows`] wrote. Of [`LEVELS`] the file tells the central 90 % interval alone, and so do the rows:
/// `inside` is four times the same.
///
/// # Errors
/// [`ReportError::Malformed`].
pub fn read_rows(path: &Path) -> Result<Vec<PredictedRow>, ReportError> {
    let malformed = |reason: String| ReportError::Malformed { path: path.to_owned(), reason };
    let mut reader = csv::Reader::from_path(path).map_err(|error| malformed(error.to_string()))?;
    let read = |record: Result<csv::StringRecord, csv::Error>| {
        let record = record.map_err(|error| malformed(error.to_string()))?;
        let line = record.position().map_or(0, csv::Position::line);
        row_of(&record).ok_or_else(|| malformed(format!("line {line} is no row of predictions")))
    };
    reader.records().map(read).collect()
}

fn row_of(record: &csv::StringRecord) -> Option<PredictedRow> {
    let number = |at: usize| record.get(at)?.parse::<f64>().ok();
    let predicted = |at: usize| {
        let quantiles = [number(at)?, number(at + 1)?, number(at + 2)?];
        Some(Predicted { quantiles, inside: [record.get(at + 3)?.parse().ok()?; 4] })
    };
    let by = LeftOutBy::named(record.get(14)?);
    Some(PredictedRow {
        line: record.get(0)?.parse().ok()?,
        site: from_cell(record.get(1)?).to_owned(),
        protocol: from_cell(record.get(2)?).to_owned(),
        unit: record.get(3)?.to_owned(),
        measured: [number(4)?, number(5)?],
        fitted: predicted(6)?,
        left_out: predicted(10).zip(by),
    })
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;

    #[test]
    fn the_table_has_a_line_per_measurement() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.csv");
        write_rows(&path, &samples::predictions().rows[..3]).unwrap();
        insta::assert_snapshot!(std::fs::read_to_string(&path).unwrap(), @r"
        line,site,protocol,unit,measured_lower,measured_upper,predicted_q5,predicted_q50,predicted_q95,inside,loo_q5,loo_q50,loo_q95,loo_inside,loo_by
        2,1,s1s2,ms,230,240,225,235,245,true,230,240,250,true,weights
        3,2,s1s2,ms,240,250,225,235,245,true,,,,,
        4,3,s1s2,ms,290,300,225,235,245,false,215,225,235,false,fit
        ");
    }

    #[test]
    fn rows_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.csv");
        let mut rows = samples::predictions().rows;
        rows[1].measured[1] = f64::INFINITY;
        write_rows(&path, &rows).unwrap();
        let read = read_rows(&path).unwrap();
        let cells =
            |rows: &[PredictedRow]| rows.iter().map(PredictedRow::cells).collect::<Vec<_>>();
        assert_eq!(cells(&read), cells(&rows));
        std::fs::write(&path, "line,site\n2,1\n").unwrap();
        let refusal = read_rows(&path).unwrap_err().to_string();
        assert!(refusal.contains("line 2 is no row of predictions"), "{refusal}");
    }

    #[test]
    fn sets_are_counted_with_and_without_each_measurement() {
        let predictions = samples::predictions();
        let [fitted, left_out] = predictions.counts(&[0, 1, 2]);
        assert_eq!(fitted, Count { n: 3, inside: [1, 2, 2, 2] });
        assert_eq!(left_out, Count { n: 2, inside: [0, 1, 1, 2] });
    }
}
