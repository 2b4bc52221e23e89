//! Errors of the library as exceptions of Python.

use std::fmt::Display;

use pyo3::prelude::*;

/// `eplat.EplatError` with the library's text.
pub(crate) fn failure(py: Python<'_>, error: impl Display) -> PyErr {
    let raised = py
        .import("eplat.errors")
        .and_then(|errors| errors.getattr("EplatError")?.call1((error.to_string(),)));
    raised.map_or_else(|wrong| wrong, PyErr::from_value)
}
