//! Named arrays in named groups: what `posterior.zarr` and `draws.csv` hold.
//!
//! Knows nothing of files, models or samplers.

use std::borrow::Cow;
use std::io;

use super::Columns;

/// The values of one array, in row-major order.
#[derive(Clone, Debug)]
pub enum Values {
    /// 64-bit floats; NaN where a value does not exist.
    Float(Vec<f64>),
    /// 64-bit floats that are kept with others of the same draws, perhaps on disk.
    Columns(Columns),
    /// 64-bit integers, e.g. `tree_depth`.
    Int(Vec<i64>),
    /// Flags, e.g. `diverging`.
    Bool(Vec<bool>),
    /// Texts, e.g. the names of measurement sites.
    Text(Vec<String>),
}

impl Values {
    /// Number of values.
    pub fn len(&self) -> usize {
        match self {
            Self::Float(values) => values.len(),
            Self::Columns(columns) => columns.len(),
            Self::Int(values) => values.len(),
            Self::Bool(values) => values.len(),
            Self::Text(values) => values.len(),
        }
    }

    /// All of them, where they are floats.
    ///
    /// # Errors
    /// From the disk that they are on.
    pub fn floats(&self) -> io::Result<Option<Cow<'_, [f64]>>> {
        match self {
            Self::Float(values) => Ok(Some(Cow::Borrowed(values))),
            Self::Columns(columns) => columns.all().map(|all| Some(Cow::Owned(all))),
            Self::Int(_) | Self::Bool(_) | Self::Text(_) => Ok(None),
        }
    }

    /// Whether there is no value.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl From<Vec<f64>> for Values {
    fn from(values: Vec<f64>) -> Self {
        Self::Float(values)
    }
}

impl From<Columns> for Values {
    fn from(columns: Columns) -> Self {
        Self::Columns(columns)
    }
}

impl From<Vec<i64>> for Values {
    fn from(values: Vec<i64>) -> Self {
        Self::Int(values)
    }
}

impl From<Vec<bool>> for Values {
    fn from(values: Vec<bool>) -> Self {
        Self::Bool(values)
    }
}

impl From<Vec<String>> for Values {
    fn from(values: Vec<String>) -> Self {
        Self::Text(values)
    }
}

/// One named array.
#[derive(Clone, Debug)]
pub struct Variable {
    /// Name, e.g. `tau_out.alpha`.
    pub name: String,
    /// Unit as declared in the model, empty if none.
    pub unit: String,
    /// Dimension names and lengths, outermost first, e.g. `[("chain", 4), ("draw", 1000), ("site", 10)]`.
    pub dims: Vec<(String, usize)>,
    /// Values in row-major order.
    pub values: Values,
}

impl Variable {
    /// An array of `values` over `dims` (name, length), outermost first.
    pub fn new(
        name: impl Into<String>,
        unit: impl Into<String>,
        dims: &[(&str, usize)],
        values: impl Into<Values>,
    ) -> Self {
        let dims = dims.iter().map(|&(dim, length)| (dim.to_owned(), length)).collect();
        Self { name: name.into(), unit: unit.into(), dims, values: values.into() }
    }

    /// Whether this labels the indices of the dimension that it is named after.
    pub(super) fn is_coordinate(&self) -> bool {
        self.dims.len() == 1 && self.dims[0].0 == self.name
    }
}

/// A group of variables that share dimensions, e.g. `posterior`.
///
/// As in `NetCDF`, a variable named like its only dimension is that dimension's coordinate: numbers or texts that
/// label its indices.  A dimension without one is numbered 0, 1, 2, …
#[derive(Clone, Debug)]
pub struct Group {
    /// Group name as ArviZ knows it.
    pub name: String,
    /// The arrays.
    pub variables: Vec<Variable>,
}

impl Group {
    /// The label of `index` along `dim`: its text coordinate, else the index.
    pub(super) fn label(&self, dim: &str, index: usize) -> String {
        let coordinate = self.variables.iter().find(|v| v.name == dim && v.is_coordinate());
        match coordinate.map(|variable| &variable.values) {
            Some(Values::Text(texts)) if index < texts.len() => texts[index].clone(),
            _ => index.to_string(),
        }
    }
}
