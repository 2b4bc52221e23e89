//! Surfaces and their eigenpairs.

use std::collections::BTreeMap;
use std::path::PathBuf;

use eplat::manifold::eigenpairs;
use eplat::mesh::{self, Array, Atrium, Reading, Surface, TriMesh};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray as _, PyArray1, PyArray2, PyArrayMethods as _, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::failure::failure;
use crate::interrupt::interruptible;

/// Arrays of point data by name: (n,) or (n, k).
pub(crate) type Arrays<'py> = BTreeMap<String, Bound<'py, PyAny>>;
/// Vertices (n, 3), triangles (m, 3) and point data.
pub(crate) type Parts<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>, Arrays<'py>);

/// Eigenvalues (k,) and eigenfunctions (n, k).
type Eigenpairs<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// A mesh of arrays: vertices (n, 3) and triangles (m, 3), checked.
pub(crate) fn tri_mesh(
    py: Python<'_>,
    vertices: &PyReadonlyArray2<'_, f64>,
    triangles: &PyReadonlyArray2<'_, i64>,
) -> PyResult<TriMesh> {
    let vertices = vertices.as_array().rows().into_iter().map(|p| [p[0], p[1], p[2]]).collect();
    let index = |vertex: i64| u32::try_from(vertex).unwrap_or(u32::MAX);
    let triangles = triangles.as_array();
    let triangles = triangles.rows().into_iter().map(|t| [t[0], t[1], t[2]].map(index)).collect();
    TriMesh::new(vertices, triangles).map_err(|error| failure(py, error))
}

/// Rows of three as an array (n, 3).
fn rows<'py, T: Copy + numpy::Element>(
    py: Python<'py>,
    rows: &[[T; 3]],
) -> Bound<'py, PyArray2<T>> {
    Array2::from_shape_fn((rows.len(), 3), |(i, k)| rows[i][k]).into_pyarray(py)
}

/// The mesh as arrays.
pub(crate) fn mesh_arrays<'py>(
    py: Python<'py>,
    mesh: &TriMesh,
) -> (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>) {
    (rows(py, mesh.vertices()), rows(py, mesh.triangles()))
}

fn parts<'py>(py: Python<'py>, surface: &Surface) -> Parts<'py> {
    let array = |array: &Array| {
        let shape = (array.n_rows(), array.width());
        if array.width() == 1 {
            return array.values().to_vec().into_pyarray(py).into_any();
        }
        Array2::from_shape_fn(shape, |(i, k)| array.row(i)[k]).into_pyarray(py).into_any()
    };
    let data = surface.point_data.iter().map(|(name, values)| (name.clone(), array(values)));
    let (vertices, triangles) = mesh_arrays(py, &surface.mesh);
    (vertices, triangles, data.collect())
}

/// The surface in a file, in mm, as the program reads it.
#[pyfunction]
#[pyo3(signature = (path, units=None, piece=None))]
pub(crate) fn read_surface<'py>(
    py: Python<'py>,
    path: PathBuf,
    units: Option<&str>,
    piece: Option<usize>,
) -> PyResult<Parts<'py>> {
    let units = units.map(str::parse).transpose().map_err(|error| failure(py, error))?;
    let reading = Reading { units, piece, ..Reading::default() };
    let surface = py.detach(|| mesh::read(&path, reading)).map_err(|error| failure(py, error))?;
    Ok(parts(py, &surface))
}

/// The procedural left atrium with edges of `edge` mm.
#[pyfunction]
pub(crate) fn embedded_surface(py: Python<'_>, edge: f64) -> PyResult<Parts<'_>> {
    let range = Atrium::EDGE_RANGE;
    if !range.contains(&edge) {
        let (shortest, longest) = (range.start(), range.end());
        let text = format!(
            "edge = {edge} mm: the embedded left atrium has edges of {shortest} to {longest} mm"
        );
        return Err(failure(py, text));
    }
    let surface = py.detach(|| Surface::left_atrium(edge));
    Ok(parts(py, &surface))
}

/// The `k` smallest eigenpairs: eigenvalues (k,) and eigenfunctions (n, k).
#[pyfunction]
pub(crate) fn eigenbasis<'py>(
    py: Python<'py>,
    vertices: PyReadonlyArray2<'py, f64>,
    triangles: PyReadonlyArray2<'py, i64>,
    k: usize,
) -> PyResult<Eigenpairs<'py>> {
    let mesh = tri_mesh(py, &vertices, &triangles)?;
    let basis = interruptible(py, 1, None, |_| eigenpairs(&mesh, k))?;
    let basis = basis.map_err(|error| failure(py, error))?;
    let shape = [basis.n_vertices(), basis.n_modes()];
    let eigenvalues = basis.eigenvalues.into_pyarray(py);
    Ok((eigenvalues, basis.eigenfunctions.into_pyarray(py).reshape(shape)?))
}
