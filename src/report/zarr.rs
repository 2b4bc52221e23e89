//! A small writer of Zarr version 3 folders that xarray, and so `arviz.from_zarr`, opens.
//!
//! What it writes: groups one level deep, arrays of float64, int64, bool and string, gzip, one chunk per chain
//! (else one chunk per array), named dimensions, coordinates, and consolidated metadata.  It knows nothing of what
//! the arrays mean.
//!
//! # Source
//! Zarr core specification version 3; `string` and `vlen-utf8` as in the zarr-extensions registry.

use flate2::{Compression, read::GzDecoder, write::GzEncoder};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::borrow::Borrow;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{self, BufWriter, Read as _, Write as _};
use std::ops::Range;
use std::path::Path;

use super::{Group, ReportError, Values, Variable};
use crate::store::{cache, write_folder};

/// Bytes that are packed at once.
const PIECE: usize = 1 << 16;

/// Between the numbers in the name of a chunk's file. With `/` each would be a folder: in the default run 179 more to make.
const SEPARATOR: &str = ".";

/// Metadata of every group and array by its path below the root, in the order written.
type Nodes = Map<String, Value>;

/// Writes `groups` as the Zarr folder `path`, with `attributes` on its root; replaces a Zarr folder that is there.
///
/// Each variable carries its unit as the attribute `units`. A name that no folder may have, such as `dV/dt`, is
/// written with `%` and two hexadecimal digits for the signs in question: `dV%2Fdt`.
///
/// # Errors
/// [`ReportError::Occupied`] where something else is at `path`; [`ReportError::Name`], [`ReportError::Shape`] and
/// [`ReportError::Dimension`] for groups that contradict themselves; [`ReportError::Write`].  Then nothing at
/// `path` has changed.
pub fn write_zarr(
    path: &Path,
    groups: &[impl Borrow<Group>],
    attributes: &Map<String, Value>,
) -> Result<(), ReportError> {
    if path.exists() && !path.join("zarr.json").is_file() {
        return Err(ReportError::Occupied { path: path.to_owned() });
    }
    let groups: Vec<&Group> = groups.iter().map(Borrow::borrow).collect();
    let names: Vec<&str> = groups.iter().map(|group| group.name.as_str()).collect();
    check_names("/", &names)?;
    groups.iter().try_for_each(|group| check_group(group))?;
    write_folder(path, |root| {
        let mut nodes = Nodes::new();
        for group in groups {
            write_group(root, group, &mut nodes)?;
        }
        let mut metadata = group_metadata(attributes);
        metadata["consolidated_metadata"] =
            json!({ "kind": "inline", "must_understand": false, "metadata": nodes });
        write_metadata(root, &metadata)
    })
    .map_err(ReportError::write(path))
}

fn check_group(group: &Group) -> Result<(), ReportError> {
    let names: Vec<String> = group.variables.iter().map(|v| folder_name(&v.name)).collect();
    check_names(&group.name, &names.iter().map(String::as_str).collect::<Vec<_>>())?;
    let lengths = dimensions(group)?;
    for variable in &group.variables {
        let dims: Vec<&str> = variable.dims.iter().map(|(dim, _)| dim.as_str()).collect();
        check_names(&group.name, &dims)?;
        let expected = variable.dims.iter().map(|(_, length)| length).product();
        let got = variable.values.len();
        if expected != got {
            let (variable, dims) = (variable.name.clone(), variable.dims.clone());
            return Err(ReportError::Shape { variable, dims, expected, got });
        }
        // A variable named like a dimension that it does not label would take the coordinate's place.
        if lengths.contains_key(variable.name.as_str()) && !variable.is_coordinate() {
            let (group, name) = (group.name.clone(), variable.name.clone());
            return Err(ReportError::Name { group, name });
        }
    }
    Ok(())
}

/// Names become folders: each must be one, visible, and used once.
fn check_names(group: &str, names: &[&str]) -> Result<(), ReportError> {
    let mut seen = BTreeSet::new();
    for &name in names {
        let hidden = name.starts_with('.') || name.starts_with("__") || name == "zarr.json";
        if name.is_empty() || hidden || name.contains(['/', '\\', '\0']) || !seen.insert(name) {
            return Err(ReportError::Name { group: group.to_owned(), name: name.to_owned() });
        }
    }
    Ok(())
}

/// The longest name of a folder that every file system takes, less what cutting adds, in bytes.
const LONGEST: usize = 200;

/// The folder of a variable of this name. Names that differ have folders that differ.
fn folder_name(name: &str) -> String {
    let is_reserved = name.starts_with('.') || name.starts_with("__") || name == "zarr.json";
    let sign = |(at, c): (usize, char)| {
        let is_coded = matches!(c, '/' | '\\' | '%') || c.is_control() || at == 0 && is_reserved;
        if is_coded { format!("%{:02X}", u32::from(c)) } else { c.to_string() }
    };
    let mut folder: String = name.char_indices().map(sign).collect();
    if folder.len() > LONGEST {
        let end = (0..=LONGEST).rev().find(|at| folder.is_char_boundary(*at)).unwrap_or(0);
        folder.truncate(end);
        folder = format!("{folder}%{}", &cache::key(&[name.as_bytes()])[..16]);
    }
    if folder.is_empty() { "%".to_owned() } else { folder }
}

/// The dimensions of a group with their lengths.
fn dimensions(group: &Group) -> Result<BTreeMap<&str, usize>, ReportError> {
    let mut lengths = BTreeMap::new();
    for (dim, got) in group.variables.iter().flat_map(|variable| &variable.dims) {
        let expected = *lengths.entry(dim.as_str()).or_insert(*got);
        if expected != *got {
            let (group, dim, got) = (group.name.clone(), dim.clone(), *got);
            return Err(ReportError::Dimension { group, dim, expected, got });
        }
    }
    Ok(lengths)
}

fn write_group(root: &Path, group: &Group, nodes: &mut Nodes) -> io::Result<()> {
    let folder = root.join(&group.name);
    let metadata = group_metadata(&Map::new());
    fs::create_dir(&folder)?;
    write_metadata(&folder, &metadata)?;
    nodes.insert(group.name.clone(), metadata);
    for variable in group.variables.iter().chain(&missing_coordinates(group)) {
        let name = folder_name(&variable.name);
        let metadata = write_array(&folder.join(&name), variable)?;
        nodes.insert(format!("{}/{name}", group.name), metadata);
    }
    Ok(())
}

/// The coordinates 0, 1, 2, … of the dimensions that have none of their own.
fn missing_coordinates(group: &Group) -> Vec<Variable> {
    let lengths: BTreeMap<&str, usize> = group
        .variables
        .iter()
        .flat_map(|variable| variable.dims.iter().map(|(dim, length)| (dim.as_str(), *length)))
        .collect();
    lengths
        .into_iter()
        .filter(|(dim, _)| !group.variables.iter().any(|variable| variable.name == *dim))
        .map(|(dim, n)| Variable::new(dim, "", &[(dim, n)], (0..n as i64).collect::<Vec<i64>>()))
        .collect()
}

/// Writes the chunks and the metadata of one array, and returns the metadata.
fn write_array(folder: &Path, variable: &Variable) -> io::Result<Value> {
    let n_chunks = match variable.dims.first() {
        Some((dim, n_chains)) if dim == "chain" => *n_chains,
        _ => 1,
    };
    let n_values = variable.values.len();
    fs::create_dir(folder)?;
    if n_values > 0 {
        let chunk_length = n_values / n_chunks;
        (0..n_chunks).into_par_iter().try_for_each(|chunk| {
            let range = chunk * chunk_length..(chunk + 1) * chunk_length;
            let file = folder.join(chunk_key(variable.dims.len(), chunk, SEPARATOR));
            write_chunk(&file, &variable.values, range)
        })?;
    }
    let metadata = array_metadata(variable, n_chunks);
    write_metadata(folder, &metadata)?;
    Ok(metadata)
}

/// `c.2.0.0` is the third chunk along the first of three dimensions; `c` the only one of a scalar.
fn chunk_key(n_dims: usize, chunk: usize, separator: &str) -> String {
    let indices = (0..n_dims).map(|axis| if axis == 0 { chunk } else { 0 });
    indices.fold("c".to_owned(), |key, index| format!("{key}{separator}{index}"))
}

/// Little-endian values; a text as its count of UTF-8 bytes and these, after the number of texts (`vlen-utf8`).
///
/// Draws hardly compress (a third at best, of the sign and exponent bits), so the fastest level is the right one.
fn write_chunk(path: &Path, values: &Values, range: Range<usize>) -> io::Result<()> {
    let packed = GzEncoder::new(fs::File::create(path)?, Compression::fast());
    // what is packed comes in pieces of one size, wherever it is kept: so it is packed to the same bytes
    let mut file = BufWriter::with_capacity(PIECE, packed);
    match values {
        Values::Float(values) => write_floats(&mut file, &values[range])?,
        Values::Columns(columns) => {
            let (mut at, width) = (range.start, columns.width().max(1));
            while at < range.end {
                let rows = columns.rows_from(at / width)?;
                write_floats(&mut file, &rows)?;
                at += rows.len();
            }
        }
        Values::Int(values) => {
            values[range].iter().try_for_each(|v| file.write_all(&v.to_le_bytes()))?;
        }
        Values::Bool(values) => {
            values[range].iter().try_for_each(|&v| file.write_all(&[u8::from(v)]))?;
        }
        Values::Text(texts) => {
            let count = |n: usize| (n as u32).to_le_bytes();
            file.write_all(&count(range.len()))?;
            for text in &texts[range] {
                file.write_all(&count(text.len()))?;
                file.write_all(text.as_bytes())?;
            }
        }
    }
    file.into_inner().map_err(io::IntoInnerError::into_error)?.finish()?;
    Ok(())
}

fn write_floats(file: &mut impl io::Write, values: &[f64]) -> io::Result<()> {
    values.iter().try_for_each(|v| file.write_all(&v.to_le_bytes()))
}

/// Reads the integers of an array of one dimension that [`write_zarr`] wrote: the folder `array` of a group.
///
/// # Errors
/// [`ReportError::Read`]; [`ReportError::Malformed`] for anything else.
pub(super) fn read_integers(array: &Path) -> Result<Vec<i64>, ReportError> {
    let path = array.join("zarr.json");
    let text = fs::read_to_string(&path).map_err(ReportError::read(&path))?;
    let malformed = |reason: String| ReportError::Malformed { path: path.clone(), reason };
    let metadata: Value =
        serde_json::from_str(&text).map_err(|error| malformed(error.to_string()))?;
    let length = metadata["shape"].as_array().filter(|shape| shape.len() == 1);
    let length = length.and_then(|shape| shape[0].as_u64());
    let (Some(length), Some("int64")) = (length, metadata["data_type"].as_str()) else {
        return Err(malformed("expected integers along one dimension".into()));
    };
    let encoding = &metadata["chunk_key_encoding"]["configuration"];
    let path = array.join(chunk_key(1, 0, encoding["separator"].as_str().unwrap_or("/")));
    let packed = fs::read(&path).map_err(ReportError::read(&path))?;
    let mut bytes = vec![];
    GzDecoder::new(&packed[..]).read_to_end(&mut bytes).map_err(ReportError::read(&path))?;
    let values = bytes.as_chunks().0.iter().map(|eight| i64::from_le_bytes(*eight));
    Ok(values.take(length as usize).collect())
}

fn group_metadata(attributes: &Map<String, Value>) -> Value {
    json!({ "zarr_format": 3, "node_type": "group", "attributes": attributes })
}

fn array_metadata(variable: &Variable, n_chunks: usize) -> Value {
    let little_endian = json!({ "name": "bytes", "configuration": { "endian": "little" } });
    let (data_type, fill_value, serializer) = match variable.values {
        Values::Float(_) | Values::Columns(_) => ("float64", json!("NaN"), little_endian),
        Values::Int(_) => ("int64", json!(0), little_endian),
        Values::Bool(_) => ("bool", json!(false), json!({ "name": "bytes" })),
        Values::Text(_) => ("string", json!(""), json!({ "name": "vlen-utf8" })),
    };
    let shape: Vec<usize> = variable.dims.iter().map(|(_, length)| *length).collect();
    // A chunk is at least one long, also along an empty dimension.
    let mut chunk_shape: Vec<usize> = shape.iter().map(|&length| length.max(1)).collect();
    if n_chunks > 1 {
        chunk_shape[0] = 1;
    }
    let mut attributes = Map::new();
    if !variable.unit.is_empty() {
        attributes.insert("units".to_owned(), json!(variable.unit));
    }
    json!({
        "zarr_format": 3,
        "node_type": "array",
        "shape": shape,
        "data_type": data_type,
        "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": chunk_shape } },
        "chunk_key_encoding": { "name": "default", "configuration": { "separator": SEPARATOR } },
        "fill_value": fill_value,
        "codecs": [serializer, { "name": "gzip", "configuration": { "level": 1 } }],
        "dimension_names": variable.dims.iter().map(|(dim, _)| dim).collect::<Vec<_>>(),
        "attributes": attributes,
    })
}

fn write_metadata(folder: &Path, metadata: &Value) -> io::Result<()> {
    fs::write(folder.join("zarr.json"), format!("{metadata:#}\n"))
}
