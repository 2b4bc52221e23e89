//! A mesh as `NumPy` arrays, .npz: `points` (n, 3), `triangles` (m, 3), and data. An array of n rows, or
//! named `point_data/NAME`, is point data; one of m rows, or named `cell_data/NAME`, is cell data.

use super::content::{Cells, Content};
use super::geometry::{Geometry, Rows};
use super::{Array, Data, MeshError, Place, Units};
use crate::store::npy::{self, Npy};
use crate::store::{MOST_INFLATED, NpzWriter, Packing, array_name, write_file};
use std::collections::BTreeMap;
use std::io::{self, Cursor, Read as _, Seek, Write};
use std::path::Path;
use zip::ZipArchive;

/// A scalar that eplat writes: mm in one unit of the coordinates.
const SCALE: &str = "mm_per_unit";

/// Reads `bytes`, the content of `path`.
///
/// # Errors
/// `Parse`, `IndexOutOfRange`.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Content, MeshError> {
    let wrong = |expected: &str, got: String| MeshError::Parse {
        path: path.into(),
        place: Place::Byte(0),
        expected: expected.into(),
        got,
    };
    let mut arrays = unzip(bytes).map_err(|got| wrong("an .npz file of numbers", got))?;
    let mut matrix = |names: [&str; 2], what: &str| {
        let found = names.iter().find_map(|name| arrays.remove(*name));
        let shape = found
            .as_ref()
            .map_or_else(|| "no such array".into(), |a| format!("shape {:?}", a.shape));
        let matrix = found.filter(|a| a.shape.len() == 2 && a.shape[1] == 3);
        matrix.ok_or_else(|| wrong(&format!("an array `{}`, {what} × 3", names[0]), shape))
    };
    let points = matrix(["points", "vertices"], "points")?;
    let triangles = matrix(["triangles", "faces"], "triangles")?;
    let vertices: Vec<[f64; 3]> = points.values.as_chunks().0.to_vec();
    let mut cells = Cells::new(vertices.len());
    for t in triangles.values.as_chunks::<3>().0 {
        cells.polygon(&t.map(|v| if v.fract() == 0.0 { v as i64 } else { -1 }))?;
    }
    let scale = arrays.remove(SCALE).and_then(|scale| scale.values.first().copied());
    let units = Units::ALL.into_iter().find(|units| scale == Some(units.in_mm()));
    let (n, m) = (vertices.len(), cells.len());
    let (mut point_data, mut cell_data) = (Data::new(), Data::new());
    for (name, array) in arrays {
        let n_rows = array.shape.first().copied().unwrap_or(0);
        let width = array.values.len() / n_rows.max(1);
        if width == 0 {
            continue;
        }
        let (data, rows, short) = match name.split_once('/') {
            Some(("cell_data", short)) => (&mut cell_data, m, short),
            Some(("point_data", short)) => (&mut point_data, n, short),
            _ if n_rows == n => (&mut point_data, n, name.as_str()),
            _ => (&mut cell_data, m, name.as_str()),
        };
        if n_rows == rows {
            data.insert(short.to_owned(), Array::new(width, array.values));
        }
    }
    Ok(Content { units, ..cells.into_content(vertices, point_data, cell_data) })
}

/// The numeric arrays of an archive, by name; others are left out.
fn unzip(bytes: &[u8]) -> Result<BTreeMap<String, Npy>, String> {
    let broken = |error: &dyn std::fmt::Display| format!("a broken archive: {error}");
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| broken(&e))?;
    let mut arrays = BTreeMap::new();
    let mut budget = MOST_INFLATED * bytes.len() as u64;
    for index in 0..archive.len() {
        let entry = archive.by_index(index).map_err(|e| broken(&e))?;
        let name = entry.name().map_err(|e| broken(&e))?.into_owned();
        let Some(name) = array_name(&name) else { continue };
        let mut inflated = vec![];
        entry.take(budget + 1).read_to_end(&mut inflated).map_err(|e| broken(&e))?;
        let left = budget.checked_sub(inflated.len() as u64);
        budget = left.ok_or("more than an honest file inflates to")?;
        if let Some(array) = npy::parse(&inflated).map_err(|got| format!("{got} in {name}"))? {
            arrays.insert(name.to_owned(), array);
        }
    }
    Ok(arrays)
}

/// Writes a surface with its arrays.
///
/// # Errors
/// `Write`.
pub(super) fn write(path: &Path, geometry: &Geometry) -> Result<(), MeshError> {
    write_file(path, |file| write_arrays(file, geometry))
        .map_err(|source| MeshError::Write { path: path.into(), source })
}

fn write_arrays(writer: impl Write + Seek, geometry: &Geometry) -> io::Result<()> {
    let mut archive = NpzWriter::new(writer, Packing::Deflated);
    let (n, m) = (geometry.vertices.len() as u64, geometry.triangles.len() as u64);
    archive.array("points", &[n, 3], geometry.vertices.as_flattened())?;
    archive.array("triangles", &[m, 3], geometry.triangles.as_flattened())?;
    archive.array(SCALE, &[1], &[1.0])?;
    for (section, data) in
        [("point_data", &geometry.point_data), ("cell_data", &geometry.cell_data)]
    {
        for Rows { name, width, values } in data {
            let shape = [(values.len() / width) as u64, *width as u64];
            let shape = if *width == 1 { &shape[..1] } else { &shape[..] };
            archive.array(&format!("{section}/{name}"), shape, values)?;
        }
    }
    archive.finish()
}
