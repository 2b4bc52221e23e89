//! `eplat import` and what `eplat check` and `eplat run` make of its folders.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/carto.rs"]
mod carto;
#[path = "support/program.rs"]
mod program;

use std::io::Write as _;
use std::path::Path;
use std::process::Output;

use program::{Workplace, shared, text};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

fn transcript(output: &Output) -> String {
    let code = output.status.code().unwrap();
    format!("exit {code}\n--- stdout\n{}--- stderr\n{}", text(&output.stdout), text(&output.stderr))
}

/// The tiny CARTO study in the folder `study`, and in `study.zip`.
fn with_carto(place: &Workplace) {
    let mut archive = ZipWriter::new(std::fs::File::create(place.path("study.zip")).unwrap());
    for (name, bytes) in carto::files() {
        place.file(&format!("study/{name}"), &bytes);
        archive.start_file(format!("export/{name}"), SimpleFileOptions::default()).unwrap();
        archive.write_all(&bytes).unwrap();
    }
    archive.finish().unwrap();
}

fn ok(place: &Workplace, arguments: &str) -> String {
    let output = place.eplat(arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments}\n{}", transcript(&output));
    text(&output.stdout)
}

#[test]
fn a_carto_study_becomes_a_surface_and_a_table() {
    let place = Workplace::new();
    with_carto(&place);
    insta::assert_snapshot!(ok(&place, "import study --out la"));
    insta::assert_snapshot!(place.read("la/measurements.csv"));
    let record: serde_json::Value = serde_json::from_str(&place.read("la/import.json")).unwrap();
    assert_eq!(record["measurements"]["lat"], 8);
    assert_eq!(record["units"]["bipolar"], "mV");
    let sources = record["sources"].as_array().unwrap();
    // all but the two files of the point that is a location only
    assert_eq!(sources.len(), carto::files().len() - 2);
    assert!(sources.iter().all(|s| s["sha256"].as_str().unwrap().len() == 64));
    // an archive of it gives the same table
    ok(&place, "import study.zip --out zipped");
    assert_eq!(place.read("zipped/measurements.csv"), place.read("la/measurements.csv"));
}

#[test]
fn run_and_check_take_the_folder_as_it_is() {
    let place = Workplace::new();
    with_carto(&place);
    ok(&place, "import study --out la");
    place.file("lat.rs", include_str!("../models/lat.rs"));
    place.file("voltage.rs", include_str!("../models/voltage.rs"));
    let inputs = "--mesh la/surface.vtp --units mm --data la/measurements.csv";
    let said = ok(&place, &format!("check lat.rs {inputs}"));
    assert!(said.contains("observe lat: 8 measurements"), "{said}");
    let run = place
        .eplat(&format!("run voltage.rs {inputs} --warmup 200 --draws 100 --chains 2 --out out"));
    let left_out = "left out rows that the model does not observe: 10 of `unipolar`, 8 of `lat`";
    assert!(text(&run.stderr).contains(left_out), "{}", transcript(&run));
    assert!(place.path("out/summary.csv").exists(), "{}", transcript(&run));
}

#[test]
fn the_table_saved_by_a_spreadsheet_is_the_same() {
    let place = Workplace::new();
    with_carto(&place);
    ok(&place, "import study --out la");
    place.file("lat.rs", include_str!("../models/lat.rs"));
    let german = |cell: &str| cell.replace('.', ",");
    let saved: Vec<String> = place
        .read("la/measurements.csv")
        .lines()
        .map(|line| line.split(',').map(german).collect::<Vec<_>>().join(";") + ";;\r\n")
        .collect();
    place.file(
        "saved.csv",
        "\u{feff}".to_owned() + &saved.concat().replacen("value", "Value [ms]", 1),
    );
    let check = |table: &str| {
        let command = format!("check lat.rs --mesh la/surface.vtp --units mm --data {table}");
        let output = place.eplat(&command);
        assert_eq!(output.status.code(), Some(0), "{}", transcript(&output));
        let density = text(&output.stdout);
        let density = density.lines().find(|line| line.starts_with("log density")).unwrap();
        (density.split(';').next().unwrap().to_owned(), text(&output.stderr))
    };
    let (density, said) = check("saved.csv");
    assert_eq!(density, check("la/measurements.csv").0);
    assert!(said.contains("read with semicolons between cells and decimal commas"), "{said}");
}

#[test]
fn what_is_damaged_of_a_study_does_not_end_it() {
    let place = Workplace::new();
    with_carto(&place);
    place.file("study/1-LA_P1_Point_Export.xml", "<Point ID=\"1\"><Annot");
    place.file("study/2-Empty.mesh", "no mesh");
    std::fs::remove_file(place.path("study/1-LA_P2_Point_Export.xml")).unwrap();
    let said = ok(&place, "import study --out la");
    for expected in [
        "the own files of 1 points cannot be read (1-LA_P1_Point_Export.xml: no valid XML",
        "1 points have no file of their own",
        "(2-Empty.mesh, line 1: expected #TriangulatedMeshVersion2.0, got `no mesh`)",
        "10 measurements of bipolar",
        "6 measurements of lat",
    ] {
        assert!(said.contains(expected), "{expected}\n{said}");
    }
}

#[test]
fn one_of_several_maps_is_named() {
    let place = Workplace::new();
    let mesh = carto::mesh();
    place.file("two/A.mesh", &mesh).file("two/B.mesh", &mesh);
    insta::assert_snapshot!(transcript(&place.eplat("import two --out out")));
    let said = ok(&place, "import two --out out --map B");
    assert!(said.contains("no study file"), "{said}");
    assert!(said.contains("the map has no points with a value"), "{said}");
}

#[test]
fn values_on_the_mesh_are_taken_where_that_is_asked() {
    let place = Workplace::new();
    with_carto(&place);
    let said = ok(&place, "import study --out la --mesh-values --thin 15");
    assert!(said.contains("they are interpolated or simulated"), "{said}");
    assert!(said.contains("left out: vertices without a value (1)"), "{said}");
    let table = place.read("la/measurements.csv");
    let mut sites: Vec<&str> =
        table.lines().skip(1).map(|l| l.split(',').next().unwrap()).collect();
    sites.dedup();
    // every third vertex of ten, in both directions
    assert_eq!(sites.len(), 16, "{table}");
}

#[test]
fn what_cannot_be_imported_is_said_and_nothing_is_written() {
    let place = Workplace::new();
    with_carto(&place);
    place.file("notes/a.docx", "x").file("raw/a.dat", [0; 64]).file("raw/b.dat", [0; 64]);
    place.file("broken/1-LA.mesh", carto::mesh().replacen("   1 =  6.0", "   9 =  6.0", 1));
    place.file("there/a", "x");
    let said: Vec<String> = [
        "import nothing --out out",
        "import notes --out out",
        "import raw --out out",
        "import broken --out out",
        "import study/1-LA_P1_Point_Export.xml --out out",
        "import study --out out --map 3-RA",
        "import study --out out --map 2-Empty",
        "import study --out out --within 0",
        "import study --out out --units cm",
        "import study --out out --source 100",
        "import study --out there",
        "import study --out there --force",
    ]
    .iter()
    .map(|arguments| format!("$ eplat {arguments}\n{}", transcript(&place.eplat(arguments))))
    .collect();
    insta::assert_snapshot!(said.join("\n"));
    assert_eq!(place.read("there/a"), "x");
    ok(&place, "import study --out la");
    let refused = place.eplat("import study --out la");
    assert_eq!(refused.status.code(), Some(1));
    ok(&place, "import study --out la --force");
    // whoever was killed while it replaced an import, where folders cannot change places at once, left it aside
    let aside = place.path(".eplat-old-la");
    std::fs::rename(place.path("la"), &aside).unwrap();
    let refused = place.eplat("import study --out la");
    assert!(transcript(&refused).contains("la is already there"), "{}", transcript(&refused));
    assert!(!aside.exists() && place.path("la/import.json").exists());
    place.file("la/notes.txt", "mine");
    let said = transcript(&place.eplat("import study --out la --force"));
    assert!(said.contains("la/notes.txt is of no import, and would go with the folder"), "{said}");
    assert_eq!(place.read("la/notes.txt"), "mine");
}

#[test]
fn the_export_of_a_real_system_is_imported() {
    let Some(study) = shared("carto_export") else { return };
    let place = Workplace::new();
    let output = place.command("import").arg(&study).args(["--out", "la"]).output().unwrap();
    let said = transcript(&output).replace(&study.display().to_string(), "carto_export");
    insta::assert_snapshot!(said);
    assert!(Path::new(&place.path("la/surface.vtp")).exists());
}
