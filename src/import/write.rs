//! The folder that an import makes: `surface.vtp`, `measurements.csv` and `import.json`.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde_json::{Value as Json, json};

use super::{ImportError, Options, QUANTITIES, Row, Selected, Source, Study, Value};
use crate::mesh::{Encoding, MeshError};
use crate::store::{put_back, seals, write_folder};
use crate::table::csv_line;

const SURFACE: &str = "surface.vtp";
const TABLE: &str = "measurements.csv";
const RECORD: &str = "import.json";

/// Writes what was selected of a study to the folder `out`, whole or not at all; the record names the other files. An
/// earlier import that it replaces is there until the new one is.
///
/// # Errors
/// [`ImportError::Exists`]: the folder is there and holds something, and is no earlier import that `force`
/// allows to replace, or other files lie in it, too. [`ImportError::Write`].
pub fn write(
    out: &Path,
    force: bool,
    selected: &Selected,
    record: &Json,
) -> Result<(), ImportError> {
    let unwritable = |source: io::Error| ImportError::Write { path: out.into(), source };
    put_back(out).map_err(unwritable)?;
    let is_empty = || fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_none());
    let is_import = out.join(RECORD).is_file();
    if out.exists() && !is_empty() && !(force && is_import) {
        return Err(ImportError::Exists { path: out.into() });
    }
    if let Some(path) = foreign(out) {
        return Err(ImportError::Foreign { path });
    }
    if let Some(above) = out.parent() {
        fs::create_dir_all(above).map_err(unwritable)?;
    }
    let fill = |folder: &Path| {
        if let Some(surface) = &selected.surface {
            let path = folder.join(SURFACE);
            surface.write(&path, Encoding::Binary).map_err(MeshError::into_cause)?;
        }
        if !selected.rows.is_empty() {
            fs::write(folder.join(TABLE), table(selected))?;
        }
        let there = [SURFACE, TABLE].into_iter().filter(|name| folder.join(name).exists());
        let mut record = record.clone();
        record["files"] = json!(seals(folder, there)?);
        fs::write(folder.join(RECORD), format!("{record:#}\n"))
    };
    write_folder(out, fill).map_err(unwritable)
}

/// What lies in a folder and is of no import.
fn foreign(out: &Path) -> Option<PathBuf> {
    let entries = fs::read_dir(out).into_iter().flatten().flatten();
    let is_own =
        |path: &PathBuf| [SURFACE, TABLE, RECORD].iter().any(|name| *path == out.join(name));
    entries.map(|entry| entry.path()).find(|path| !is_own(path))
}

/// The rows as CSV. Columns that are empty in every row are left out.
fn table(selected: &Selected) -> String {
    let mut header = vec!["site", "vertex", "x", "y", "z", "protocol", "value", "lower", "upper"];
    header.extend(["source", "off_surface_mm"]);
    let fixed = header.len();
    let known: std::collections::BTreeSet<&str> =
        selected.rows.iter().flat_map(|row| row.cells.keys().map(String::as_str)).collect();
    header.extend(known);
    let source = selected.source.map(|vertex| vertex.to_string()).unwrap_or_default();
    let cells = |row: &Row| -> Vec<String> {
        let [value, lower, upper] = match row.reading.value {
            Value::Number(x) => [number(x), String::new(), String::new()],
            Value::Bracket(lower, upper) => {
                let end = |end: Option<f64>| end.map(number).unwrap_or_default();
                [String::new(), end(lower), end(upper)]
            }
        };
        let [x, y, z] = row.place.map(number);
        let vertex = row.vertex.map(|vertex| vertex.to_string()).unwrap_or_default();
        let off = rounded(row.off_surface, 1e3);
        let (site, protocol) = (row.site.clone(), row.reading.protocol.clone());
        let mut cells =
            vec![site, vertex, x, y, z, protocol, value, lower, upper, source.clone(), number(off)];
        let other = |name: &&str| row.cells.get(*name).cloned().unwrap_or_default();
        cells.extend(header[fixed..].iter().map(other));
        cells
    };
    let rows: Vec<Vec<String>> = selected.rows.iter().map(cells).collect();
    let is_filled = |k: &usize| rows.iter().any(|row| !row[*k].is_empty());
    let filled: Vec<usize> = (0..header.len()).filter(is_filled).collect();
    let header = csv_line(filled.iter().map(|k| header[*k]));
    let line = |row: &Vec<String>| csv_line(filled.iter().map(|k| row[*k].as_str()));
    rows.iter().map(line).fold(header, |csv, line| csv + &line)
}

/// A number as text; NaN is an empty cell.
fn number(x: f64) -> String {
    if x.is_nan() { String::new() } else { x.to_string() }
}

fn rounded(x: f64, scale: f64) -> f64 {
    (x * scale).round() / scale
}

impl Selected {
    /// Number of measurements of each protocol.
    pub fn counts(&self) -> BTreeMap<&str, usize> {
        let mut counts = BTreeMap::new();
        for row in &self.rows {
            *counts.entry(row.reading.protocol.as_str()).or_default() += 1;
        }
        counts
    }

    /// The record of the import: where it comes from, what was taken, what was left out and why.
    pub fn record(
        &self,
        path: &Path,
        study: &Study,
        sources: &[Source],
        options: &Options,
    ) -> Json {
        let units: BTreeMap<&str, &str> = self
            .counts()
            .keys()
            .map(|protocol| {
                let own = QUANTITIES.iter().find(|(name, _)| name == protocol);
                (*protocol, own.map_or("ms", |(_, unit)| *unit))
            })
            .collect();
        let surface = self.surface.as_ref().map(|surface| {
            json!({
                "n_vertices": surface.mesh.n_vertices(),
                "n_triangles": surface.mesh.n_triangles(),
                "area_cm2": rounded(surface.mesh.area() / 100.0, 10.0),
                "unit": "mm",
            })
        });
        json!({
            "eplat": env!("CARGO_PKG_VERSION"),
            "path": path.display().to_string(),
            "format": study.format,
            "map": self.map.name,
            "other_maps": study.maps.iter().map(|map| map.name.as_str()).collect::<Vec<_>>(),
            "options": {
                "within_mm": options.within,
                "thin_mm": options.thin,
                "mesh_values": options.mesh_values,
                "source": self.source,
            },
            "surface": surface,
            "measurements": self.counts(),
            "units": units,
            "from_mesh_values": self.is_on_mesh,
            "off_surface_mm": distances(&self.rows),
            "left_out": self.map.left_out,
            "remarks": study.remarks.iter().chain(&self.map.remarks).collect::<Vec<_>>(),
            "sources": sources,
        })
    }
}

/// How far the sites of rows lie from the surface: see [`histogram`].
pub fn distances(rows: &[Row]) -> Vec<(String, usize)> {
    histogram(rows.iter().map(|row| (row.site.as_str(), row.off_surface)).collect())
}

/// For each range of distances in mm, how many sites lie so far from the surface; nothing where no
/// distance is known. A site counts once.
pub fn histogram(mut sites: Vec<(&str, f64)>) -> Vec<(String, usize)> {
    const ENDS: [f64; 7] = [0.0, 1.0, 2.0, 3.0, 5.0, 10.0, f64::INFINITY];
    sites.retain(|(_, distance)| distance.is_finite());
    sites.sort_by(|a, b| a.0.cmp(b.0));
    sites.dedup_by(|a, b| a.0 == b.0);
    let range = |ends: &[f64]| {
        let n = sites.iter().filter(|(_, d)| *d >= ends[0] && *d < ends[1]).count();
        let to = if ends[1].is_finite() { format!("to {}", ends[1]) } else { "and more".into() };
        (format!("{} {to} mm", ends[0]), n)
    };
    if sites.is_empty() { vec![] } else { ENDS.windows(2).map(range).collect() }
}
