//! `eplat mesh …` as a user runs it: what it says, writes and exits with.

#![allow(clippy::unwrap_used, clippy::float_cmp, reason = "tests: values come back exactly")]

use eplat::mesh::{self, Units};
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

fn eplat(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_eplat"))
        .arg("mesh")
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Exit code, standard output and standard error as one text.
fn transcript(output: &Output) -> String {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    let code = output.status.code().unwrap();
    format!("exit {code}\n--- stdout\n{}--- stderr\n{}", text(&output.stdout), text(&output.stderr))
}

#[test]
fn atrium_info_and_convert_work_together() {
    let folder = TempDir::new().unwrap();
    let made = eplat(folder.path(), &["atrium", "--edge", "3", "--out", "la.vtk"]);
    assert_eq!(made.status.code(), Some(0), "{}", transcript(&made));
    let info = eplat(folder.path(), &["info", "la.vtk"]);
    let stdout = String::from_utf8(info.stdout).unwrap();
    assert!(stdout.contains("Euler characteristic  -3\n"), "{stdout}");
    assert!(stdout.contains("openings              5\n  1 "), "{stdout}");
    assert!(stdout.contains("point data            region\n"), "{stdout}");
    for (arguments, name) in [
        (["convert", "la.vtk", "b.vtk", "--units=mm"], "b.vtk"),
        (["convert", "la.vtk", "a.vtk", "--ascii"], "a.vtk"),
    ] {
        assert!(eplat(folder.path(), &arguments).status.success());
        let original = mesh::read(&folder.path().join("la.vtk"), Units::Mm).unwrap();
        let copy = mesh::read(&folder.path().join(name), Units::Mm).unwrap();
        assert_eq!((copy.mesh, copy.point_data), (original.mesh, original.point_data));
    }
}

/// Two squares with corners of their own, a double triangle, one without area and one turned over, in cm.
const BROKEN: &str = "# vtk DataFile Version 3.0\nbroken\nASCII\nDATASET POLYDATA\nPOINTS 8 double
0 0 0  4 0 0  4 5 0  0 5 0  4 0 0  8 0 0  8 5 0  4 5 0
POLYGONS 6 24\n3 0 1 2\n3 0 2 3\n3 4 5 6\n3 4 7 6\n3 2 0 1\n3 1 1 4
POINT_DATA 8\nSCALARS LAT double\nLOOKUP_TABLE default\n0 1 2 3 4 5 6 7\n";

#[test]
fn repair_says_what_it_did() {
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("broken.vtk"), BROKEN).unwrap();
    let mended = eplat(folder.path(), &["info", "broken.vtk"]);
    insta::assert_snapshot!("a_mesh_is_mended_as_it_is_read", transcript(&mended));
    let repaired = eplat(folder.path(), &["repair", "broken.vtk", "good.vtk", "--units", "cm"]);
    insta::assert_snapshot!(transcript(&repaired));
    let good = mesh::read(&folder.path().join("good.vtk"), Units::Mm).unwrap();
    assert_eq!((good.mesh.n_vertices(), good.mesh.n_triangles()), (6, 4));
    assert!((good.mesh.area() - 4000.0).abs() < 1e-9);
    assert_eq!(good.point_data["LAT"].values(), [0.0, 1.0, 2.0, 3.0, 5.0, 6.0]);
}

/// A table's vertices are those of the file as it is, also where it has to be mended: every number is
/// moved on by a duplicate of vertex 0 in front, some sites are named by a duplicate, and there is a
/// triangle without area.
#[test]
fn a_table_finds_its_places_on_a_mended_mesh() {
    let folder = TempDir::new().unwrap();
    assert!(eplat(folder.path(), &["atrium", "--edge", "3", "--out", "la.obj"]).status.success());
    let whole = std::fs::read_to_string(folder.path().join("la.obj")).unwrap();
    let points: Vec<&str> = whole.lines().filter(|line| line.starts_with("v ")).collect();
    let n = points.len();
    let mut text = [&points[..1], &points, &points[10..20]].concat().join("\n");
    for face in whole.lines().filter_map(|line| line.strip_prefix("f ")) {
        let corners: Vec<usize> = face.split(' ').map(|v| v.parse().unwrap()).collect();
        // Every other triangle names the duplicates of vertices 10 to 19.
        let moved = |v: &usize| {
            if (11..=20).contains(v) && corners[0].is_multiple_of(2) { v + n - 9 } else { v + 1 }
        };
        let corners: Vec<String> = corners.iter().map(|v| moved(v).to_string()).collect();
        let _ = write!(text, "\nf {}", corners.join(" "));
    }
    text += "\nf 5 6 5\n";
    std::fs::write(folder.path().join("bad.obj"), text).unwrap();
    let good = mesh::read(&folder.path().join("la.obj"), None).unwrap();
    let bad = mesh::read(&folder.path().join("bad.obj"), None).unwrap();
    assert_eq!((bad.mesh.n_vertices(), bad.n_source_vertices), (n, n + 11));
    let place = |surface: &mesh::Surface, v: usize| {
        surface.mesh.vertices()[surface.vertex_of_source(v).unwrap() as usize]
    };
    for v in 0..n {
        assert!(place(&good, v) == place(&bad, v + 1), "vertex {v}");
    }
    for v in 0..10 {
        assert!(place(&good, 10 + v) == place(&bad, n + 1 + v), "duplicate of {v}");
    }
    let rows = (1..=n).step_by(97).map(|v| format!("{v},S1S2,200,210\n{v},S1S2S3,180,190\n"));
    let table = format!("vertex,protocol,lower,upper\n{}", rows.collect::<String>());
    std::fs::write(folder.path().join("sites.csv"), table).unwrap();
    std::fs::write(folder.path().join("erp.rs"), include_str!("../models/erp.rs")).unwrap();
    let check = Command::new(env!("CARGO_BIN_EXE_eplat"))
        .args(["check", "erp.rs", "--mesh", "bad.obj", "--data", "sites.csv"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8(check.stderr).unwrap();
    assert_eq!(check.status.code(), Some(0), "{said}");
    assert!(said.contains("       mended: joined 1"), "{said}");
    assert!(said.contains(" duplicate points, dropped 1 triangle without area\n"), "{said}");
}

#[test]
fn bad_arguments_and_files_are_refused_and_nothing_is_written() {
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("broken.vtk"), BROKEN).unwrap();
    let texts: Vec<String> = [
        ["info", "missing.vtk", "--units", "mm"],
        ["info", "broken.vtk", "--units", "inch"],
        ["info", "broken.vtk", "--piece", "3"],
        ["convert", "broken.vtk", "out.gts", "--ascii"],
        ["convert", "moebius.vtk", "no.pts", "--units=mm"],
        ["repair", "broken.vtk", "out.vtp", "--tolerance=-1"],
        ["atrium", "--edge=0.01", "--out", "out.vtp"],
        ["atrium", "--edge=3", "--out", "no/folder/out.vtp"],
    ]
    .iter()
    .map(|arguments| {
        format!(
            "$ eplat mesh {}\n{}",
            arguments.join(" "),
            transcript(&eplat(folder.path(), arguments))
        )
    })
    .collect();
    insta::assert_snapshot!(texts.join("\n"));
    // The pieces among which there is no third are shown.
    assert!(folder.path().join("broken_faults.vtp").exists());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}
