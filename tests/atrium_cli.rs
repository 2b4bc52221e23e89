//! `eplat simulate atrium` as a user runs it, on a small sheet.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use eplat::mesh::{self, TriMesh, Units, write_vtp};

fn eplat(folder: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_eplat"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// A sheet of 12 × 9 mm with 1 mm edges; APD_max rises along it.
fn sheet(path: &Path) {
    let node = |i: u32, j: u32| 10 * i + j;
    let vertices: Vec<[f64; 3]> =
        (0..130).map(|v| [f64::from(v / 10), f64::from(v % 10), 0.0]).collect();
    let square = |(i, j): (u32, u32)| {
        let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    let squares = (0..12).flat_map(|i| (0..9).map(move |j| (i, j)));
    let mesh = TriMesh::new(vertices, squares.flat_map(square).collect()).unwrap();
    let apd_max: Vec<f64> = mesh.vertices().iter().map(|p| 150.0 + 5.0 * p[0]).collect();
    write_vtp(path, &mesh, &[("tau_out_mean", &[8.0; 130]), ("apd_max_mean", &apd_max)]).unwrap();
}

#[test]
fn a_sheet_is_paced_and_its_maps_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    sheet(&at.join("fields.vtp"));
    let arguments = "simulate atrium --fields fields.vtp --refine 2 --pace 0 --radius 1.5 --beats 2 --s1 320 \
                     --last 320 --snapshots 40 --out beat";
    let output = eplat(at, arguments);
    assert!(output.status.success(), "{}", said(&output));
    assert!(
        said(&output).contains("beat 2 of 2: 1813 of 1813 vertices activated"),
        "{}",
        said(&output)
    );
    let surface = mesh::read(&at.join("beat/beat.vtp"), Units::Mm).unwrap();
    let [lat, apd90] = ["lat", "apd90"].map(|name| &surface.point_data[name]);
    let of = |values: &[f64], x: f64| {
        let near =
            surface.mesh.vertices().iter().zip(values).filter(|(p, _)| (p[0] - x).abs() < 1e-9);
        let near: Vec<f64> = near.map(|(_, value)| *value).collect();
        near.iter().sum::<f64>() / near.len() as f64
    };
    assert!(of(lat, 2.0) < of(lat, 6.0) && of(lat, 6.0) < of(lat, 11.0));
    assert!(of(apd90, 2.0) + 10.0 < of(apd90, 11.0), "longer where APD_max is");
    // V at 0, 40 … 320 ms of the beat, and their list
    let series = fs::read_to_string(at.join("beat/voltage.pvd")).unwrap();
    assert_eq!(series.matches("<DataSet").count(), 9);
    assert_eq!(fs::read_dir(at.join("beat")).unwrap().count(), 9 + 3);
    let record: serde_json::Value =
        serde_json::from_slice(&fs::read(at.join("beat/simulation.json")).unwrap()).unwrap();
    assert_eq!(record["activated_vertices"], 1813);
}

#[test]
fn bad_input_is_named_and_nothing_is_left_behind() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    sheet(&at.join("fields.vtp"));
    let fails = |more: &str| {
        let output = eplat(at, &format!("simulate atrium --fields fields.vtp --out beat {more}"));
        assert_ne!(output.status.code(), Some(0), "{more}");
        assert!(!at.join("beat").exists());
        said(&output)
    };
    let cases = [
        ("--pace 130", "--pace 130 is no vertex of the surface, which has 130"),
        ("--pace 0 --apd-max apd", "it has: apd_max_mean, tau_out_mean"),
        (
            "--pace 0 --tau-out 50",
            "vertex 0: tau_out = 50 ms is outside its valid range 1 to 30 ms",
        ),
        ("--pace 0 --measure 9", "there is no beat 9 among 8"),
        ("--pace 0 --measure 0", "0 is not in 1.."),
        ("--pace 0 --beats 0", "0 is not in 1.."),
        ("--pace 0 --extra 0.1", "do not fit"),
        ("--pace 0 --dt 0", "time step"),
        ("--pace 0 --snapshots 0", "--snapshots"),
        ("--pace 0 --units furlong", "unknown unit"),
    ];
    for (more, expected) in cases {
        let said = fails(more);
        assert!(said.contains(expected), "{more}: {said}");
    }
}
