//! `eplat._eplat`: what Python calls in its own process, with NumPy arrays and without files.
//!
//! Runs and loops are no part of this: `python/eplat/program.py` starts the program for them. Nothing here decides anything:
//! arguments are taken apart, the library is called, and its results become arrays. Errors are `eplat.EplatError` with the
//! library's own text.

#![allow(clippy::needless_pass_by_value, reason = "Python hands arguments over by value")]

mod atrium;
mod failure;
mod interrupt;
mod strips;
mod surface;

use std::collections::BTreeMap;
use std::path::PathBuf;

use pyo3::prelude::*;

/// The options of a command of the program: for each name what its value is, `flag`, `value`, `list` or `repeated`.
#[pyfunction]
fn options(command: &str) -> BTreeMap<String, &'static str> {
    let named = eplat::cli::options(command).into_iter();
    named.map(|option| (option.name, option.takes.word())).collect()
}

/// Where the program keeps what is slow to make, if anywhere.
#[pyfunction]
fn cache_folder() -> Option<PathBuf> {
    eplat::store::cache::folder()
}

/// The texts of the models that the program has compiled in, by their names.
#[pyfunction]
fn shipped_models() -> BTreeMap<String, &'static str> {
    eplat::cli::shipped_models()
}

/// See [`self`].
#[pymodule]
fn _eplat(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_function(wrap_pyfunction!(options, module)?)?;
    module.add_function(wrap_pyfunction!(cache_folder, module)?)?;
    module.add_function(wrap_pyfunction!(shipped_models, module)?)?;
    module.add_function(wrap_pyfunction!(surface::read_surface, module)?)?;
    module.add_function(wrap_pyfunction!(surface::embedded_surface, module)?)?;
    module.add_function(wrap_pyfunction!(surface::eigenbasis, module)?)?;
    module.add_function(wrap_pyfunction!(strips::simulate_strips, module)?)?;
    module.add_function(wrap_pyfunction!(atrium::simulate_atrium, module)?)?;
    Ok(())
}
