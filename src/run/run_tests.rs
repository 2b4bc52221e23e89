//! Runs from beginning to end: events, stopping, going on, and files that are the same either way.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use super::*;
use crate::mesh::{self, Reading, Units};
use crate::table::Measurements;

mod conjugate {
    use crate::prelude::*;
    model! {
        model Conjugate;
        param mean [ms] ~ Normal(10.0, 2.0);
        observe y(row): Number [ms] ~ Normal(mean, 1.0);
    }
}

fn problem() -> Problem<'static> {
    let cells = ["12.0", "13.5", "11.25"].map(|y| vec![y.to_owned()]).to_vec();
    let table = Measurements::from_cells("test", vec!["y".into()], cells).unwrap();
    let inputs = Inputs { data: table.into(), ..Inputs::default() };
    Problem::load(&conjugate::Conjugate, &inputs).unwrap()
}

fn settings() -> Settings {
    Settings { chains: 2, warmup: 200, draws: 300, threads: 1, ..Settings::default() }
}

fn draws(folder: &Path) -> String {
    std::fs::read_to_string(folder.join("draws.csv")).unwrap()
}

#[test]
fn a_run_that_is_stopped_goes_on_to_the_same_draws() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|name| folder.path().join(name));
    problem().fit(&settings()).unwrap().write(&whole).unwrap();
    let out = OutputFolder::open(&parts).unwrap();
    // stopped at the end of the first chain's warm-up
    let stop = AtomicBool::new(false);
    let on_event = |event: &Event<'_>| {
        stop.fetch_or(matches!(event, Event::Progress(_)), Ordering::Relaxed);
    };
    let options =
        Options { watch: Watch { on_event: &on_event, stop: &stop }, ..Options::default() };
    let ended = problem().run_into(&out, &settings(), &options, &Keep::default()).unwrap();
    assert!(matches!(ended, Ended::Stopped));
    assert!(out.checkpoint().is_dir() && !out.file("run.json").exists());
    let again = |keep: &Keep| problem().run_into(&out, &settings(), &Options::default(), keep);
    let occupied = again(&Keep::default()).unwrap_err();
    assert!(matches!(occupied, RunError::Checkpoint(_)), "{occupied}");
    let ended = again(&Keep::going_on(&out).unwrap()).unwrap();
    assert!(matches!(ended, Ended::Now(..)));
    assert!(!out.checkpoint().exists());
    assert_eq!(draws(&parts), draws(&whole));
    let ended = again(&Keep::going_on(&out).unwrap()).unwrap();
    assert!(matches!(ended, Ended::Before));
    let other = Settings { seed: 2, ..settings() };
    let keep = Keep::going_on(&out).unwrap();
    let another = problem().run_into(&out, &other, &Options::default(), &keep).unwrap_err();
    assert!(matches!(another, RunError::AnotherRun { .. }), "{another}");
}

#[test]
fn what_was_written_reads_back_with_the_same_verdict() {
    let folder = tempfile::tempdir().unwrap();
    let written = problem().fit(&settings()).unwrap().write(folder.path()).unwrap();
    let read = Results::read(folder.path()).unwrap();
    assert_eq!(read.text(), written.text());
    assert_eq!(read.converged(), written.converged());
    for name in &written.files {
        assert!(folder.path().join(name).exists(), "{name}");
    }
    let missing = Results::read(folder.path().join("nothing")).unwrap_err();
    assert!(matches!(missing, RunError::NoRun { .. }), "{missing}");
}

#[test]
fn events_come_in_order_and_a_warm_start_is_told() {
    let folder = tempfile::tempdir().unwrap();
    problem().fit(&settings()).unwrap().write(folder.path()).unwrap();
    let told = Mutex::new(vec![]);
    let on_event = |event: &Event<'_>| {
        if !matches!(event, Event::Progress(_)) {
            told.lock().unwrap().push(event.to_string());
        }
    };
    let watch = Watch { on_event: &on_event, ..Watch::default() };
    let options = Options { warm_start: Some(folder.path()), watch, ..Options::default() };
    let fit = problem().fit_with(&settings(), &options).unwrap();
    assert!(fit.record().hashes.contains_key("init"));
    problem().prior(&settings(), &options).unwrap();
    problem().laplace(&settings(), &options).unwrap();
    let told = told.into_inner().unwrap();
    let beginnings = ["init   ", "model  Conjugate: 1 unknowns, sampler nuts, ready in "];
    let others = [
        "draws  600 in ",
        "model  Conjugate: draws from its prior, not from its posterior",
        "model  Conjugate: normal approximation at its mode, not sampled",
    ];
    assert_eq!(told.len(), 5, "{told:?}");
    for (line, beginning) in told.iter().zip(beginnings.into_iter().chain(others)) {
        assert!(line.starts_with(beginning), "{line}");
    }
}

#[test]
fn a_stopped_fit_is_an_error_and_so_is_a_model_without_measurements() {
    let stop = AtomicBool::new(true);
    let options =
        Options { watch: Watch { stop: &stop, ..Watch::default() }, ..Options::default() };
    let stopped = problem().fit_with(&settings(), &options).unwrap_err();
    assert!(matches!(stopped, RunError::Stopped), "{stopped}");
    let nothing = Problem::load(&conjugate::Conjugate, &Inputs::default()).unwrap_err();
    assert!(matches!(nothing, RunError::NoMeasurements { .. }), "{nothing}");
}

#[test]
fn problems_and_fits_can_be_handed_to_other_threads() {
    fn shared<T: Send + Sync>() {}
    shared::<Problem<'static>>();
    shared::<Fit<'static>>();
    shared::<RunError>();
}

#[test]
fn an_atrium_of_too_long_edges_is_an_error() {
    for edge in [3.5, 0.0, f64::NAN] {
        let mesh = MeshSource::Embedded { edge };
        let error = problem::surface(&mesh, &Watch::default()).unwrap_err().to_string();
        assert!(error.contains(&format!("edges of {edge} mm, expected 0.2 to 3 mm")), "{error}");
    }
}

#[test]
fn the_same_file_in_another_unit_is_another_input() {
    let file = tempfile::NamedTempFile::with_suffix(".vtk").unwrap();
    let hashed = |units, piece| {
        let reading = Reading { units, piece, ..Reading::default() };
        let mesh = MeshSource::File { path: file.path().into(), reading, whole: false };
        Inputs { mesh, ..Inputs::default() }.hashed().unwrap()
    };
    let all = [(None, None), (Some(Units::Mm), None), (Some(Units::Cm), None), (None, Some(2))];
    let all = all.map(|(units, piece)| hashed(units, piece));
    for (a, one) in all.iter().enumerate() {
        assert!(all[..a].iter().all(|other| other != one), "{one:?}");
    }
}

#[test]
fn a_large_mesh_is_kept_whole_on_request() {
    const SIDE: u32 = 317; // 100,489 vertices
    let place = |i: u32| [0.3 * f64::from(i % SIDE), 0.3 * f64::from(i / SIDE), 0.0];
    let corners = (0..SIDE * (SIDE - 1)).filter(|i| i % SIDE < SIDE - 1);
    let cut = |i: u32| [[i, i + 1, i + SIDE], [i + 1, i + SIDE + 1, i + SIDE]];
    let triangles: Vec<[u32; 3]> = corners.flat_map(cut).collect();
    let sheet = mesh::TriMesh::new((0..SIDE * SIDE).map(place).collect(), triangles).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheet.npz");
    let written = mesh::Surface::new(sheet, std::collections::BTreeMap::new());
    written.write(&path, mesh::Encoding::Binary).unwrap();
    let n_vertices = |whole: bool| {
        let reading = mesh::Units::Mm.into();
        let mesh = MeshSource::File { path: path.clone(), reading, whole };
        problem::surface(&mesh, &Watch::default()).unwrap().mesh.n_vertices()
    };
    assert_eq!([n_vertices(true), n_vertices(false)], [(SIDE * SIDE) as usize, 20_000]);
}
