//! Mesh files: every dialect of legacy VTK reads the same, what is written comes back, and a bad
//! file is an error that names the place.

#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::print_stdout,
    reason = "tests: values must come back exactly"
)]

#[path = "support/skipped.rs"]
mod skipped;

use eplat::mesh::{self, Encoding, MeshError, Surface, TriMesh, Units};
use proptest::prelude::*;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const POINTS: [[f64; 3]; 6] = [
    [0.0, 0.0, 40.5],
    [40.0, 0.0, 0.0],
    [0.0, 40.0, 0.0],
    [-40.0, 0.0, 0.0],
    [0.0, -40.0, 0.125],
    [0.0, 0.0, -40.0],
];
const OCTAHEDRON: [[u32; 3]; 8] =
    [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1], [5, 2, 1], [5, 3, 2], [5, 4, 3], [5, 1, 4]];

/// Arrays for all dialects; the last has two components.
const LAT: [f64; 6] = [20.0, 31.5, f64::NAN, 80.25, 100.0, 175.0];

#[derive(Clone, Copy, Debug)]
struct Dialect {
    binary: bool,
    offsets: bool,
    grid: bool,
}

const DIALECTS: [Dialect; 8] = {
    let mut all = [Dialect { binary: false, offsets: false, grid: false }; 8];
    let mut i = 0;
    while i < 8 {
        all[i] = Dialect { binary: i & 1 > 0, offsets: i & 2 > 0, grid: i & 4 > 0 };
        i += 1;
    }
    all
};

/// Writes VTK as its authors do, independently of the library's writer.
struct File {
    bytes: Vec<u8>,
    binary: bool,
}

impl File {
    fn line(&mut self, text: &str) {
        self.bytes.extend(text.bytes());
        self.bytes.push(b'\n');
    }

    fn array<T: ToString>(
        &mut self,
        numbers: impl IntoIterator<Item = T>,
        bytes: fn(T) -> Vec<u8>,
    ) {
        if self.binary {
            numbers.into_iter().for_each(|x| self.bytes.extend(bytes(x)));
            self.line("");
        } else {
            // Nine to a line, as VTK does: rows mean nothing.
            let words: Vec<String> = numbers.into_iter().map(|x| x.to_string()).collect();
            words.chunks(9).for_each(|row| self.line(&format!("{} ", row.join(" "))));
        }
    }
}

fn file(dialect: Dialect) -> Vec<u8> {
    let Dialect { binary, offsets, grid } = dialect;
    let mut f = File { bytes: Vec::new(), binary };
    f.line(if offsets { "# vtk DataFile Version 5.1" } else { "# vtk DataFile Version 2.0" });
    f.line("");
    f.line(if binary { "BINARY" } else { "ASCII" });
    f.line(if grid { "DATASET UNSTRUCTURED_GRID" } else { "DATASET POLYDATA" });
    f.line("FIELD FieldData 2\nTIME 1 1 double");
    f.array([0.5], |x: f64| x.to_be_bytes().to_vec());
    f.line("who 1 2 string");
    if binary {
        f.bytes.extend([0xc0 | 3, b'a', b'%', b'b', 0xc0]);
        f.line("");
    } else {
        f.line("a%25b\n");
    }
    f.line("POINTS 6 float");
    f.array(POINTS.iter().flatten().map(|&x| x as f32), |x| x.to_be_bytes().to_vec());
    f.line("METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 1 \n");
    cells(&mut f, offsets, if grid { "CELLS" } else { "POLYGONS" });
    if grid {
        f.line("CELL_TYPES 8");
        f.array([5; 8], |x: i32| x.to_be_bytes().to_vec());
    }
    f.line("CELL_DATA 8\nSCALARS centre double 3\nLOOKUP_TABLE default");
    f.array((0..24).map(f64::from), |x| x.to_be_bytes().to_vec());
    f.line("POINT_DATA 6\nSCALARS LAT%20(ms) double\nLOOKUP_TABLE default");
    f.array(LAT, |x| x.to_be_bytes().to_vec());
    f.line("VECTORS fibre short");
    f.array(-9..9, |x: i16| x.to_be_bytes().to_vec());
    f.line("COLOR_SCALARS shade 1");
    f.array([1; 6], |x: u8| vec![x]);
    f.line("FIELD FieldData 3\nregion 1 6 unsigned_char");
    f.array([0, 1, 200, 3, 4, 255], |x: u8| vec![x]);
    f.line("METADATA\nCOMPONENT_NAMES\nx\n\nid 1 6 vtktypeint64");
    f.array((0..6).map(|i| i * 10_000_000_000 - 1), |x: i64| x.to_be_bytes().to_vec());
    f.line("mask 1 6 bit");
    if binary {
        f.bytes.extend([0b1010_1000, b'\n']);
    } else {
        f.line("1 0 1 0 1 0");
    }
    f.bytes
}

fn cells(f: &mut File, offsets: bool, keyword: &str) {
    if offsets {
        f.line(&format!("{keyword} 9 24\nOFFSETS vtktypeint64"));
        f.array((0..9).map(|i| 3 * i), |x: i64| x.to_be_bytes().to_vec());
        f.line("CONNECTIVITY vtktypeint64");
        f.array(OCTAHEDRON.into_iter().flatten().map(i64::from), |x| x.to_be_bytes().to_vec());
    } else {
        f.line(&format!("{keyword} 8 32"));
        let list = OCTAHEDRON.into_iter().flat_map(|[a, b, c]| [3, a, b, c]);
        f.array(list, |x| x.to_be_bytes().to_vec());
    }
}

fn read_bytes(bytes: &[u8]) -> Result<Surface, MeshError> {
    // One folder for each thread: the fuzzing tests read thousands of files.
    thread_local!(static FOLDER: TempDir = TempDir::new().unwrap());
    FOLDER.with(|folder| {
        let path = folder.path().join("mesh.vtk");
        std::fs::write(&path, bytes).unwrap();
        mesh::read(&path, Units::Mm)
    })
}

fn same(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

#[test]
fn all_dialects_read_the_same() {
    for dialect in DIALECTS {
        let surface = read_bytes(&file(dialect)).unwrap_or_else(|e| panic!("{dialect:?}: {e}"));
        assert_eq!(surface.mesh.triangles(), OCTAHEDRON, "{dialect:?}");
        let rounded = POINTS.map(|p| p.map(|x| f64::from(x as f32)));
        assert_eq!(surface.mesh.vertices(), rounded, "{dialect:?}");
        let data = surface.scalars();
        assert!(same(&data["LAT (ms)"], &LAT), "{dialect:?}");
        assert_eq!(data["region"], [0.0, 1.0, 200.0, 3.0, 4.0, 255.0]);
        assert_eq!(data["id"][2], 19_999_999_999.0);
        assert_eq!(data["fibre_1"], [-8.0, -5.0, -2.0, 1.0, 4.0, 7.0]);
        assert!(!data.contains_key("centre_0"), "cell data are no point data");
        assert_eq!(surface.cell_data["centre"].row(7), [21.0, 22.0, 23.0], "{dialect:?}");
        assert_eq!(surface.point_data["fibre"].width(), 3);
    }
}

#[test]
fn a_file_cut_short_anywhere_is_an_error_and_never_a_panic() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("mesh.vtk");
    for dialect in DIALECTS {
        let whole = file(dialect);
        std::fs::write(&path, &whole).unwrap();
        let shrinking = std::fs::File::options().write(true).open(&path).unwrap();
        for length in (0..whole.len()).rev() {
            shrinking.set_len(length as u64).unwrap();
            match mesh::read(&path, Units::Mm) {
                // Attributes are optional: a file may end before them, or between two of them.
                Ok(surface) => {
                    assert!(length + 2 >= find(&whole, "CELL_DATA"), "{dialect:?} at {length}");
                    assert_eq!(surface.mesh.triangles(), OCTAHEDRON, "{dialect:?} at {length}");
                    assert!(length >= find(&whole, "POINT_DATA") || surface.point_data.is_empty());
                }
                Err(error) => assert!(error.to_string().contains("\nhelp: "), "{error}"),
            }
        }
    }
}

fn find(bytes: &[u8], word: &str) -> usize {
    bytes.windows(word.len()).position(|w| w == word.as_bytes()).unwrap()
}

proptest! {
    #[test]
    fn a_damaged_file_is_an_error_or_a_surface_and_never_a_panic(
        dialect in 0..8_usize,
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = file(DIALECTS[dialect]);
        for (at, byte) in damage {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Err(error) = read_bytes(&bytes) {
            prop_assert!(error.to_string().contains("\nhelp: "), "{}", error);
        }
    }

    #[test]
    fn what_is_written_comes_back_bit_for_bit(
        coordinates in prop::array::uniform12(-1e6_f64..1e6),
        values in prop::array::uniform4(any::<f64>()),
        name in "[ -~µ]{1,12}",
        binary in any::<bool>(),
    ) {
        let (points, _) = coordinates.as_chunks::<3>();
        let mesh = TriMesh::new(points.to_vec(), vec![[0, 1, 2], [2, 1, 3]]).unwrap();
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("mesh.vtk");
        let encoding = if binary { Encoding::Binary } else { Encoding::Ascii };
        mesh::write_vtk(&path, &mesh, &[(&name, &values)], encoding).unwrap();
        let surface = mesh::read(&path, Units::Mm).unwrap();
        prop_assert_eq!(&surface.mesh, &mesh);
        // Text knows only one NaN.
        let equal = |a: f64, b: f64| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
        prop_assert!(surface.point_data[&name].values().iter().zip(values).all(|(&a, b)| equal(a, b)));
    }
}

/// An ASCII file with these points and cells.
fn text(points: &str, n_points: usize, cells: &str) -> Vec<u8> {
    let mut text = String::from("# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\n");
    let _ = write!(text, "POINTS {n_points} double\n{points}\n{cells}\n");
    text.into_bytes()
}

fn octahedron_text(cells: &str) -> Vec<u8> {
    let points: Vec<String> = POINTS.iter().map(|[x, y, z]| format!("{x} {y} {z}")).collect();
    text(&points.join("\n"), 6, cells)
}

/// The message without the folder's name.
fn message(bytes: &[u8]) -> String {
    plain(&read_bytes(bytes).unwrap_err())
}

fn plain(error: &MeshError) -> String {
    let text = error.to_string();
    let start = text.find(std::env::temp_dir().to_str().unwrap());
    match (start, text.find("mesh.")) {
        (Some(start), Some(name)) => format!("{}{}", &text[..start], &text[name..]),
        _ => text,
    }
}

#[test]
fn strips_become_triangles_that_run_alike() {
    let surface = read_bytes(&octahedron_text("TRIANGLE_STRIPS 1 6\n5 0 1 2 5 3")).unwrap();
    assert_eq!(surface.mesh.triangles(), [[0, 1, 2], [2, 1, 4], [2, 4, 3]]);
    assert_eq!(surface.source_vertex, [0, 1, 2, 3, 5]);
}

#[test]
fn polygons_pixels_and_strips_of_a_grid_are_split_and_keep_their_data() {
    let text = "# vtk DataFile Version 4.2\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 double\n\
        0 0 0 40 0 0 0 40 0 40 40 0 80 0 0 80 40 0 120 0 0 120 40 0\nCELLS 5 20\n2 0 1\n4 0 1 2 3\n\
        4 1 4 5 3\n4 5 4 7 6\n1 3\nCELL_TYPES 5\n3 8 9 6 1\nCELL_DATA 5\nSCALARS n int\n\
        LOOKUP_TABLE default\n7 8 9 10 11\n";
    let surface = read_bytes(text.as_bytes()).unwrap();
    let triangles = [[0, 1, 3], [0, 3, 2], [1, 4, 5], [1, 5, 3], [5, 4, 7], [7, 4, 6]];
    assert_eq!(surface.mesh.triangles(), triangles);
    assert_eq!(surface.cell_data["n"].values(), [8.0, 8.0, 9.0, 9.0, 10.0, 10.0]);
    let notes = ["2 polygons cut into triangles", "2 cells left out: points or lines"];
    assert_eq!(surface.notes[..2], notes);
}

#[test]
fn other_writers_habits_are_understood() {
    let text = "# vtk DataFile Version 4.2\r\n\r\nascii\r\ndataset polydata\r\npoints 3 DOUBLE\r\n\
        0 0 0 1e1\t0 0\r\n\r\n0 1E+1 0\r\nlines 1 3\r\n2 0 1\r\npolygons 1 4\r\n3 0 1 2\r\n\
        point_data 3\r\nscalars a float 1\r\n-nan(ind) inf -2.5e-3\r\nnormals n vtktypefloat\r\n";
    let error = read_bytes(text.as_bytes()).unwrap_err().to_string();
    assert!(
        error.contains("line 16: expected a VTK number type") && error.contains("vtktypefloat"),
        "{error}"
    );
    let good = text.replace("normals n vtktypefloat\r\n", "");
    let surface = read_bytes(good.as_bytes()).unwrap();
    assert_eq!(surface.mesh.vertices(), [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]]);
    let data = surface.point_data["a"].values();
    assert!(data[0].is_nan());
    assert_eq!(data[1..], [f64::INFINITY, -0.0025]);
}

#[test]
fn syntax_errors_name_line_or_byte() {
    let ascii = file(DIALECTS[0]);
    let binary = file(DIALECTS[3]);
    let changed = |bytes: &[u8], from: &str, to: &str| {
        let text = String::from_utf8_lossy(bytes).replacen(from, to, 1);
        message(text.as_bytes())
    };
    let texts = [
        message(b""),
        message(b"solid cube\n"),
        message(b"<?xml version=\"1.0\"?>\n<VTKFile>\n"),
        changed(&ascii, "POLYDATA", "STRUCTURED_GRID"),
        changed(&ascii, "POINTS 6 float", "POINTS six float"),
        changed(&ascii, "POINTS 6 float", "POINTS 6 complex"),
        changed(&ascii, "40.5", "4o.5"),
        changed(&ascii, "POLYGONS 8 32", "POLYGONS 9 32"),
        changed(&ascii, "POINT_DATA 6", "POINT_DATA 5"),
        changed(&ascii, "VECTORS", "VEKTORS"),
        message(&ascii[..find(&ascii, "POINTS") + 40]),
        message(&binary[..find(&binary, "POINTS") + 40]),
        message(&binary[..find(&binary, "CONNECTIVITY") + 5]),
    ];
    insta::assert_snapshot!(texts.join("\n\n"));
}

#[test]
fn a_file_that_is_no_surface_says_why() {
    let with_type = |kind: &str| {
        let types = format!("5 {kind} 5");
        let text = String::from_utf8_lossy(&file(DIALECTS[4])).replacen("5 5 5", &types, 1);
        message(text.as_bytes())
    };
    let texts = [
        message(&octahedron_text("POLYGONS 2 9\n3 0 1 2\n4 0 2 3 6")),
        message(&octahedron_text("POLYGONS 2 8\n3 0 1 2\n3 0 2 6")),
        message(&octahedron_text("POLYGONS 2 8\n3 0 1 2\n3 0 2 -1")),
        message(&octahedron_text("POLYGONS 2 8\n3 0 1 1\n3 2 2 3")),
        message(&octahedron_text("POLYGONS 3 12\n3 0 1 2\n3 0 2 3\n3 2 0 5")),
        message(&octahedron_text("POLYGONS 0 0")),
        message(&text("0 0 0 1 0 nan 1 1 0", 3, "POLYGONS 1 4\n3 0 1 2")),
        with_type("9"),
        with_type("10"),
    ];
    insta::assert_snapshot!(texts.join("\n\n"));
}

#[test]
fn wrong_names_and_folders_are_told() {
    let folder = TempDir::new().unwrap();
    let stl = folder.path().join("mesh.gts");
    std::fs::write(&stl, "").unwrap();
    let missing = folder.path().join("mesh.vtk");
    let mesh = TriMesh::new(POINTS.to_vec(), OCTAHEDRON.to_vec()).unwrap();
    let texts = [
        plain(&mesh::read(&stl, Units::Mm).unwrap_err()),
        plain(&mesh::read(&missing, Units::Mm).unwrap_err()),
        plain(&mesh::write_vtp(&folder.path().join("no/mesh.vtp"), &mesh, &[]).unwrap_err()),
        plain(&mesh::write_vtp(&missing, &mesh, &[("LAT", &[1.0])]).unwrap_err()),
    ];
    insta::assert_snapshot!(texts.join("\n\n"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing half-written");
}

/// The octahedron with a stray triangle and an unused vertex in front of it.
fn with_stray_piece() -> Vec<u8> {
    let points: Vec<String> = POINTS.iter().map(|[x, y, z]| format!("{x} {y} {z}")).collect();
    let points = format!("9 9 9 0 0 0 1 0 0 0 1 0 {}", points.join(" "));
    let mut cells = String::from("POLYGONS 9 36\n3 1 2 3\n");
    for [a, b, c] in OCTAHEDRON {
        let _ = writeln!(cells, "3 {} {} {}", a + 4, b + 4, c + 4);
    }
    text(&points, 10, &format!("{cells}POINT_DATA 10\nSCALARS n int\n0 1 2 3 4 5 6 7 8 9"))
}

#[test]
fn the_largest_piece_is_kept_and_the_rest_is_reported() {
    let surface = read_bytes(&with_stray_piece()).unwrap();
    assert_eq!(surface.mesh.triangles(), OCTAHEDRON);
    assert_eq!(surface.source_vertex, [4, 5, 6, 7, 8, 9]);
    assert_eq!((surface.n_source_vertices, surface.dropped.as_slice()), (10, [3].as_slice()));
    assert_eq!(surface.vertex_of_source(7), Some(3));
    assert_eq!((surface.vertex_of_source(3), surface.vertex_of_source(10)), (None, None));
    assert_eq!(surface.point_data["n"].values(), [4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
    insta::assert_snapshot!(surface.notes.join("\n"), @r"
    mended: left out 1 other piece (3 vertices), left out 1 unused point
    read as mm: 80.0 × 80.0 × 80.5 mm, area 111 cm²
    ");
}

#[test]
fn a_wrong_unit_is_noticed() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("mesh.vtk");
    std::fs::write(&path, file(DIALECTS[0])).unwrap();
    let notes = |units| mesh::read(&path, units).unwrap().notes.join("\n");
    let texts = [notes(Units::Mm), notes(Units::Cm), notes(Units::Um), notes(Units::M)];
    std::fs::write(&path, octahedron_text("POLYGONS 1 4\n3 0 1 2")).unwrap();
    insta::assert_snapshot!(format!("{}\n{}", texts.join("\n"), notes(Units::Mm)), @r"
    read as mm: 80.0 × 80.0 × 80.5 mm, area 111 cm²
    read as cm: 800 × 800 × 805 mm, area 11131 cm²
    WARNING: an area of 11131 cm² is not a left atrium's (20 to 600 cm²); with --units mm it would be 111 cm²: is the file in mm?
    read as um: 0.0800 × 0.0800 × 0.0805 mm, area 1.11e-4 cm²
    WARNING: an area of 1.11e-4 cm² is not a left atrium's (20 to 600 cm²); with --units mm it would be 111 cm²: is the file in mm?
    read as m: 80000 × 80000 × 80500 mm, area 1.11e8 cm²
    WARNING: an area of 1.11e8 cm² is not a left atrium's (20 to 600 cm²); with --units mm it would be 111 cm²: is the file in mm?
    mended: left out 3 unused points
    read as mm: 40.0 × 40.0 × 40.5 mm, area 14.0 cm²
    WARNING: an area of 14.0 cm² is not a left atrium's (20 to 600 cm²); no unit of length makes it one; this is fine for a patch or a test shape
    ");
}

fn shared_data(file: &str) -> Option<PathBuf> {
    let shared = std::env::var_os("EPLAT_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = shared.join("data").join(file);
    if path.exists() {
        return Some(path);
    }
    skipped::skipped("reference data not found");
    None
}

#[test]
fn the_clinical_shell_reads_with_its_stray_piece_dropped() {
    let Some(path) = shared_data("openep_la/la_lat.vtk") else { return };
    let surface = mesh::read(&path, Units::Mm).unwrap();
    assert_eq!(surface.n_source_vertices, 8848);
    assert_eq!((surface.mesh.n_vertices(), surface.mesh.n_triangles()), (8786, 16822));
    assert_eq!(surface.dropped, [62]);
    // Area of the largest piece by PyVista.
    assert!((surface.mesh.area() - 17_525.705_908_402).abs() < 1e-6);
    let lat = surface.point_data["LAT"].values();
    let range = lat.iter().fold([f64::MAX, f64::MIN], |[a, b], &x| [a.min(x), b.max(x)]);
    assert_eq!(range, [20.0, 175.0]);
    let Some(path) = shared_data("synthetic/clinical/mesh.vtk") else { return };
    let synthetic = mesh::read(&path, Units::Mm).unwrap();
    assert_eq!((synthetic.mesh.n_vertices(), synthetic.dropped.len()), (8786, 0));
}

#[test]
fn the_sphere_reads() {
    let Some(path) = shared_data("synthetic/sphere/mesh.vtk") else { return };
    let sphere = mesh::read(&path, Units::Mm).unwrap().mesh;
    assert_eq!((sphere.n_vertices(), sphere.euler_characteristic()), (2562, 2));
    let exact = 4.0 * std::f64::consts::PI * 25.0 * 25.0;
    assert!((sphere.area() / exact - 1.0).abs() < 2e-3);
}
