//! Tables and pictures of one paced cell.

use std::path::Path;

use super::{Curves, ReportError};
use crate::ep::paced_cell::{RestitutionPoint, Sample};
use crate::store::write_file;

/// Names of the durations, in the order of `CellBeat::apd`.
const APD: [&str; 4] = ["APD20", "APD30", "APD50", "APD90"];

/// Writes V and h in time: `trace.csv` and `trace.svg` in `folder`.
///
/// # Errors
/// [`ReportError::Write`].
pub fn write_trace(folder: &Path, trace: &[Sample]) -> Result<(), ReportError> {
    let rows =
        trace.iter().map(|s| vec![format!("{:.1}", s.time), s.v.to_string(), s.h.to_string()]);
    write_table(&folder.join("trace.csv"), &["time_ms", "v", "h"], rows)?;
    let curve = |of: fn(&Sample) -> f64| trace.iter().map(|s| [s.time, of(s)]).collect();
    let curves = [("V", curve(|s| s.v)), ("h", curve(|s| s.h))];
    let plot = Curves { x: "time (ms)", y: "V and h", curves: &curves, marks: false };
    plot.write(&folder.join("trace.svg"))
}

/// Writes APD over the diastolic interval: `restitution.csv` and `restitution.svg` in `folder`. What is
/// not captured has empty cells.
///
/// # Errors
/// [`ReportError::Write`].
pub fn write_restitution(folder: &Path, curve: &[RestitutionPoint]) -> Result<(), ReportError> {
    let row = |point: &RestitutionPoint| {
        let apd = |k: usize| point.beat.map_or(String::new(), |beat| beat.apd[k].to_string());
        let mut row = vec![point.s2.to_string(), point.di.to_string()];
        row.extend((0..4).map(apd));
        row
    };
    let header = ["s2_ms", "di_ms", "apd20_ms", "apd30_ms", "apd50_ms", "apd90_ms"];
    write_table(&folder.join("restitution.csv"), &header, curve.iter().map(row))?;
    let of = |k: usize| {
        let points = curve.iter().filter_map(|p| Some([p.di, p.beat?.apd[k]]));
        (APD[k], points.collect())
    };
    let curves = [of(0), of(1), of(2), of(3)];
    let x = "diastolic interval (ms)";
    let plot = Curves { x, y: "action potential duration (ms)", curves: &curves, marks: true };
    plot.write(&folder.join("restitution.svg"))
}

fn write_table(
    path: &Path,
    header: &[&str],
    rows: impl Iterator<Item = Vec<String>>,
) -> Result<(), ReportError> {
    write_file(path, |file| {
        let mut table = csv::Writer::from_writer(file);
        table.write_record(header)?;
        for row in rows {
            table.write_record(row)?;
        }
        table.flush()
    })
    .map_err(ReportError::write(path))
}
