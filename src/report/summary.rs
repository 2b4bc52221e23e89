//! `summary.csv` and `summary.json`: one line per scalar quantity.

use serde_json::{Map, Value, json};
use std::fs;
use std::io::Write as _;
use std::path::Path;

use super::ReportError;
use crate::diagnostics::Summary;
use crate::store::write_file;

/// The posterior summary of one scalar quantity, with its name and unit.
#[derive(Clone, Debug)]
pub struct Row {
    /// Name, e.g. `tau_out.alpha` or `tau_out.eta[3]`.
    pub name: String,
    /// Unit as declared in the model, empty if none.
    pub unit: String,
    /// Moments, quantiles and diagnostics, in that unit.
    pub summary: Summary,
}

/// The columns between name and unit, in the order written.
const COLUMNS: [&str; 9] =
    ["mean", "sd", "mcse", "q5", "q50", "q95", "ess_bulk", "ess_tail", "r_hat"];

/// What `summary.json` holds besides: to how many digits the others are known.
const ERRORS: [&str; 4] = ["mcse_sd", "mcse_q5", "mcse_q50", "mcse_q95"];

/// The values of [`COLUMNS`].
fn values(summary: &Summary) -> [f64; 9] {
    let Summary { mean, sd, mcse, q5, q50, q95, ess_bulk, ess_tail, r_hat, .. } = *summary;
    [mean, sd, mcse, q5, q50, q95, ess_bulk, ess_tail, r_hat]
}

/// The values of [`ERRORS`].
fn errors(summary: &Summary) -> [f64; 4] {
    [summary.mcse_sd, summary.mcse_q5, summary.mcse_q50, summary.mcse_q95]
}

/// Writes the rows as a table with the columns `name, mean, …, r_hat, unit`; a number that is not finite is empty.
///
/// # Errors
/// [`ReportError::Write`].
pub fn write_summary_csv(path: &Path, rows: &[Row]) -> Result<(), ReportError> {
    write_file(path, |file| {
        let mut table = csv::Writer::from_writer(file);
        table.write_record(["name"].into_iter().chain(COLUMNS).chain(["unit"]))?;
        for row in rows {
            let cell = |v: f64| if v.is_finite() { format!("{v:?}") } else { String::new() };
            let numbers = values(&row.summary).map(cell);
            let cells = [row.name.as_str()].into_iter().chain(numbers.iter().map(String::as_str));
            table.write_record(cells.chain([row.unit.as_str()]))?;
        }
        table.flush()
    })
    .map_err(ReportError::write(path))
}

/// Writes the rows as an object by name, with the errors of every figure; a number that is not finite is null.
///
/// # Errors
/// [`ReportError::Write`].
pub fn write_summary_json(path: &Path, rows: &[Row]) -> Result<(), ReportError> {
    let quantities = rows.iter().map(|row| {
        let errors = ERRORS.into_iter().zip(errors(&row.summary));
        let numbers = COLUMNS.into_iter().zip(values(&row.summary)).chain(errors);
        let mut entry: Map<_, _> = numbers.map(|(key, v)| (key.to_owned(), json!(v))).collect();
        entry.insert("unit".to_owned(), json!(row.unit));
        (row.name.clone(), Value::Object(entry))
    });
    let quantities = Value::Object(quantities.collect());
    write_file(path, |file| writeln!(file, "{quantities:#}")).map_err(ReportError::write(path))
}

/// Reads what [`write_summary_json`] wrote, in the same order; null becomes NaN.
///
/// # Errors
/// [`ReportError::Read`] and [`ReportError::Malformed`].
pub fn read_summary_json(path: &Path) -> Result<Vec<Row>, ReportError> {
    let malformed = |reason: String| ReportError::Malformed { path: path.to_owned(), reason };
    let text = fs::read_to_string(path).map_err(ReportError::read(path))?;
    let quantities: Map<String, Value> =
        serde_json::from_str(&text).map_err(|error| malformed(error.to_string()))?;
    let row = |(name, entry): (String, Value)| {
        let unit = entry["unit"].as_str().map(str::to_owned);
        let unit = unit.ok_or_else(|| malformed(format!("{name} has no unit")))?;
        let summary = read_summary(&entry)
            .ok_or_else(|| malformed(format!("{name} lacks one of {COLUMNS:?}, {ERRORS:?}")))?;
        Ok(Row { name, unit, summary })
    };
    quantities.into_iter().map(row).collect()
}

fn read_summary(entry: &Value) -> Option<Summary> {
    let number = |key: &str| match entry.get(key)? {
        Value::Null => Some(f64::NAN),
        value => value.as_f64(),
    };
    Some(Summary {
        mean: number("mean")?,
        sd: number("sd")?,
        mcse: number("mcse")?,
        q5: number("q5")?,
        q50: number("q50")?,
        q95: number("q95")?,
        ess_bulk: number("ess_bulk")?,
        ess_tail: number("ess_tail")?,
        r_hat: number("r_hat")?,
        mcse_sd: number("mcse_sd")?,
        mcse_q5: number("mcse_q5")?,
        mcse_q50: number("mcse_q50")?,
        mcse_q95: number("mcse_q95")?,
    })
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;

    #[test]
    fn both_files_hold_the_same_numbers_and_one_their_errors() {
        let folder = tempfile::tempdir().unwrap();
        let [csv, json] = ["summary.csv", "summary.json"].map(|name| folder.path().join(name));
        let rows =
            [samples::row("tau_out.m", "ms", 12.3), samples::row("b[1, left]", "", f64::NAN)];
        write_summary_csv(&csv, &rows).unwrap();
        write_summary_json(&json, &rows).unwrap();
        insta::assert_snapshot!(fs::read_to_string(&csv).unwrap(), @r#"
        name,mean,sd,mcse,q5,q50,q95,ess_bulk,ess_tail,r_hat,unit
        tau_out.m,12.3,1.2300000000000002,0.030750000000000006,10.2828,12.3,14.317200000000001,1600.0,1512.7,1.0021,ms
        "b[1, left]",,,,,,,1600.0,1512.7,1.0021,
        "#);
        insta::assert_snapshot!(fs::read_to_string(&json).unwrap(), @r#"
        {
          "tau_out.m": {
            "mean": 12.3,
            "sd": 1.2300000000000002,
            "mcse": 0.030750000000000006,
            "q5": 10.2828,
            "q50": 12.3,
            "q95": 14.317200000000001,
            "ess_bulk": 1600.0,
            "ess_tail": 1512.7,
            "r_hat": 1.0021,
            "mcse_sd": 0.021964285714285717,
            "mcse_q5": 0.06473684210526316,
            "mcse_q50": 0.038437500000000006,
            "mcse_q95": 0.06473684210526316,
            "unit": "ms"
          },
          "b[1, left]": {
            "mean": null,
            "sd": null,
            "mcse": null,
            "q5": null,
            "q50": null,
            "q95": null,
            "ess_bulk": 1600.0,
            "ess_tail": 1512.7,
            "r_hat": 1.0021,
            "mcse_sd": null,
            "mcse_q5": null,
            "mcse_q50": null,
            "mcse_q95": null,
            "unit": ""
          }
        }
        "#);
        let read = read_summary_json(&json).unwrap();
        assert_eq!(format!("{read:?}"), format!("{rows:?}"));
    }

    #[test]
    fn an_edited_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("summary.json");
        fs::write(&path, r#"{"rho": {"mean": 1, "unit": "mm"}}"#).unwrap();
        let text = read_summary_json(&path).unwrap_err().to_string();
        assert!(text.contains("summary.json: rho lacks one of"), "{text}");
    }
}
