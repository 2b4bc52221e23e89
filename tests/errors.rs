//! Bad input, as a user meets it: every text fits one screen, names the place and the remedy, and
//! leaves nothing behind.
//!
//! The texts are snapshots; after a change read them as a newcomer would, then `cargo insta review`
//! (or `INSTA_UPDATE=always cargo test --release --test errors`).

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/program.rs"]
mod program;
#[path = "support/shipped.rs"]
mod shipped;
mod support;

use std::fmt::Write as _;

use eplat::model::Model;
use program::{Workplace, text};
use shipped::shipped;

/// A flat sheet of 7 × 7 vertices 10 mm apart, and a small piece of three vertices (49, 50, 51) aside.
fn sheet() -> String {
    let n = 7;
    let mut points = String::new();
    for i in 0..n * n {
        let _ = writeln!(points, "{} {} 0", 10 * (i % n), 10 * (i / n));
    }
    points += "200 0 0\n210 0 0\n200 10 0\n";
    let mut triangles = vec![];
    for j in 0..n - 1 {
        for i in 0..n - 1 {
            let v = j * n + i;
            triangles.extend([[v, v + 1, v + n], [v + 1, v + n + 1, v + n]]);
        }
    }
    triangles.push([49, 50, 51]);
    vtk(&points, &triangles)
}

/// An ASCII legacy VTK file.
fn vtk(points: &str, triangles: &[[usize; 3]]) -> String {
    let mut file = format!(
        "# vtk DataFile Version 3.0\nsurface\nASCII\nDATASET POLYDATA\nPOINTS {} double\n{points}POLYGONS {} {}\n",
        points.lines().count(),
        triangles.len(),
        4 * triangles.len()
    );
    for [a, b, c] in triangles {
        let _ = writeln!(file, "3 {a} {b} {c}");
    }
    file
}

/// Runs each command, and gives what it says. Each must fail with 1 or 2 and say `help:` or, where the
/// command line itself makes no sense, how to see its usage; stdout stays empty, and no file appears.
fn transcript(place: &Workplace, commands: &[&str]) -> String {
    let mut all = vec![];
    for arguments in commands {
        let before = place.names();
        let output = place.eplat(arguments);
        let (code, stderr) = (output.status.code(), text(&output.stderr));
        assert!(matches!(code, Some(1 | 2)), "{arguments}: {code:?}\n{stderr}");
        let error = &stderr[stderr.rfind("error: ").unwrap()..];
        assert!(error.contains("\nhelp: ") || error.contains("'--help'"), "{arguments}: {stderr}");
        assert!(stderr.lines().count() <= 24, "{arguments}: more than a screen\n{stderr}");
        assert!(!stderr.contains("panicked"), "{arguments}: {stderr}");
        assert!(output.stdout.is_empty(), "{arguments}: {}", text(&output.stdout));
        let mut after = place.names();
        // The one file that an error leaves, and names, is the picture of where a mesh is at fault.
        after.retain(|name| {
            let is_picture = name.ends_with("_faults.vtp") && stderr.contains(name.as_str());
            is_picture.then(|| std::fs::remove_file(place.path(name)).unwrap());
            !is_picture
        });
        assert_eq!(after, before, "{arguments} leaves files behind");
        all.push(format!("$ eplat {arguments}\nexit {}\n{stderr}", code.unwrap()));
    }
    all.join("\n")
}

const SHEET: &str = "run erp.rs --mesh sheet.vtk --units mm";

/// A workplace with the model file and the sheet.
fn workplace() -> Workplace {
    let place = Workplace::new().with_erp();
    place.file("sheet.vtk", sheet());
    place
}

#[test]
fn files_that_are_not_there_or_not_what_they_should_be() {
    let place = workplace();
    place.file("model.txt", "").file("la.gts", "").file("empty.rs", "");
    insta::assert_snapshot!(transcript(
        &place,
        &[
            "run missing.rs",
            "run model.txt",
            "run empty.rs",
            "run erp.rs --mesh missing.vtk --units mm",
            "run erp.rs --mesh la.gts",
            "run erp.rs --mesh embedded --data missing.csv",
            "run erp.rs --basis missing.npz",
        ]
    ));
}

#[test]
fn command_lines_that_make_no_sense() {
    let place = workplace();
    insta::assert_snapshot!(transcript(
        &place,
        &[
            "run erp.rs --units mm",
            "run erp.rs --mesh sheet.vtk --units inch",
            "run erp.rs --mesh embedded --units mm",
            "run erp.rs --data sites.csv",
            "run erp.rs --exceed erp_s4>250",
            "run erp.rs --chains 0",
            "run erp.rs --draws 0",
            "run erp.rs --warmup 0",
            "run erp.rs --target-accept 1.5",
            "run erp.rs --chains many",
            "run erp.rs --chain 4",
            "run erp.rs --metric full",
            "run erp.rs --sampler blocked --metric low-rank",
            "run",
            "rum erp.rs",
        ]
    ));
}

#[test]
fn meshes_that_are_no_surface() {
    let place = Workplace::new().with_erp();
    let corners = "0 0 0\n10 0 0\n0 10 0\n10 10 0\n0 0 10\n";
    place
        .file("truncated.vtk", &sheet()[..600])
        .file("nan.vtk", vtk(&corners.replace("10 10 0", "10 nan 0"), &[[0, 1, 2], [1, 3, 2]]))
        .file("index.vtk", vtk(corners, &[[0, 1, 2], [1, 3, 5]]))
        .file("branching.vtk", vtk(corners, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]]))
        .file("tiny.vtk", vtk(corners, &[[0, 1, 2], [1, 3, 2]]))
        .file(
            "two.vtk",
            vtk(&format!("{corners}90 0 0\n99 0 0\n90 9 0\n"), &[[0, 1, 2], [5, 6, 7]]),
        )
        .file("not.vtk", "hello");
    insta::assert_snapshot!(transcript(
        &place,
        &[
            "run erp.rs --mesh truncated.vtk --units mm",
            "run erp.rs --mesh nan.vtk --units mm",
            "run erp.rs --mesh index.vtk --units mm",
            "run erp.rs --mesh branching.vtk --units mm",
            "run erp.rs --mesh tiny.vtk --units cm",
            "run erp.rs --mesh tiny.vtk",
            "run erp.rs --mesh two.vtk --units mm",
            "run erp.rs --mesh two.vtk --units mm --piece 3",
            "run erp.rs --mesh not.vtk --units mm",
        ]
    ));
}

#[test]
fn a_basis_of_another_mesh() {
    let place = workplace();
    let made = place.eplat("mesh atrium --edge 3 --out la.vtk");
    assert!(made.status.success());
    assert!(place.eplat("mesh basis la.vtk --modes 24 --out la.npz").status.success());
    assert!(
        place.eplat("mesh basis sheet.vtk --units mm --modes 8 --out few.npz").status.success()
    );
    place.file("broken.npz", "PK").file("sites.csv", "vertex,protocol,lower,upper\n0,s1s2,1,2\n");
    insta::assert_snapshot!(transcript(
        &place,
        &[
            &format!("{SHEET} --data sites.csv --basis la.npz"),
            &format!("{SHEET} --data sites.csv --basis few.npz"),
            &format!("{SHEET} --data sites.csv --basis broken.npz"),
        ]
    ));
}

/// Tables, each with the mistake it is named after.
const TABLES: &[(&str, &str)] = &[
    ("empty", ""),
    ("header_only", "site,vertex,protocol,lower,upper\n"),
    ("no_lower", "vertex,protocol,upper\n3,S1S2,210\n3,S1S2S3,190\n"),
    ("near_miss", "vertex,protocol,lowr,upper\n3,S1S2,200,210\n3,S1S2S3,180,190\n"),
    ("no_place", "protocol,lower,upper\nS1S2,200,210\nS1S2S3,180,190\n"),
    ("ragged", "vertex,protocol,lower,upper\n3,S1S2,200\n"),
    ("turned", "vertex,protocol,lower,upper\n3,S1S2,200,210\n3,S1S2S3,190,180\n"),
    ("not_a_number", "vertex,protocol,lower,upper\n3,S1S2,\"200,5\",210\n3,S1S2S3,180,190\n"),
    ("out_of_range", "vertex,protocol,lower,upper\n3,S1S2,200,210\n52,S1S2S3,180,190\n"),
    ("dropped_piece", "vertex,protocol,lower,upper\n3,S1S2,200,210\n50,S1S2S3,180,190\n"),
    ("far_away", "x,y,z,protocol,lower,upper\n3,3,0,S1S2,200,210\n30,30,90,S1S2S3,180,190\n"),
    ("unknown_protocol", "vertex,protocol,lower,upper\n3,S1S2,200,210\n3,S1S3,180,190\n"),
    ("open", "vertex,protocol,lower,upper\n3,S1S2,200,210\n3,S1S2S3,180,\n"),
    ("one_protocol", "vertex,protocol,lower,upper\n3,S1S2,200,210\n"),
];

#[test]
fn tables_with_a_mistake() {
    let place = workplace();
    let mut commands = vec![];
    for (name, table) in TABLES {
        place.file(&format!("{name}.csv"), table);
        commands.push(format!("{SHEET} --data {name}.csv --out out_{name}"));
    }
    let commands: Vec<&str> = commands.iter().map(String::as_str).collect();
    let said = transcript(&place, &commands);
    insta::with_settings!({filters => vec![(r"read as .*\n", "read as …\n")]}, {
        insta::assert_snapshot!(said);
    });
}

#[test]
fn a_column_that_the_model_reads_and_the_table_lacks() {
    let text = |header: &str, row: &str| {
        let table = support::table(header, &[row.into()]);
        Model::new(shipped("eight_schools"), None, &table).unwrap_err().to_string()
    };
    let texts = [text("school,effect_size,std_err", "A,28,15"), text("school,value,See", "A,1,2")];
    insta::assert_snapshot!(texts.join("\n\n"));
}

/// Metres and centimetres instead of millimetres: the warning names the likely unit, and sites given
/// by x, y, z in the file's unit still land on the surface.
#[test]
fn a_wrong_unit_is_doubted_aloud() {
    let place = Workplace::new().with_erp();
    assert!(place.eplat("mesh atrium --edge 3 --out la.vtk").status.success());
    let sites = text(&place.eplat("mesh sites la.vtk --n 4").stdout);
    let mut table = "x,y,z,protocol,lower,upper\n".to_string();
    for site in sites.lines().skip(1) {
        let xyz = site.splitn(3, ',').nth(2).unwrap();
        let _ = write!(table, "{xyz},S1S2,200,210\n{xyz},S1S2S3,180,190\n");
    }
    place.file("sites.csv", table);
    let mut said = vec![];
    for units in ["mm", "cm", "m", "um"] {
        let arguments = format!("check erp.rs --mesh la.vtk --units {units} --data sites.csv");
        let output = place.eplat(&arguments);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        said.push(format!("$ eplat {arguments}\n{}", text(&output.stderr)));
    }
    assert!(!said[0].contains("warning"), "{}", said[0]);
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn folders_that_cannot_be_written_to() {
    let place = workplace();
    place.file("file", "");
    insta::assert_snapshot!(transcript(
        &place,
        &["run erp.rs --out file", "run erp.rs --out file/below", "run erp.rs --out /proc/eplat"]
    ));
}
