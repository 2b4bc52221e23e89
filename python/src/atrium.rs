//! A paced surface.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

use eplat::mesh::{Surface, Units};
use eplat::run::atrium::{
    Atrium, AtriumError, AtriumSettings, Beat, Event, Ground, Numerics, PacingSettings, Source,
    TissueSettings, Watch,
};
use numpy::{IntoPyArray as _, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::failure::failure;
use crate::interrupt::{Shared, interruptible};
use crate::surface::{mesh_arrays, tri_mesh};

/// What is paced: arrays, or the folder of a run.
#[derive(FromPyObject)]
pub(crate) enum Place<'py> {
    Run(PathBuf),
    #[pyo3(transparent)]
    Arrays(Arrays<'py>),
}

/// A mesh with scalars (n,) and fibres (n, 3) by name.
#[derive(FromPyObject)]
pub(crate) struct Arrays<'py>(
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, i64>,
    BTreeMap<String, PyReadonlyArray1<'py, f64>>,
    BTreeMap<String, PyReadonlyArray2<'py, f64>>,
);

/// The options of `eplat simulate atrium`, by their names.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Settings {
    refine: u32,
    cv_max: Given,
    tau_in: Given,
    tau_out: Given,
    tau_open: Given,
    apd_max: Given,
    fibres: Option<String>,
    anisotropy: Option<f64>,
    pace: Vec<usize>,
    pace_region: Option<(String, f64)>,
    radius: f64,
    s1: f64,
    beats: u32,
    extra: Vec<f64>,
    strength: f64,
    measure: Option<u32>,
    last: f64,
    dt: f64,
    double: bool,
    draws: Option<u32>,
}

/// A number, or the name of point data.
#[derive(FromPyObject)]
pub(crate) enum Given {
    Number(f64),
    Field(String),
}

impl From<Given> for Source {
    fn from(given: Given) -> Self {
        match given {
            Given::Number(number) => Self::Number(number),
            Given::Field(name) => Self::Field(name),
        }
    }
}

impl From<Settings> for AtriumSettings {
    fn from(s: Settings) -> Self {
        Self {
            tissue: TissueSettings {
                refine: s.refine,
                cv_max: s.cv_max.into(),
                tau_in: s.tau_in.into(),
                tau_out: s.tau_out.into(),
                tau_open: s.tau_open.into(),
                apd_max: s.apd_max.into(),
                fibres: s.fibres,
                anisotropy: s.anisotropy,
            },
            pacing: PacingSettings {
                pace: s.pace,
                pace_region: s.pace_region,
                radius: s.radius,
                s1: s.s1,
                beats: s.beats,
                extra: s.extra,
                strength: s.strength,
                measure: s.measure,
                last: s.last,
            },
            numerics: Numerics { dt: s.dt, double: s.double, snapshots: None },
            draws: s.draws,
            compare: None,
        }
    }
}

/// Vertices (n, 3) and triangles (m, 3) that were simulated on, maps (n,) by name, and the record as JSON.
type Simulated<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<u32>>,
    BTreeMap<String, Bound<'py, PyArray1<f64>>>,
    String,
);

/// Paces the surface as `eplat simulate atrium` does. `progress` is called with ms that are done, and all of them.
#[pyfunction]
pub(crate) fn simulate_atrium<'py>(
    py: Python<'py>,
    place: Place<'py>,
    settings: Settings,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Simulated<'py>> {
    let ground = ground(py, place, settings.draws.is_some())?;
    let atrium = py.detach(|| Atrium::new(ground, &settings.into()));
    let atrium = atrium.map_err(|error| failure(py, error))?;
    let all = atrium.total_time() as u64;
    let beat = interruptible(py, all, progress.as_ref(), |shared| simulate(&atrium, shared))?;
    // without a beat it was interrupted, and that has been raised
    let Some(beat) = beat.map_err(|error| failure(py, error))? else {
        return Err(failure(py, "the simulation was stopped"));
    };
    let record = serde_json::to_string(&beat.record).map_err(|error| failure(py, error))?;
    let (vertices, triangles) = mesh_arrays(py, atrium.mesh());
    let maps = beat.maps.into_iter().map(|(name, values)| (name, values.into_pyarray(py)));
    Ok((vertices, triangles, maps.collect(), record))
}

fn simulate(atrium: &Atrium, shared: &Shared) -> Result<Option<Beat>, AtriumError> {
    let on_event = |event: Event<'_>| {
        if let Event::Time(time) = event {
            shared.done.store(time as u64, Ordering::Relaxed);
        }
    };
    atrium.simulate(Watch { stop: &shared.stop, on_event: &on_event })
}

fn ground(py: Python<'_>, place: Place<'_>, with_draws: bool) -> PyResult<Ground> {
    let Arrays(vertices, triangles, scalars, vectors) = match place {
        Place::Run(folder) => {
            let read = Ground::of_run(&folder, |_| Units::Mm.into());
            let drawn =
                read.and_then(|g| if with_draws { g.with_draws_of(&folder) } else { Ok(g) });
            return drawn.map_err(|error| failure(py, error));
        }
        Place::Arrays(arrays) => arrays,
    };
    let mesh = tri_mesh(py, &vertices, &triangles)?;
    let scalars = scalars.into_iter().map(|(name, values)| (name, values.as_array().to_vec()));
    let mut surface = Surface::new(mesh, scalars.collect());
    for (name, rows) in vectors {
        let rows: Vec<[f64; 3]> =
            rows.as_array().rows().into_iter().map(|r| [r[0], r[1], r[2]]).collect();
        surface.point_data.insert(name, rows.into());
    }
    Ok(Ground::of(surface))
}
