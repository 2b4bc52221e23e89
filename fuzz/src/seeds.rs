//! Valid files to begin from. All of them are made here or by what makes files for the tests; none is anybody's data.

use std::path::{Path, PathBuf};
use std::time::Duration;

use eplat::infer::sample;
use eplat::manifold::eigenpairs;
use eplat::run::{Inputs, OutputFolder, Problem};
use eplat::store::{Checkpoint, Identity};
use flate2::Crc;

use crate::readers::{Keeps, Normals, settings};

#[path = "../../tests/support/carto.rs"]
mod carto_study;
#[path = "../../tests/support/encodings.rs"]
mod encodings;
#[path = "../../tests/support/ensite.rs"]
mod ensite_study;
#[path = "../../tests/support/mat.rs"]
mod mat_file;
#[path = "../../tests/support/sheet.rs"]
mod sheet;

/// Where the chains of a checkpoint begin.
pub(crate) const STARTS: [[f64; 3]; 2] = [[0.5, 3.0, -20.0], [-1.0, 8.0, 60.0]];

/// A surface for values that come without one.
const SHEET: &str = "# vtk DataFile Version 3.0\ns\nASCII\nDATASET POLYDATA\nPOINTS 4 double\n0 0 0 6 0 0 0 6 0 6 6 0\n\
    POLYGONS 2 8\n3 0 1 2\n3 1 3 2\n";

const VTP: &str = "<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPoints=\"4\" NumberOfPolys=\"2\"><Points>\
    <DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 10 0 0 0 10 0 10 10 0</DataArray></Points><Polys>\
    <DataArray type=\"Int64\" Name=\"connectivity\" format=\"ascii\">0 1 2 1 3 2</DataArray>\
    <DataArray type=\"Int64\" Name=\"offsets\" format=\"ascii\">3 6</DataArray></Polys></Piece></PolyData></VTKFile>";

const TABLE: &str = "site,vertex,protocol,lower,upper,\"force, g\"\nA,3,S1S2,200,210,12.5\nB,7,S1S2S3,180,190,\n\
    \"C \"\"x\"\"\",9,S1S2,'=1,210,1e3\n";

const GERMAN: &str = "site;vertex;value\nA;3;1,5\nB;4;2,25\n";

const LOG: &str = "Site;X [mm];Y [mm];Z [mm];S1 [ms];S2 [ms];S3 [ms];Captured;Force [g]\r\n\
    A;0,5;0,2;0;600;280;;yes;12,5\r\nA;0,5;0,2;0;600;270;;no;12,5\r\nA;0,5;0,2;0;600;300;220;yes;12,5\r\n";

const PLAN: &str = "model = \"erp.rs\"\nlengthscales = [64.0, 128.0]\nsites = [5, 10]\nresolutions = [10.0, 20.0]\nfields = 8\n\
    designs = 3\nminutes = { s1s2 = 2.0 }\n";

/// Writes files into a folder; their paths.
fn written<B: AsRef<[u8]>>(
    folder: &Path,
    files: impl IntoIterator<Item = (String, B)>,
) -> Vec<PathBuf> {
    let write = |(name, bytes): (String, B)| {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap_or(folder)).unwrap();
        std::fs::write(&path, bytes).unwrap();
        path
    };
    files.into_iter().map(write).collect()
}

fn named<const N: usize>(files: [(&str, &str); N]) -> Vec<(String, Vec<u8>)> {
    files.map(|(name, text)| (name.to_owned(), text.into())).into()
}

/// A surface in the formats with these extensions.
pub(crate) fn meshes(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let is_one =
        |path: &PathBuf| extensions.iter().any(|e| path.extension().is_some_and(|x| x == *e));
    let mut found = encodings::written(sheet::mesh(), folder);
    found.extend(written(folder, named([("t.vtp", VTP), ("t.vtk", SHEET)])));
    found.retain(is_one);
    found
}

/// A mesh of openCARP, and values on one.
pub(crate) fn opencarp(folder: &Path) -> Vec<PathBuf> {
    let mut found = meshes(folder, &["pts"]);
    found.push(folder.join("a.elem"));
    let mut igb = b"x:4 y:1 z:1 t:1 type:float systeme:little_endian facteur:1 zero:0 ".to_vec();
    igb.resize(1023, b' ');
    igb.push(0x0c);
    igb.extend([1.0_f32, 2.0, 3.0, 4.0].iter().flat_map(|x| x.to_le_bytes()));
    sheet_beside(folder);
    found.extend(written(
        folder,
        [("v.igb".to_owned(), igb), ("v.dat".to_owned(), b"1\n2.5\n-1\n4\n".to_vec())],
    ));
    found
}

fn sheet_beside(folder: &Path) {
    written(folder, named([("sheet.vtk", SHEET)]));
}

/// The first two points of a study of CARTO, which are enough.
pub(crate) fn carto(folder: &Path) -> Vec<PathBuf> {
    let is_small = |name: &str| !(3..=12).any(|k| name.contains(&format!("_P{k}_")));
    written(folder, carto_study::files().into_iter().filter(|(name, _)| is_small(name)))
}

/// Studies of `EnSite` Precision and X.
pub(crate) fn ensite(folder: &Path) -> Vec<PathBuf> {
    use ensite_study::{MAP_X, WAVE_X, cp1252, dxl, surface};
    written(
        folder,
        [
            ("a/DxLandmarkGeo.xml".to_owned(), surface("P-P Voltage (bi)").into_bytes()),
            ("a/DxL_1.csv".to_owned(), cp1252(&dxl(1))),
            ("a/DxL_2.csv".to_owned(), cp1252(&dxl(2))),
            ("b/Contact_Mapping_Model.xml".to_owned(), surface("LAT (bi)").into_bytes()),
            ("b/Map_LAT_bi.csv".to_owned(), MAP_X.into()),
            ("b/Wave_rov.csv".to_owned(), WAVE_X.into()),
        ],
    )
}

/// Data sets of `OpenEP`, in MATLAB's versions 5 and 7.3.
pub(crate) fn mat(folder: &Path) -> Vec<PathBuf> {
    sheet_beside(folder);
    let new = include_bytes!("../../tests/studies/openep_v73.mat").to_vec();
    written(folder, [("five.mat".to_owned(), mat_file::openep(None)), ("new.mat".to_owned(), new)])
}

/// Tables of measurements, and a log of pacing.
pub(crate) fn tables(folder: &Path) -> Vec<PathBuf> {
    sheet_beside(folder);
    written(folder, named([("table.csv", TABLE), ("german.csv", GERMAN), ("log.csv", LOG)]))
}

/// Eigenpairs, draws of fields, and a mesh.
pub(crate) fn npz(folder: &Path) -> Vec<PathBuf> {
    let path = folder.join("basis.npz");
    let basis = eigenpairs(&sheet::mesh(), 12).unwrap();
    basis.write_npz(&path).unwrap();
    let draws = eplat::report::FieldDraws {
        n_modes: 12,
        eigenfunctions: basis.eigenfunctions.into(),
        coefficients: [("f".to_owned(), (0..26).map(f64::from).collect())].into(),
        within: std::collections::BTreeMap::new(),
    };
    let drawn = folder.join("field_draws.npz");
    draws.write(&drawn).unwrap();
    [vec![path, drawn], meshes(folder, &["npz"])].concat()
}

/// A plan of a study.
pub(crate) fn plan(folder: &Path) -> Vec<PathBuf> {
    written(folder, named([("plan.toml", PLAN)]))
}

/// What a short run leaves.
pub(crate) fn run(folder: &Path) -> Vec<PathBuf> {
    let shipped =
        eplat_models::MODELS.iter().find(|compiled| compiled.model.name() == "Erp").unwrap();
    let problem = Problem::load(shipped.model, &Inputs::default()).unwrap();
    let fit = problem.fit(&settings()).unwrap();
    fit.write_into(&OutputFolder::open(folder).unwrap()).unwrap();
    ["run.json", "summary.json", "loo.csv", "rows.csv", "field_draws.npz"]
        .map(|name| folder.join(name))
        .into()
}

/// What a run leaves when it is killed, after a meeting of its chains.
pub(crate) fn checkpoint(folder: &Path) -> Vec<PathBuf> {
    let long = Duration::from_hours(1);
    let checkpoint = Checkpoint::begin(folder, &Identity::new(), long).unwrap();
    let progress = Keeps { checkpoint, left: 60.into() };
    sample(&Normals, &STARTS.map(Vec::from), &settings(), &progress).unwrap();
    ["identity.json", "common", "chain-0", "chain-1"].map(|name| folder.join(name)).into()
}

/// Makes the checksum of a state right, whatever stands in it.
pub(crate) fn seal(path: &Path) {
    let mut bytes = std::fs::read(path).unwrap();
    let Some(end) = bytes.len().checked_sub(4) else { return };
    let mut crc = Crc::new();
    crc.update(&bytes[..end]);
    bytes[end..].copy_from_slice(&crc.sum().to_le_bytes());
    std::fs::write(path, bytes).unwrap();
}

/// Models that ship.
pub(crate) fn models(folder: &Path) -> Vec<PathBuf> {
    let texts = [
        ("erp.rs", include_str!("../../models/erp.rs")),
        ("custom.rs", include_str!("../../models/custom.rs")),
        ("joint.rs", include_str!("../../models/joint.rs")),
        ("garch.rs", include_str!("../../models/garch.rs")),
    ];
    written(folder, named(texts))
}
