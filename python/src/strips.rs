//! Paced strips of tissue.

use std::sync::atomic::Ordering;

use eplat::ep::table::{CurveRow, OutcomeRow, StripTable, curve_intervals};
use eplat::ep::{Grid, Parameters, Protocol, StripError};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use serde_json::Value;

use crate::failure::failure;
use crate::interrupt::{Shared, interruptible};

/// So many strips are simulated before Ctrl-C is looked for.
const TOGETHER: usize = 64;

/// When and how strips are paced, as `eplat simulate strip` has it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Pacing {
    s1: u32,
    s2: u32,
    beats: u32,
    strength: f64,
    test_strength: f64,
    shortest: u32,
    longest: u32,
}

/// Size and resolution of a strip, as `eplat simulate strip` has it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Size {
    length: f64,
    width: f64,
    spacing: f64,
    dt: f64,
}

/// A strip for each row of `parameters` (n, 5): `cv_max`, `tau_in`, `tau_out`, `tau_open`, `apd_max`. Columns of outcomes by
/// name, and those of the restitution curves, which are empty unless they are asked for.
#[pyfunction]
pub(crate) fn simulate_strips<'py>(
    py: Python<'py>,
    parameters: PyReadonlyArray2<'py, f64>,
    pacing: Pacing,
    size: Size,
    restitution: bool,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyDict>, Bound<'py, PyDict>)> {
    let rows = parameters.as_array();
    let sets: Vec<Parameters> = rows
        .rows()
        .into_iter()
        .map(|p| Parameters::from_array([p[0], p[1], p[2], p[3], p[4]]))
        .collect();
    let protocol = pacing.protocol(restitution);
    let grid = Grid::of_size([size.length, size.width], size.spacing, size.dt)
        .map_err(|error| failure(py, error))?;
    let simulated = interruptible(py, sets.len() as u64, progress.as_ref(), |shared| {
        simulate(&sets, &grid, &protocol, shared)
    })?;
    let (outcomes, curves) = simulated.map_err(|error| failure(py, error))?;
    Ok((columns(py, &outcomes)?, columns(py, &curves)?))
}

impl Pacing {
    fn protocol(&self, restitution: bool) -> Protocol {
        Protocol {
            s1: self.s1,
            s2: self.s2,
            n_beats: self.beats,
            conditioning_strength: self.strength,
            test_strength: self.test_strength,
            shortest: self.shortest,
            longest: self.longest,
            restitution: if restitution { curve_intervals() } else { vec![] },
        }
    }
}

/// A part of the sets at a time: outcomes are the same however they are grouped.
fn simulate(
    sets: &[Parameters],
    grid: &Grid,
    protocol: &Protocol,
    shared: &Shared,
) -> Result<(Vec<OutcomeRow>, Vec<CurveRow>), StripError> {
    let (mut outcomes, mut curves) = (vec![], vec![]);
    for part in sets.chunks(TOGETHER) {
        if shared.stop.load(Ordering::Relaxed) {
            break;
        }
        let before = outcomes.len();
        let tell = |n: usize| {
            shared.done.fetch_add(n as u64, Ordering::Relaxed);
        };
        let table = StripTable::simulate(part, grid, protocol, &tell)?;
        outcomes
            .extend(table.rows.into_iter().map(|row| OutcomeRow { row: row.row + before, ..row }));
        curves
            .extend(table.curves.into_iter().map(|row| CurveRow { row: row.row + before, ..row }));
    }
    Ok((outcomes, curves))
}

/// A list for each field of the rows; `None` where a row has none.
fn columns<'py, T: Serialize>(py: Python<'py>, rows: &[T]) -> PyResult<Bound<'py, PyDict>> {
    let columns = PyDict::new(py);
    let read = rows.iter().map(serde_json::to_value).collect::<Result<Vec<_>, _>>();
    let rows = read.map_err(|error| failure(py, error))?;
    let Some(Value::Object(first)) = rows.first() else { return Ok(columns) };
    for name in first.keys() {
        let cells = rows.iter().map(|row| cell(py, &row[name]));
        columns.set_item(name, cells.collect::<PyResult<Vec<_>>>()?)?;
    }
    Ok(columns)
}

fn cell<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Number(number) => number.as_f64().into_pyobject(py)?.into_any(),
        Value::String(text) => text.into_pyobject(py)?.into_any(),
        _ => py.None().into_bound(py),
    })
}
