//! What eplat reads, a target for each reader: how a file is read, what must hold of what is accepted, and from which
//! valid files to begin. Whoever calls one with any file at all gets no panic, unless something is wrong.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use eplat::import::{Given, Options, read as read_study, select};
use eplat::infer::{Evaluator, LogDensity, Progress, Settings, sample};
use eplat::manifold::Basis;
use eplat::mesh;
use eplat::report::{FieldDraws, RunRecord, read_loo, read_rows, read_summary_json};
use eplat::run::{Inputs, Results};
use eplat::store::{Checkpoint, Identity};
use eplat::study::{Plan, Table};
use eplat::table::Measurements;

use crate::seeds;

/// A reader.
#[derive(Clone, Copy)]
pub(crate) struct Target {
    /// Its name.
    pub(crate) name: &'static str,
    /// Reads a file, beside which others may lie; panics on what should have been refused.
    pub(crate) read: fn(&Path),
    /// Makes valid files in a folder.
    pub(crate) seeds: fn(&Path) -> Vec<PathBuf>,
}

/// All readers.
pub(crate) const TARGETS: [Target; 15] = [
    Target { name: "legacy_vtk", read: read_mesh, seeds: |at| seeds::meshes(at, &["vtk"]) },
    Target { name: "vtp_vtu", read: read_mesh, seeds: |at| seeds::meshes(at, &["vtp", "vtu"]) },
    Target { name: "ply", read: read_mesh, seeds: |at| seeds::meshes(at, &["ply"]) },
    Target { name: "stl", read: read_mesh, seeds: |at| seeds::meshes(at, &["stl"]) },
    Target { name: "obj", read: read_mesh, seeds: |at| seeds::meshes(at, &["obj"]) },
    Target { name: "opencarp", read: read_opencarp, seeds: seeds::opencarp },
    Target { name: "carto", read: read_folder, seeds: seeds::carto },
    Target { name: "ensite", read: read_folder, seeds: seeds::ensite },
    Target { name: "mat", read: read_on_sheet, seeds: seeds::mat },
    Target { name: "csv", read: read_table, seeds: seeds::tables },
    Target { name: "npz", read: read_npz, seeds: seeds::npz },
    Target { name: "plan", read: read_plan, seeds: seeds::plan },
    Target { name: "run_records", read: read_record, seeds: seeds::run },
    Target { name: "checkpoints", read: read_checkpoint, seeds: seeds::checkpoint },
    Target { name: "model_text", read: read_model, seeds: seeds::models },
];

/// The reader of this name.
///
/// # Panics
/// If there is none.
pub(crate) fn target(name: &str) -> &'static Target {
    TARGETS.iter().find(|target| target.name == name).expect("a target of this name")
}

/// A mesh that is accepted is a surface: of finite extent, with triangles of its vertices, and data for each.
fn read_mesh(path: &Path) {
    let Ok(surface) = mesh::read(path, mesh::Units::Mm) else { return };
    let mesh = &surface.mesh;
    let n = mesh.n_vertices();
    assert!(mesh.area().is_finite() && mesh.area() > 0.0);
    assert!(mesh.vertices().iter().flatten().all(|x| x.is_finite()));
    assert!(mesh.triangles().iter().flatten().all(|v| (*v as usize) < n));
    assert!(surface.point_data.values().all(|array| array.n_rows() == n));
    assert!(surface.cell_data.values().all(|array| array.n_rows() == mesh.n_triangles()));
}

/// A file of openCARP: a part of a mesh, or values on one.
fn read_opencarp(path: &Path) {
    if path.extension().is_some_and(|e| e == "dat" || e == "igb") {
        read_on_sheet(path);
    } else {
        read_mesh(&path.with_extension("pts"));
    }
}

/// Imports a study as the command does, short of writing.
fn import(path: &Path, given: &Given) {
    for mesh_values in [false, true] {
        let Ok((mut study, sources)) = read_study(path, given) else { continue };
        let options = Options { mesh_values, thin: Some(5.0), ..Options::default() };
        if let Ok(selected) = select(&mut study, &options) {
            selected.record(path, &study, &sources, &options);
        }
    }
}

/// A study of the files in this one's folder.
fn read_folder(path: &Path) {
    import(path.parent().unwrap_or(path), &Given::default());
}

/// A study of one file, on the surface beside it.
fn read_on_sheet(path: &Path) {
    let mesh = Some(path.with_file_name("sheet.vtk"));
    import(path, &Given { mesh, quantity: Some("lat".into()), ..Given::default() });
    import(path, &Given::default());
}

/// A table that is accepted has rows, and as many when it is written and read again; a pacing log is a study.
fn read_table(path: &Path) {
    read_on_sheet(path);
    let _ = read_loo(path);
    let _ = read_rows(path);
    let _ = Table::read(path);
    let Ok(mut table) = Measurements::read(path) else { return };
    assert!(!table.is_empty());
    let _ = table.place_at_indices(20);
    let again = path.with_file_name("again.csv");
    if std::fs::write(&again, table.to_csv()).is_ok()
        && let Ok(again) = Measurements::read(&again)
    {
        assert_eq!(again.len(), table.len());
    }
}

/// Modes that are accepted are finite and in order, and draws are numbers.
fn read_npz(path: &Path) {
    if let Ok(basis) = Basis::read_npz(path) {
        assert!(basis.eigenvalues.is_sorted());
        assert!(basis.eigenfunctions.iter().chain(&basis.eigenvalues).all(|x| x.is_finite()));
        assert_eq!(basis.eigenfunctions.len(), basis.n_vertices() * basis.n_modes());
    }
    if let Ok(draws) = FieldDraws::read(path) {
        assert!(draws.coefficients.values().flatten().all(|x| x.is_finite()));
    }
    read_mesh(path);
}

fn read_plan(path: &Path) {
    if let Ok(plan) = Plan::read(path) {
        assert!(!plan.lengthscales.is_empty() && !plan.sites.is_empty());
    }
}

/// A file of a run's folder.
fn read_record(path: &Path) {
    let folder = path.parent().unwrap_or(path);
    let _ = RunRecord::read(path);
    let _ = read_summary_json(path);
    let _ = read_loo(path);
    let _ = read_rows(path);
    let _ = FieldDraws::read(path);
    if let Ok(results) = Results::read(folder) {
        let _ = (results.text(), results.json(), Inputs::of_run(&results));
    }
}

/// Goes on with the run of a checkpoint whose checksums are made right again.
fn read_checkpoint(path: &Path) {
    let folder = path.parent().unwrap_or(path);
    if path.ends_with("identity.json") {
        let _ = Checkpoint::identity(folder);
        return;
    }
    seeds::seal(path);
    let Ok(checkpoint) = Checkpoint::resume(folder, &Identity::new(), Duration::from_hours(1))
    else {
        return;
    };
    let progress = Keeps { checkpoint, left: usize::MAX.into() };
    let chains = sample(&Normals, &seeds::STARTS.map(Vec::from), &settings(), &progress);
    for chain in chains.into_iter().flatten().flatten() {
        assert_eq!(chain.draws.n_rows(), settings().draws);
    }
}

/// A model's text that is accepted can be checked, and told as equations.
fn read_model(path: &Path) {
    let Ok(source) = std::fs::read_to_string(path) else { return };
    if let Ok(file) = eplat_language::File::read(&source) {
        let _ = file.check();
    }
    // where tokens stand is kept of every text that was ever read: after 2¹⁷ of them that list outgrew the memory allowed
    proc_macro2::extra::invalidate_current_thread_spans();
}

/// Keeps chains.
pub(crate) struct Keeps {
    pub(crate) checkpoint: Checkpoint,
    /// Transitions after which all chains stop, and are kept.
    pub(crate) left: AtomicUsize,
}

impl Progress for Keeps {
    fn report(&self, _: &eplat::infer::ChainProgress) {}
    fn checkpoint(&self) -> Option<&Checkpoint> {
        Some(&self.checkpoint)
    }
    fn should_stop(&self) -> bool {
        let one_less = |n: usize| n.checked_sub(1);
        self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, one_less).is_err()
    }
}

/// Three independent normals, with standard deviations 1, 10 and 100.
pub(crate) struct Normals;

impl LogDensity for Normals {
    fn dim(&self) -> usize {
        3
    }
    fn evaluator(&self) -> Box<dyn Evaluator + '_> {
        Box::new(Self)
    }
}

impl Evaluator for Normals {
    fn ln_density(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        let precision = [1.0, 0.01, 0.0001];
        let mut ln_density = 0.0;
        for i in 0..3 {
            gradient[i] = -precision[i] * position[i];
            ln_density += 0.5 * gradient[i] * position[i];
        }
        ln_density
    }
}

/// The settings of a run that is kept.
pub(crate) fn settings() -> Settings {
    Settings { chains: 2, warmup: 30, draws: 20, threads: 1, ..Settings::default() }
}
