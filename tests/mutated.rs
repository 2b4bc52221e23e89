//! Valid files with bytes changed: every reader gives a value or an error, soon, and never panics; what is accepted
//! is what it should be.
//!
//! Five hundred mutations of each file, seeded. For an hour:
//! `EPLAT_MUTATIONS=100000 cargo test --release --test mutated`.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/encodings.rs"]
mod encodings;
#[path = "support/program.rs"]
mod program;
#[path = "support/sheet.rs"]
mod sheet;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use eplat::manifold::{Basis, eigenpairs};
use eplat::mesh;
use eplat::report::{FieldDraws, RunRecord, read_loo, read_rows, read_summary_json};
use eplat::run::{Inputs, Results};
use eplat::store::Checkpoint;
use eplat::study::{Plan, Table};
use eplat::table::Measurements;
use program::{Workplace, text};
use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// No file here takes longer, whatever stands in it.
const LONGEST: Duration = Duration::from_secs(2);

/// Texts that have broken readers before.
const WORDS: [&str; 16] = [
    "4611686018427387904",
    "18446744073709551615",
    "-1",
    "0",
    "1e308",
    "-1e-308",
    "nan",
    "inf",
    "0.9",
    "\0",
    "\u{feff}",
    "<!--",
    "\"",
    "\r\n",
    "{",
    "é",
];

fn mutations() -> usize {
    std::env::var("EPLAT_MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(500)
}

/// Some bytes changed, taken away, repeated, or replaced by a word; perhaps cut.
fn mutated(bytes: &[u8], rng: &mut impl Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..rng.random_range(1..5) {
        // half of them where headers are
        let reach = if rng.random() { bytes.len().min(400) } else { bytes.len() };
        let at = rng.random_range(0..reach.max(1)).min(bytes.len().saturating_sub(1));
        let end = (at + rng.random_range(1..12)).min(bytes.len());
        match rng.random_range(0..6) {
            0 if at < bytes.len() => bytes[at] = rng.random(),
            1 if at < bytes.len() && bytes[at].is_ascii_digit() => {
                bytes[at] = b'0' + rng.random_range(0..10u8);
            }
            2 => drop(bytes.drain(at..end)),
            3 => drop(bytes.splice(end..end, bytes[at..end].to_vec())),
            4 => bytes.truncate(rng.random_range(0..=bytes.len())),
            _ => {
                let word = WORDS[rng.random_range(0..WORDS.len())];
                drop(bytes.splice(at..end, word.bytes()));
            }
        }
    }
    bytes
}

/// Reads the file of this path.
type Reader<'r> = &'r dyn Fn(&Path);

/// Reads mutations of a file; `read` panics on what should have been refused.
fn survives(path: &Path, read: Reader<'_>) {
    read(path);
    let bytes = std::fs::read(path).unwrap();
    let name = path.file_name().unwrap().display().to_string();
    let mut rng = ChaCha8Rng::seed_from_u64(name.bytes().map(u64::from).sum());
    for case in 0..mutations() {
        let hostile = mutated(&bytes, &mut rng);
        std::fs::write(path, &hostile).unwrap();
        let begun = Instant::now();
        let outcome = catch_unwind(AssertUnwindSafe(|| read(path)));
        let kept = || {
            let kept = std::env::temp_dir().join(format!("eplat-mutated-{case}-{name}"));
            std::fs::write(&kept, &hostile).unwrap();
            kept.display().to_string()
        };
        assert!(outcome.is_ok(), "mutation {case} of {name}: {}", kept());
        assert!(begun.elapsed() < LONGEST, "mutation {case} of {name} takes long: {}", kept());
    }
    std::fs::write(path, bytes).unwrap();
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

#[test]
fn meshes_of_every_format() {
    let folder = tempfile::tempdir().unwrap();
    for path in encodings::written(sheet::mesh(), folder.path()) {
        survives(&path, &read_mesh);
    }
    survives(&folder.path().join("a.elem"), &read_mesh);
    let text = "<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPoints=\"4\" NumberOfPolys=\"2\"><Points>\
        <DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 10 0 0 0 10 0 10 10 0</DataArray></Points><Polys>\
        <DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">0 1 2 1 3 2</DataArray>\
        <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">3 6</DataArray></Polys></Piece></PolyData></VTKFile>";
    let path = folder.path().join("a.vtp");
    std::fs::write(&path, text).unwrap();
    survives(&path, &read_mesh);
}

#[test]
fn a_basis() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = sheet::mesh();
    let path = folder.path().join("basis.npz");
    eigenpairs(&mesh, 12).unwrap().write_npz(&path).unwrap();
    survives(&path, &|path| {
        let Ok(basis) = Basis::read_npz(path) else { return };
        assert!(basis.eigenvalues.is_sorted());
        assert!(basis.eigenfunctions.iter().chain(&basis.eigenvalues).all(|x| x.is_finite()));
        assert_eq!(basis.eigenfunctions.len(), basis.n_vertices() * basis.n_modes());
    });
}

#[test]
fn tables_and_plans() {
    let place = Workplace::new();
    place
        .file(
            "table.csv",
            "site,vertex,protocol,lower,upper,\"force, g\"\nA,3,S1S2,200,210,12.5\nB,7,S1S2S3,180,190,\n\"C \"\"x\"\"\",9,S1S2,'=1,210,1e3\n",
        )
        .file("german.csv", "site;vertex;value\nA;3;1,5\nB;4;2,25\n")
        .file(
            "plan.toml",
            "model = \"erp.rs\"\nlengthscales = [64.0, 128.0]\nsites = [5, 10]\nresolutions = [10.0, 20.0]\nfields = 8\ndesigns = 3\n",
        );
    let table = |path: &Path| {
        let Ok(mut table) = Measurements::read(path) else { return };
        assert!(!table.is_empty());
        let _ = table.place_at_indices(20);
        let again = place.path("again.csv");
        std::fs::write(&again, table.to_csv()).unwrap();
        if let Ok(again) = Measurements::read(&again) {
            assert_eq!(again.len(), table.len());
        }
    };
    survives(&place.path("table.csv"), &table);
    survives(&place.path("german.csv"), &table);
    survives(&place.path("plan.toml"), &|path| {
        if let Ok(plan) = Plan::read(path) {
            // numbers of cases that fit in a table
            assert!(!plan.lengthscales.is_empty());
        }
    });
}

#[test]
fn models() {
    for (name, source) in [
        ("erp", include_str!("../models/erp.rs")),
        ("custom", include_str!("../models/custom.rs")),
        ("joint", include_str!("../models/joint.rs")),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("{name}.rs"));
        std::fs::write(&path, source).unwrap();
        survives(&path, &|path| {
            let Ok(source) = std::fs::read_to_string(path) else { return };
            if let Ok(file) = eplat_language::File::read(&source) {
                let _ = file.check();
            }
        });
    }
}

/// What a run leaves, and what an interrupted one does.
#[test]
fn the_files_of_a_run() {
    let place = Workplace::new();
    let ran = place.eplat("run erp --chains 2 --warmup 40 --draws 40 --out run");
    assert_ne!(ran.status.code(), Some(1), "{}", text(&ran.stderr));
    let folder = place.path("run");
    let readers: [(&str, Reader<'_>); 7] = [
        ("run.json", &|path| drop(RunRecord::read(path))),
        ("run.json", &|_| {
            if let Ok(results) = Results::read(&folder) {
                let _ = (results.text(), results.json(), Inputs::of_run(&results));
            }
        }),
        ("summary.json", &|path| drop(read_summary_json(path))),
        ("loo.csv", &|path| drop(read_loo(path))),
        ("rows.csv", &|path| drop(read_rows(path))),
        ("field_draws.npz", &|path| {
            let Ok(draws) = FieldDraws::read(path) else { return };
            assert!(draws.coefficients.values().flatten().all(|x| x.is_finite()));
        }),
        ("summary.json", &|path| drop(Table::read(path))),
    ];
    for (name, read) in readers {
        survives(&folder.join(name), read);
    }
    let identity: PathBuf = place.path("kept/identity.json");
    place.file("kept/identity.json", "{\"seed\": \"1\", \"draws\": \"1000\"}");
    survives(&identity, &|path| drop(Checkpoint::identity(path.parent().unwrap())));
}
