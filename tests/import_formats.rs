//! What `eplat import` makes of files that are no export of CARTO: OpenEP, meshes with values, pacing logs.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/ensite.rs"]
mod ensite;
#[path = "support/mat.rs"]
mod mat;
#[path = "support/program.rs"]
mod program;

use std::process::Output;

use program::{Workplace, shared, text};

fn transcript(output: &Output) -> String {
    let code = output.status.code().unwrap();
    format!("exit {code}\n--- stdout\n{}--- stderr\n{}", text(&output.stdout), text(&output.stderr))
}

fn ok(place: &Workplace, arguments: &str) -> String {
    let output = place.eplat(arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments}\n{}", transcript(&output));
    text(&output.stdout)
}

fn column(table: &str, name: &str) -> Vec<String> {
    let mut lines = table.lines().map(|line| line.split(',').map(String::from).collect::<Vec<_>>());
    let header = lines.next().unwrap();
    let k = header.iter().position(|own| own == name).unwrap_or_else(|| panic!("{name}: {table}"));
    lines.map(|cells| cells[k].clone()).collect()
}

/// A sheet of 3 × 3 vertices, 6 mm apart, with activation.
const SHEET: &str = "# vtk DataFile Version 3.0\nsheet\nASCII\nDATASET POLYDATA\nPOINTS 9 double
0 0 0 6 0 0 12 0 0 0 6 0 6 6 0 12 6 0 0 12 0 6 12 0 12 12 0
POLYGONS 8 32\n3 0 1 3\n3 1 4 3\n3 1 2 4\n3 2 5 4\n3 3 4 6\n3 4 7 6\n3 4 5 7\n3 5 8 7
POINT_DATA 9\nSCALARS Activation double\nLOOKUP_TABLE default\n0 6 12 nan 9 15 6 12 18\n";

#[test]
fn openep_of_either_version_gives_the_same() {
    let place = Workplace::new();
    place.file("case.mat", mat::openep(None));
    place.file("v73/case.mat", include_bytes!("studies/openep_v73.mat"));
    place.file("v73/notes.txt", "a folder with the file and something else");
    insta::assert_snapshot!(ok(&place, "import case.mat --out a"));
    insta::assert_snapshot!(place.read("a/measurements.csv"));
    let said = ok(&place, "import v73 --out b");
    assert!(said.contains("OpenEP, MATLAB file of version 7.3"), "{said}");
    assert_eq!(place.read("a/measurements.csv"), place.read("b/measurements.csv"));
    let surfaces =
        ["a", "b"].map(|out| std::fs::read(place.path(&format!("{out}/surface.vtp"))).unwrap());
    assert_eq!(surfaces[0], surfaces[1]);
}

#[test]
fn tags_and_electrodes_of_openep_are_columns() {
    let place = Workplace::new();
    let electrodes = mat::Value::Texts(vec!["A 1-2", "A 3-4", "µ 1-2", "A 1-2"]);
    let tags = mat::Value::Texts(vec!["", "scar", "", "  phrenic "]);
    let more = vec![("tags", tags), ("electrodeNames_bip", electrodes)];
    place.file("case.mat", mat::openep_with(None, more));
    ok(&place, "import case.mat --out a");
    let table = place.read("a/measurements.csv");
    place.file("v73/case.mat", include_bytes!("studies/openep_v73_texts.mat"));
    ok(&place, "import v73 --out b");
    assert_eq!(table, place.read("b/measurements.csv"), "version 7.3");
    let column = |name: &str| {
        let k = table.lines().next().unwrap().split(',').position(|title| title == name).unwrap();
        let cells = table.lines().skip(1).map(|line| line.split(',').nth(k).unwrap().to_owned());
        let site = table.lines().next().unwrap().split(',').position(|title| title == "site");
        let sites = table.lines().skip(1).map(|line| line.split(',').nth(site.unwrap()).unwrap());
        sites.map(str::to_owned).zip(cells).collect::<std::collections::BTreeSet<_>>()
    };
    let pairs = |all: &[(&str, &str)]| {
        all.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect()
    };
    let tags = pairs(&[("P1", ""), ("P2", "scar"), ("P3", ""), ("P4", "phrenic")]);
    assert_eq!(column("tag"), tags);
    let electrodes = pairs(&[("P1", "A 1-2"), ("P2", "A 3-4"), ("P3", "µ 1-2"), ("P4", "A 1-2")]);
    assert_eq!(column("electrode"), electrodes);
}

#[test]
fn what_openep_cannot_be_read_from_says_the_remedy() {
    let place = Workplace::new();
    place.file("object.mat", mat::openep(Some(mat::Value::Object("TriRep"))));
    place.file("other.mat", mat::file("x", &mat::Value::Int32(vec![1])));
    place.file(
        "text.mat",
        "no MATLAB file at all, but a text that is longer than its header would be. ".repeat(4),
    );
    let mut cut = mat::openep(None);
    cut.truncate(900);
    place.file("cut.mat", cut);
    let said: Vec<String> = ["object.mat", "other.mat", "text.mat", "cut.mat"]
        .iter()
        .map(|file| transcript(&place.eplat(&format!("import {file} --out out"))))
        .collect();
    insta::assert_snapshot!(said.join("\n"));
    assert!(!place.path("out").exists());
}

#[test]
fn values_on_a_mesh_are_measurements_at_its_vertices() {
    let place = Workplace::new();
    place.file("sheet.vtk", SHEET);
    place.file("lat.dat", "0\n6\n12\n-1\n9\n15\n6\n12\n18\n");
    place.file("short.dat", "0\n6\n");
    insta::assert_snapshot!(ok(&place, "import sheet.vtk --units mm --out a"));
    let from_mesh = place.read("a/measurements.csv");
    assert_eq!(column(&from_mesh, "vertex"), ["0", "1", "2", "4", "5", "6", "7", "8"]);
    assert_eq!(column(&from_mesh, "value")[4], "15");
    ok(&place, "import lat.dat --mesh sheet.vtk --units mm --out b");
    assert_eq!(place.read("b/measurements.csv"), from_mesh);
    ok(&place, "mesh convert sheet.vtk sheet.pts --units mm");
    ok(&place, "import lat.dat --mesh sheet.pts --out carp");
    let from_carp = place.read("carp/measurements.csv");
    for name in ["vertex", "value", "x"] {
        assert_eq!(column(&from_carp, name), column(&from_mesh, name));
    }
    ok(&place, "import sheet.vtk --units mm --out c --thin 10 --array Activation --as unipolar");
    let thinned = place.read("c/measurements.csv");
    assert_eq!(column(&thinned, "protocol"), ["unipolar"; 4]);
    assert_eq!(column(&thinned, "vertex"), ["0", "2", "6", "8"]);
    let said: Vec<String> = [
        "import lat.dat --out d",
        "import short.dat --mesh sheet.vtk --as lat --out d",
        "import sheet.vtk --array act --out d",
        "import sheet.vtk --as potential --out d",
    ]
    .iter()
    .map(|arguments| format!("$ eplat {arguments}\n{}", transcript(&place.eplat(arguments))))
    .collect();
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn a_folder_with_one_mesh_is_read_as_that_mesh_and_several_are_named() {
    let place = Workplace::new();
    place.file("sheet.vtk", SHEET);
    place.file("one/sheet.vtk", SHEET).file("one/notes.md", "of no meaning here");
    ok(&place, "import sheet.vtk --out a");
    ok(&place, "import one --out b");
    assert_eq!(place.read("a/measurements.csv"), place.read("b/measurements.csv"));
    place.file("one/other.vtk", SHEET);
    let refused = place.eplat("import one --out c");
    assert_eq!(refused.status.code(), Some(1));
    let said = transcript(&refused);
    assert!(said.contains("give one of them: other.vtk, sheet.vtk"), "{said}");
    // points of openCARP without elements, such as coordinates on the surface, are no mesh beside one
    place.file("carp/notes.txt", "of no meaning here");
    ok(&place, "mesh convert sheet.vtk carp/atrium.pts --units mm");
    place.file("carp/atrium_uac.pts", "2\n0 0 0\n1 1 0\n");
    let said = ok(&place, "import carp --out d");
    assert!(said.contains("\nno measurements: there is nothing that a model could be run on\nnext: eplat import LOG.csv --mesh d/surface.vtp --units mm"), "{said}");
    let said = transcript(&place.eplat("import carp/atrium_uac.pts --out e"));
    assert!(
        said.contains(
            "atrium_uac.elem: no such file, in which openCARP has the elements of a mesh"
        ),
        "{said}"
    );
}

#[test]
fn a_pacing_log_of_a_spreadsheet_becomes_brackets() {
    let place = Workplace::new();
    place.file("sheet.vtk", SHEET);
    let log = "\u{feff}Site;X [mm];Y [mm];Z [mm];S1 [ms];S2 [ms];S3 [ms];Captured;Force [g];;\r
A;0,5;0,2;0;600;280;;yes;12,5;;\r
A;0,5;0,2;0;600;270;;no;12,5;;\r
A;0,5;0,2;0;600;300;220;yes;12,5;;\r
A;0,5;0,2;0;600;300;210;no;12,5;;\r
B;12;12;0,5;600;250;;yes;8;;\r
B;12;12;0,5;600;260;;no;8;;\r
C;6;6;0;600;290;;yes;9,25;;\r
;;;;;;;;;;\r
";
    place.file("log.csv", log);
    insta::assert_snapshot!(ok(&place, "import log.csv --mesh sheet.vtk --units mm --out a"));
    insta::assert_snapshot!(place.read("a/measurements.csv"));
    let record: serde_json::Value = serde_json::from_str(&place.read("a/import.json")).unwrap();
    let names: Vec<&str> =
        record["sources"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["log.csv", "sheet.vtk"]);
    let said = ok(&place, "import log.csv --out b --closed");
    assert!(said.contains("left out: brackets with an open end (1)"), "{said}");
    assert!(said.contains("no surface: --mesh FILE places the measurements now"), "{said}");
    assert_eq!(column(&place.read("b/measurements.csv"), "x"), ["0.5", "0.5"]);
    place.file("table.csv", "vertex,value\n1,2\n");
    insta::assert_snapshot!(transcript(&place.eplat("import table.csv --out c")));
}

#[test]
fn the_clinical_shell_gives_lat_at_its_vertices() {
    let Some(shell) = shared("openep_la/la_lat.vtk") else { return };
    let place = Workplace::new();
    let import = |out: &str, more: &[&str]| {
        let mut command = place.command("import");
        let output = command.arg(&shell).args(["--out", out]).args(more).output().unwrap();
        let said = transcript(&output);
        assert_eq!(output.status.code(), Some(0), "{said}");
        said
    };
    let said = import("all", &[]);
    // the 62 vertices without a value are those of the piece that is dropped
    assert!(said.contains("left out 1 other piece (62 vertices)"), "{said}");
    assert!(said.contains("\n  lat: 8786 lat"), "{said}");
    let n_all = place.read("all/measurements.csv").lines().count() - 1;
    assert!(said.contains(&format!("  {n_all} measurements of lat")), "{said}");
    import("thin", &["--thin", "8"]);
    let n_thin = place.read("thin/measurements.csv").lines().count() - 1;
    assert!((100..1000).contains(&n_thin), "{n_thin} of {n_all}");
    place.file("lat.rs", include_str!("../models/lat.rs"));
    let check = "check lat.rs --mesh thin/surface.vtp --units mm --data thin/measurements.csv";
    assert!(ok(&place, check).contains(&format!("observe lat: {n_thin} measurements")));
}

#[test]
fn simulated_activation_is_imported_by_its_array() {
    let Some(mesh) = shared("fibernet/LA_model.vtk") else { return };
    let place = Workplace::new();
    let mut command = place.command("import");
    let output = command.arg(mesh).args(["--out", "la", "--thin", "10"]).output().unwrap();
    let said = transcript(&output);
    assert!(said.contains("array `activation_times` is taken as lat"), "{said}");
}

/// Studies of both systems.
fn with_ensite(place: &Workplace) {
    place.file("precision/SR/DxLandmarkGeo.xml", ensite::surface("P-P Voltage (bi)"));
    for k in [1, 2] {
        place.file(&format!("precision/SR/DxL_{k}.csv"), ensite::cp1252(&ensite::dxl(k)));
    }
    place.file("x/map/Contact_Mapping_Model.xml", ensite::surface("LAT Isochronal (bi)"));
    place.file("x/map/Map_LAT_bi.csv", ensite::MAP_X).file("x/map/Wave_rov.csv", ensite::WAVE_X);
}

#[test]
fn studies_of_ensite_are_read_as_they_are_described() {
    let place = Workplace::new();
    with_ensite(&place);
    insta::assert_snapshot!(ok(&place, "import precision --out a"));
    insta::assert_snapshot!(place.read("a/measurements.csv"));
    insta::assert_snapshot!(ok(&place, "import x --out b"));
    insta::assert_snapshot!(place.read("b/measurements.csv"));
    let said = ok(&place, "import x --out c --mesh-values");
    assert!(said.contains("8 measurements of lat"), "{said}");
    let old = ensite::surface("LAT").replace("SJM_DIF_5.0", "SJM_DIF_3.0");
    place.file("old/DxLandmarkGeo.xml", old);
    let corners = ensite::surface("LAT").replace("1 2 4\n", "0 2 4\n");
    place.file("zero/DxLandmarkGeo.xml", corners);
    let said: Vec<String> = ["old", "zero"]
        .iter()
        .map(|study| transcript(&place.eplat(&format!("import {study} --out d"))))
        .collect();
    insta::assert_snapshot!(said.join("\n"));
}
