//! MATLAB files of version 7.3: HDF5 in which a struct is a group, a matrix a dataset with its dimensions
//! turned round, a text a dataset of UTF-16, and a cell array a dataset of references to what its cells hold.

use std::collections::BTreeMap;

use hdf5_reader::error::Result as Read;
use hdf5_reader::group::Group;
use hdf5_reader::{Dataset, H5Type, Hdf5File, OpenOptions, reference};

use super::{Found, Matrix};
use crate::import::ImportError;
use crate::mesh::Place;

/// Where the HDF5 file begins, behind MATLAB's own header.
const USER_BLOCK: usize = 512;
const SIGNATURE: &[u8] = b"\x89HDF\r\n\x1a\n";
/// The group of all that stands in cells.
const CELLS: &str = "#refs#";

/// Whether these are the bytes of such a file.
pub(super) fn is_hdf5(bytes: &[u8]) -> bool {
    bytes.starts_with(SIGNATURE)
        || bytes.get(USER_BLOCK..).is_some_and(|b| b.starts_with(SIGNATURE))
}

/// The file.
pub(in crate::import) struct Mat {
    file: String,
    hdf5: Hdf5File,
}

impl std::fmt::Debug for Mat {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Mat").field("file", &self.file).finish_non_exhaustive()
    }
}

impl Mat {
    pub(super) fn open(file: &str, bytes: Vec<u8>) -> Result<Self, ImportError> {
        // nothing that is read grows beyond what the file's size makes plausible
        let most = super::Bounds::DEFAULT.small.max(bytes.len().saturating_mul(10));
        let options = OpenOptions::default()
            .with_chunk_cache_bytes(0)
            .with_max_chunk_bytes(most)
            .with_max_read_bytes(most);
        let hdf5 = Hdf5File::from_vec_with_options(bytes, options)
            .map_err(|error| wrong(file, &error.to_string()))?;
        Ok(Self { file: file.into(), hdf5 })
    }

    pub(super) fn find(&self, path: &[&str]) -> Result<Option<Found>, ImportError> {
        let root = self.hdf5.root_group().map_err(|e| wrong(&self.file, &e.to_string()))?;
        let [groups @ .., last] = path else { return Ok(None) };
        let mut group = root;
        for name in groups {
            match group.group(name) {
                Ok(below) => group = below,
                // an object is a dataset where a struct would be a group
                Err(_) => return Ok(group.dataset(name).ok().and_then(|own| object(&own))),
            }
        }
        self.last(&group, last)
    }

    fn last(&self, group: &Group, name: &str) -> Result<Option<Found>, ImportError> {
        if let Ok(dataset) = group.dataset(name) {
            if let Some(object) = object(&dataset) {
                return Ok(Some(object));
            }
            return self.matrix(&dataset).map(Some);
        }
        Ok(group.group(name).is_ok().then_some(Found::Struct))
    }

    fn matrix(&self, dataset: &Dataset) -> Result<Found, ImportError> {
        // what is empty is written as its dimensions
        if dataset.attribute("MATLAB_empty").is_ok() {
            return Ok(Found::Matrix(Matrix { rows: 0, values: vec![] }));
        }
        let class = class_of(dataset).unwrap_or_default();
        if class == "cell" {
            return self.texts(dataset).map(Found::Texts);
        }
        if class == "char" {
            return Ok(Found::Other);
        }
        let values = numbers(dataset).map_err(|error| wrong(&self.file, &error))?;
        // the last dimension of HDF5 is MATLAB's first
        let rows = dataset.shape().last().map_or(values.len(), |rows| *rows as usize);
        Ok(Found::Matrix(Matrix { rows, values }))
    }

    /// The texts of cells, an empty one for whatever else a cell holds.
    fn texts(&self, cells: &Dataset) -> Result<Vec<String>, ImportError> {
        let read = || -> Read<Vec<String>> {
            let held = self.hdf5.root_group()?.group(CELLS)?.datasets()?;
            let at: BTreeMap<u64, &Dataset> = held.iter().map(|own| (own.address(), own)).collect();
            let size = self.hdf5.superblock().offset_size;
            let places = reference::read_object_references(&cells.read_raw_bytes()?, size)?;
            places
                .iter()
                .map(|place| at.get(place).map_or(Ok(String::new()), |own| text(own)))
                .collect()
        };
        read().map_err(|error| wrong(&self.file, &error.to_string()))
    }
}

/// The text of a dataset; an empty one if it is empty or no text.
fn text(dataset: &Dataset) -> Read<String> {
    let is_empty = dataset.attribute("MATLAB_empty").is_ok();
    if is_empty || class_of(dataset).as_deref() != Some("char") {
        return Ok(String::new());
    }
    let units: Vec<u16> = dataset.read_array::<u16>()?.iter().copied().collect();
    Ok(String::from_utf16_lossy(&units).trim().to_owned())
}

/// The class that a dataset is an object of.
fn object(dataset: &Dataset) -> Option<Found> {
    let is_object = dataset.attribute("MATLAB_object_decode").is_ok();
    let class = class_of(dataset)?;
    is_object.then_some(Found::Object(class))
}

fn class_of(dataset: &Dataset) -> Option<String> {
    dataset.attribute("MATLAB_class").ok()?.read_string().ok()
}

/// The numbers of whatever type.
fn numbers(dataset: &Dataset) -> Result<Vec<f64>, String> {
    fn all<T: H5Type + Copy>(dataset: &Dataset, to: fn(T) -> f64) -> Result<Vec<f64>, String> {
        let array = dataset.read_array::<T>().map_err(|error| error.to_string())?;
        Ok(array.iter().map(|x| to(*x)).collect())
    }
    let first = all::<f64>(dataset, |x| x);
    first
        .clone()
        .or_else(|_| all::<f32>(dataset, f64::from))
        .or_else(|_| all::<i32>(dataset, f64::from))
        .or_else(|_| all::<u8>(dataset, f64::from))
        .or_else(|_| all::<i64>(dataset, |x| x as f64))
        .or_else(|_| all::<u32>(dataset, f64::from))
        .or_else(|_| all::<i16>(dataset, f64::from))
        .or_else(|_| all::<u16>(dataset, f64::from))
        .or_else(|_| all::<i8>(dataset, f64::from))
        .or_else(|_| all::<u64>(dataset, |x| x as f64))
        .or(first)
}

fn wrong(file: &str, reason: &str) -> ImportError {
    ImportError::Parse {
        file: file.into(),
        place: Place::Byte(0),
        expected: "a MATLAB file of version 7.3 (HDF5)".into(),
        got: reason.into(),
        help: "the file is damaged or of a rare kind; load it in MATLAB and save it with -v7",
    }
}
