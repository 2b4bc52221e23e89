//! Mesh files in every format: what is written comes back, real files read, damaged ones are errors.

#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::print_stdout,
    reason = "tests: values must come back exactly"
)]

#[path = "support/skipped.rs"]
mod skipped;

use eplat::mesh::{self, Array, Encoding, MeshError, Reading, Surface, TriMesh, Units};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// File names of all formats, with text where there is a choice.
const ALL: [(&str, Encoding); 11] = [
    ("m.vtp", Encoding::Binary),
    ("m.vtu", Encoding::Binary),
    ("m.vtk", Encoding::Binary),
    ("m.vtk", Encoding::Ascii),
    ("m.ply", Encoding::Binary),
    ("m.ply", Encoding::Ascii),
    ("m.npz", Encoding::Binary),
    ("m.obj", Encoding::Binary),
    ("m.stl", Encoding::Ascii),
    ("m.stl", Encoding::Binary),
    ("m.pts", Encoding::Binary),
];

/// What a format has a place for.
fn keeps_data(name: &str) -> bool {
    ![".obj", ".stl", ".pts"].iter().any(|ending| name.ends_with(ending))
}

fn octahedron() -> TriMesh {
    let vertices = [
        [0.0, 0.0, 40.5],
        [40.0, 0.0, 0.0],
        [0.0, 40.0, 0.0],
        [-40.0, 0.0, 0.0],
        [0.0, -40.0, 0.125],
        [0.0, 0.0, -40.0],
    ];
    let triangles =
        [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1], [5, 2, 1], [5, 3, 2], [5, 4, 3], [5, 1, 4]];
    TriMesh::new(vertices.to_vec(), triangles.to_vec()).unwrap()
}

/// A surface with scalars, vectors and tensors of points and of triangles.
fn sample() -> Surface {
    let numbers = |n: usize| (0..n).map(|i| i as f64 / 7.0 - 1.0).collect::<Vec<_>>();
    let mut surface = Surface::new(octahedron(), BTreeMap::new());
    surface.point_data.insert("LAT (ms) µ%".into(), Array::new(1, numbers(6)));
    surface.point_data.insert("x".into(), Array::new(1, numbers(6)));
    surface.point_data.insert("velocity".into(), Array::new(3, numbers(18)));
    surface.cell_data.insert("region".into(), Array::new(1, (0..8).map(f64::from).collect()));
    surface.cell_data.insert("fibre".into(), Array::new(3, numbers(24)));
    surface.cell_data.insert("tensor".into(), Array::new(9, numbers(72)));
    surface
}

fn written(surface: &Surface, folder: &Path, name: &str, encoding: Encoding) -> PathBuf {
    let path = folder.join(name);
    surface.write(&path, encoding).unwrap();
    path
}

#[test]
fn every_format_brings_mesh_and_data_back() {
    let folder = TempDir::new().unwrap();
    let surface = sample();
    for (name, encoding) in ALL {
        let path = written(&surface, folder.path(), name, encoding);
        let again = mesh::read(&path, None).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(again.mesh.triangles(), surface.mesh.triangles(), "{name}");
        for (a, b) in again.mesh.vertices().iter().zip(surface.mesh.vertices()) {
            (0..3).for_each(|k| assert!((a[k] - b[k]).abs() < 1e-12, "{name} {a:?} {b:?}"));
        }
        let units = if name == "m.pts" { Units::Um } else { Units::Mm };
        assert_eq!(again.units, units, "{name} tells its unit");
        if keeps_data(name) {
            assert_eq!(again.mesh.vertices(), surface.mesh.vertices(), "{name}");
            assert_eq!(again.point_data, surface.point_data, "{name}");
            let mut cell_data = surface.cell_data.clone();
            if name == "m.ply" {
                // its numbers have no width: only vectors are put together again
                let tensor = cell_data.remove("tensor").unwrap();
                for k in 0..9 {
                    let column = (0..8).map(|row| tensor.row(row)[k]).collect();
                    cell_data.insert(format!("tensor_{k}"), Array::new(1, column));
                }
            }
            assert_eq!(again.cell_data, cell_data, "{name}");
        }
    }
    let carp = mesh::read(&folder.path().join("m"), None).unwrap();
    assert_eq!(carp.cell_data["region"], surface.cell_data["region"]);
    assert_eq!(carp.cell_data["fibre"], surface.cell_data["fibre"]);
    let left_out = surface.write(&folder.path().join("m.pts"), Encoding::Binary).unwrap();
    assert_eq!(left_out, ["LAT (ms) µ%", "velocity", "x", "tensor"]);
    let left_out = surface.write(&folder.path().join("m.stl"), Encoding::Binary).unwrap();
    assert_eq!(left_out.len(), 6);
}

/// Bytes of the sample in each format; openCARP's three files one behind the other, with their ends.
fn files(folder: &Path, name: &str, encoding: Encoding) -> Vec<(PathBuf, Vec<u8>)> {
    let path = written(&sample(), folder, name, encoding);
    mesh::files(&path).into_iter().map(|file| (file.clone(), fs::read(file).unwrap())).collect()
}

/// A damaged file gives a surface or an error with help, and no panic.
fn survives(path: &Path) -> Result<(), TestCaseError> {
    if let Err(error) = mesh::read(path, Units::Mm) {
        let text = error.to_string();
        prop_assert!(text.contains("\nhelp: "), "{}", text);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn a_damaged_file_is_an_error_or_a_surface_and_never_a_panic(
        format in 0..ALL.len(),
        which in any::<prop::sample::Index>(),
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        length in prop::option::of(any::<prop::sample::Index>()),
        digit in prop::option::of((any::<prop::sample::Index>(), b'-'..=b'9')),
    ) {
        let folder = TempDir::new().unwrap();
        let (name, encoding) = ALL[format];
        let files = files(folder.path(), name, encoding);
        let (path, mut bytes) = files[which.index(files.len())].clone();
        for (at, byte) in damage {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        // Another digit somewhere makes counts, offsets and numbers of vertices wrong.
        if let Some((at, byte)) = digit {
            let digits: Vec<usize> = (0..bytes.len()).filter(|i| bytes[*i].is_ascii_digit()).collect();
            if !digits.is_empty() {
                bytes[digits[at.index(digits.len())]] = byte;
            }
        }
        if let Some(length) = length {
            let length = length.index(bytes.len());
            bytes.truncate(length);
        }
        fs::write(&path, bytes).unwrap();
        survives(&folder.path().join(name))?;
    }
}

#[test]
fn counts_that_a_file_cannot_hold_are_refused_at_once() {
    let folder = TempDir::new().unwrap();
    let huge = "18446744073709551615";
    let header = "<VTKFile type=\"PolyData\" header_type=\"UInt64\"><PolyData><Piece NumberOfPoints=\"9\"><Points>\
                  <DataArray type=\"Float64\" format=\"appended\" offset=\"0\"/></Points></Piece></PolyData>\
                  <AppendedData encoding=\"raw\">_\u{7f}\u{7f}\u{7f}\u{7f}\u{7f}\u{7f}\u{7f}\u{7f}abc</AppendedData></VTKFile>";
    for (name, text) in [
        (
            "a.ply",
            format!(
                "ply\nformat ascii 1.0\nelement vertex {huge}\nproperty float x\nend_header\n1\n"
            ),
        ),
        ("b.ply", format!("ply\nformat ascii 1.0\nelement vertex {huge}\nend_header\n")),
        ("a.pts", format!("{huge}\n1 2 3\n")),
        (
            "a.vtk",
            format!(
                "# vtk DataFile Version 3.0\n\nBINARY\nDATASET POLYDATA\nPOINTS {huge} double\n"
            ),
        ),
        ("a.vtp", header.to_owned()),
        ("a.stl", "x".repeat(84)),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        let error = mesh::read(&path, Units::Mm).unwrap_err().to_string();
        println!("{error}");
        assert!(error.contains("\nhelp: "), "{name}: {error}");
    }
}

fn shared(file: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let path = std::env::var_os("EPLAT_SHARED").map_or_else(beside, PathBuf::from).join("data");
    let path = path.join(file);
    if path.exists() {
        return Some(path);
    }
    skipped::skipped(&format!("reference data not found ({file})"));
    None
}

/// Real surfaces in every format: the same surface, and the same data where the format holds them.
#[test]
fn real_surfaces_come_back_from_every_format() {
    let sources =
        ["openep_la/la_lat.vtk", "fibernet/LA_model.vtk", "opencarp_atrium/la_endo_1.pts"];
    for source in sources {
        let Some(path) = shared(source) else { return };
        let surface = mesh::read(&path, None).unwrap();
        for note in &surface.notes {
            println!("{source}: {note}");
        }
        let folder = TempDir::new().unwrap();
        for (name, encoding) in ALL {
            let copy = written(&surface, folder.path(), name, encoding);
            let again = mesh::read(&copy, None).unwrap_or_else(|e| panic!("{source} {name}: {e}"));
            let is_single = (name, encoding) == ("m.stl", Encoding::Binary);
            let (a, b) = (again.mesh.area(), surface.mesh.area());
            assert!(
                (a / b - 1.0).abs() < if is_single { 1e-5 } else { 1e-12 },
                "{source} {name}: {a} {b}"
            );
            // STL numbers vertices by triangle; a surface of single precision has its own flat triangles.
            if !is_single {
                assert_eq!(again.mesh.n_vertices(), surface.mesh.n_vertices(), "{source} {name}");
                assert_eq!(again.mesh.n_triangles(), surface.mesh.n_triangles(), "{source} {name}");
            }
            if keeps_data(name) {
                assert_eq!(again.mesh, surface.mesh, "{source} {name}");
                same(&again, &surface, &format!("{source} {name}"));
            }
        }
    }
}

/// The columns are equal bit for bit, or both NaN.
fn same(a: &Surface, b: &Surface, what: &str) {
    let (a_names, b_names) = (a.names(), b.names());
    assert_eq!(a_names, b_names, "{what}");
    for (x, y) in [(&a.point_data, &b.point_data), (&a.cell_data, &b.cell_data)] {
        let values = |data: &mesh::Data| -> Vec<f64> {
            // Tensors that PLY takes apart have their columns elsewhere: compare what is whole.
            data.values()
                .filter(|array| array.width() < 9)
                .flat_map(|array| array.values().to_vec())
                .collect()
        };
        let parts = |data: &mesh::Data| data.keys().any(|name| name.ends_with("_8"));
        if !parts(x) {
            let (x, y) = (values(x), values(y));
            assert_eq!(x.len(), y.len(), "{what}");
            let equal =
                |(a, b): (&f64, &f64)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
            assert!(x.iter().zip(&y).all(equal), "{what}");
        }
    }
}

#[test]
fn the_opencarp_atrium_reads_with_its_fibres() {
    let Some(path) = shared("opencarp_atrium/la_endo_1.elem") else { return };
    let surface = mesh::read(&path, None).unwrap();
    assert_eq!(surface.units, Units::Um);
    assert_eq!(surface.n_source_vertices, 60_100);
    let base = mesh::read(&path.with_extension(""), None).unwrap();
    assert_eq!(base.mesh, surface.mesh);
    assert!(surface.cell_data["region"].values().contains(&11.0));
    // The first fibre of the file belongs to the first element.
    assert_eq!(surface.cell_data["fibre"].row(0), [-0.82267, 0.48917, 0.2897]);
    let fibres = surface.fibres("fibre").unwrap();
    let n_unit =
        fibres.iter().filter(|f| (f.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-9).count();
    println!("{n_unit} of {} vertices have a fibre of length 1", fibres.len());
    assert!(n_unit as f64 > 0.999 * fibres.len() as f64);
}

#[test]
fn fibres_of_the_simulated_atrium_agree_between_points_and_triangles() {
    let Some(path) = shared("fibernet/LA_model.vtk") else { return };
    let surface = mesh::read(&path, None).unwrap();
    assert_eq!((surface.units, surface.n_source_vertices), (Units::Mm, 8843));
    assert_eq!(surface.cell_data["diff_tensors"].width(), 9);
    // `l` of points are fibres by the file's authors, `l_cell` the same of triangles.
    let (of_points, of_cells) = (surface.fibres("l").unwrap(), surface.fibres("l_cell").unwrap());
    let along = |(a, b): (&[f64; 3], &[f64; 3])| (0..3).map(|k| a[k] * b[k]).sum::<f64>().abs();
    let n_near = of_points.iter().zip(&of_cells).filter(|pair| along(*pair) > 0.95).count();
    println!("{n_near} of {} agree within 18 degrees", of_points.len());
    assert!(n_near as f64 > 0.9 * of_points.len() as f64, "{n_near}");
}

#[test]
fn the_unit_is_guessed_and_said() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("m.obj");
    let written = |scale: f64| {
        let mut text = String::new();
        for [x, y, z] in octahedron().vertices() {
            let _ = writeln!(text, "v {} {} {}", x * scale, y * scale, z * scale);
        }
        for [a, b, c] in octahedron().triangles() {
            let _ = writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1);
        }
        fs::write(&path, text).unwrap();
    };
    for (scale, units) in [(1.0, Units::Mm), (0.1, Units::Cm), (1e-3, Units::M), (1e3, Units::Um)] {
        written(scale);
        let surface = mesh::read(&path, None).unwrap();
        assert_eq!(surface.units, units);
        assert!((surface.mesh.area() - octahedron().area()).abs() < 1e-6);
        let note = &surface.notes[0];
        assert!(
            note.starts_with(&format!(
                "read as {units}, guessed from its size (another: --units): "
            )),
            "{note}"
        );
    }
    written(0.25);
    let error = mesh::read(&path, None).unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, MeshError::Invalid { .. }) && text.contains("20.125 across"), "{text}");
    assert!(text.ends_with("help: add --units mm, cm, um or m"), "{text}");
    assert!(mesh::read(&path, Units::Mm).is_ok());
}

/// Two octahedra of equal size, the second further on.
fn two_atria(path: &Path) {
    let mut text = String::new();
    for shift in [0.0, 100.0] {
        for [x, y, z] in octahedron().vertices() {
            let _ = writeln!(text, "v {} {y} {z}", x + shift);
        }
    }
    for from in [1, 7] {
        for [a, b, c] in octahedron().triangles() {
            let _ = writeln!(text, "f {} {} {}", a + from, b + from, c + from);
        }
    }
    fs::write(path, text).unwrap();
}

#[test]
fn two_pieces_need_a_choice_and_are_shown() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("two.obj");
    two_atria(&path);
    let picture = folder.path().join("two_faults.vtp");
    let reading = Reading { faults: Some(picture.clone()), ..Reading::default() };
    let text = mesh::read(&path, reading.clone()).unwrap_err().to_string();
    let text = text.replace(folder.path().to_str().unwrap(), "");
    insta::assert_snapshot!(text, @r"
    /two.obj: there are several surfaces, and none is much the largest:
      1: 6 vertices, 111.3 cm², centred at (0.0, 0.0, 0.1)
      2: 6 vertices, 111.3 cm², centred at (100.0, 0.0, 0.1)
    help: choose one with --piece 1, --piece 2, …; or join them in a mesh editor
    help: /two_faults.vtp shows where, as point data `piece`
    ");
    let shown = mesh::read(&picture, Reading { piece: Some(2), ..Reading::default() }).unwrap();
    assert_eq!(shown.point_data["piece"].values(), [2.0; 6]);
    let second = mesh::read(&path, Reading { piece: Some(2), ..reading }).unwrap();
    assert_eq!(second.source_vertex, [6, 7, 8, 9, 10, 11]);
    assert_eq!((second.vertex_of_source(7), second.vertex_of_source(1)), (Some(1), None));
}

#[test]
fn vertex_numbers_of_the_file_mean_the_same_place_after_mending() {
    // The octahedron, each triangle with corners of its own, one triangle twice, one without area.
    let mesh = octahedron();
    let (mut points, mut faces) = (String::new(), String::new());
    for (t, corners) in mesh.triangles().iter().enumerate() {
        for v in corners {
            let [x, y, z] = mesh.vertices()[*v as usize];
            let _ = writeln!(points, "v {x} {y} {z}");
        }
        let _ = writeln!(faces, "f {} {} {}", 3 * t + 1, 3 * t + 2, 3 * t + 3);
    }
    points += "v 7 7 7\n";
    faces += "f 1 2 3\nf 1 4 5\n";
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("soup.obj");
    fs::write(&path, points + &faces).unwrap();
    let surface = mesh::read(&path, None).unwrap();
    assert_eq!((surface.mesh.n_vertices(), surface.mesh.n_triangles()), (6, 8));
    for (t, corners) in mesh.triangles().iter().enumerate() {
        for (k, v) in corners.iter().enumerate() {
            let here = surface.vertex_of_source(3 * t + k).unwrap();
            assert_eq!(surface.mesh.vertices()[here as usize], mesh.vertices()[*v as usize]);
        }
    }
    assert_eq!(surface.vertex_of_source(24), None, "no triangle had it");
    insta::assert_snapshot!(surface.notes.join("\n"), @r"
    mended: joined 18 duplicate points, dropped 1 triangle without area, dropped 1 double triangle, left out 1 unused point
    read as mm, guessed from its size (another: --units): 80.0 × 80.0 × 80.5 mm, area 111 cm²
    ");
}
