//! MATLAB files: arrays of numbers by their path through structs, in versions 5 (to "-v7") and 7.3.
//!
//! Knows nothing of what the arrays mean.

mod v5;
mod v73;

use super::ImportError;

pub(super) use v5::Bounds;

/// A matrix, column by column.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Matrix {
    /// Number of rows.
    pub(super) rows: usize,
    /// The columns, one after the other.
    pub(super) values: Vec<f64>,
}

impl Matrix {
    /// Number of columns.
    pub(super) fn columns(&self) -> usize {
        self.values.len().checked_div(self.rows).unwrap_or(0)
    }

    /// A number; NaN outside the matrix.
    pub(super) fn at(&self, row: usize, column: usize) -> f64 {
        let index = column * self.rows + row;
        if row < self.rows { self.values.get(index).copied().unwrap_or(f64::NAN) } else { f64::NAN }
    }
}

/// What stands at a path.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Found {
    /// Numbers.
    Matrix(Matrix),
    /// Cells of text, an empty one for whatever else a cell holds.
    Texts(Vec<String>),
    /// A struct.
    Struct,
    /// An object of a class, which only MATLAB can read.
    Object(String),
    /// Text, cells and what else there is.
    Other,
}

/// A MATLAB file.
#[derive(Debug)]
pub(super) enum Mat {
    V5(v5::Mat),
    V73(v73::Mat),
}

impl Mat {
    /// Reads the directory of a file.
    ///
    /// # Errors
    /// It is no MATLAB file, or damaged.
    pub(super) fn open(file: &str, bytes: Vec<u8>) -> Result<Self, ImportError> {
        if v73::is_hdf5(&bytes) {
            v73::Mat::open(file, bytes).map(Self::V73)
        } else {
            v5::Mat::open(file, &bytes).map(Self::V5)
        }
    }

    /// What stands at a path such as `["userdata", "surface"]`, if anything.
    ///
    /// # Errors
    /// The file is damaged there.
    pub(super) fn find(&self, path: &[&str]) -> Result<Option<Found>, ImportError> {
        match self {
            Self::V5(mat) => mat.find(path),
            Self::V73(mat) => mat.find(path),
        }
    }

    /// The version, for records.
    pub(super) fn version(&self) -> &'static str {
        match self {
            Self::V5(_) => "5",
            Self::V73(_) => "7.3",
        }
    }
}
