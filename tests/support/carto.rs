//! A tiny study written as CARTO 3 exports one: a sheet of 10 × 10 vertices, 6 mm apart, and 12 points.
#![allow(dead_code, clippy::unwrap_used, reason = "tests; each uses a part of it")]

use std::fmt::Write as _;

/// Vertices along a side.
const N: usize = 10;
/// Distance between them, mm.
const EDGE: f64 = 6.0;

/// LAT in ms and bipolar voltage in mV at a place.
pub(crate) fn truth(x: f64, y: f64) -> (f64, f64) {
    (x + 0.5 * y, 1.0 + 0.05 * x)
}

/// The mesh `1-LA.mesh`: triangles of an inactive and of a hidden group, two vertices that nothing else uses,
/// a header of colours with fewer names than values.
pub(crate) fn mesh() -> String {
    let mut text = format!(
        "#TriangulatedMeshVersion2.0\n; no rights\n\n[GeneralAttributes]\nMeshID                 = -1\nMeshName               = \nNumVertex              = {}\nNumTriangle            = {}\nNumVertexColors        = 4\nColorsNames            = Unipolar  Bipolar  LAT  µBi  \n\n[VerticesSection]\n;    X  Y  Z  NormalX  NormalY  NormalZ  GroupID\n\n",
        N * N + 2,
        2 * (N - 1) * (N - 1) + 2
    );
    let place = |v: usize| (EDGE * (v % N) as f64, EDGE * (v / N) as f64);
    for v in 0..N * N {
        let (x, y) = place(v);
        writeln!(text, "{v:>4} =  {x:.1}  {y:.1}  0.000  0.0  0.0  1.0  0").unwrap();
    }
    writeln!(text, "{:>4} =  0.0  0.0  9.0  0.0  0.0  1.0  -1000000", N * N).unwrap();
    writeln!(text, "{:>4} =  0.0  0.0  -9.0  0.0  0.0  1.0  0", N * N + 1).unwrap();
    text += "\n[TrianglesSection]\n;  Vertex0  Vertex1  Vertex2  NormalX  NormalY  NormalZ  GroupID\n\n";
    let mut t = 0;
    let mut triangle = |corners: [usize; 3], group: i64| {
        let [a, b, c] = corners;
        writeln!(text, "{t:>4} =  {a} {b} {c}  0.0  0.0  1.0  {group}").unwrap();
        t += 1;
    };
    for v in (0..N * (N - 1)).filter(|v| v % N < N - 1) {
        triangle([v, v + 1, v + N], 0);
        triangle([v + 1, v + N + 1, v + N], 0);
    }
    triangle([0, 1, N * N], -1_000_000);
    triangle([0, 1, N * N + 1], -3);
    text += "\n[VerticesColorsSection]\n; Color Value= -10000 indicates invalid data for this coloring for this point\n;   Unipolar  Bipolar  LAT  µBi[ColorsScaleSection]\n\n";
    for v in 0..N * N + 2 {
        let (x, y) = place(v % (N * N));
        let (lat, bipolar) = truth(x, y);
        if v == 1 {
            writeln!(text, "{v:>4} =  -10000 -10000 -10000 -10000 -10000").unwrap();
        } else {
            writeln!(text, "{v:>4} =  2.5 {bipolar:.3} {lat:.3} -10000 -10000").unwrap();
        }
    }
    text += "\n[VerticesAttributesSection]\n;  Scar  EML\n; Scar=0: Vertex is regular vertex (not scar)\n";
    for v in 0..N * N + 2 {
        writeln!(text, "{v:>4} =  {}  0", u8::from(v == 5)).unwrap();
    }
    text
}

/// What is special of a point.
#[derive(Clone, Copy, Default)]
pub(crate) struct Special {
    /// Not annotated.
    pub(crate) no_lat: bool,
    /// Distance from the sheet, mm.
    pub(crate) off: f64,
    /// Number of a tag.
    pub(crate) tag: Option<u32>,
    /// Samples that are added to the annotation.
    pub(crate) late: i64,
}

/// Of point `id`, from 1 to 12.
pub(crate) fn special(id: usize) -> Special {
    let plain = Special { off: 0.5, ..Special::default() };
    match id {
        3 => Special { no_lat: true, ..plain },
        4 => Special { late: 900, ..plain },
        5 => Special { tag: Some(11), ..plain },
        6 => Special { off: 7.0, tag: Some(10), ..plain },
        8 => Special { off: 25.0, ..plain },
        _ => plain,
    }
}

/// Name and bytes of every file of the study.
pub(crate) fn files() -> Vec<(String, Vec<u8>)> {
    let mut files = vec![("1-LA.mesh".to_owned(), bytes(&mesh()))];
    let mut study = String::from(
        "<Study name=\"Study 1\">\n<Units Distance=\"mm\" Angle=\"radian\" />\n<Maps Count=\"2\">\n<TagsTable Count=\"2\">\n<Tag ID=\"10\" Short_Name=\"SCR\" Full_Name=\"Scar\" />\n<Tag ID=\"11\" Short_Name=\"LO\" Full_Name=\"Location Only\" />\n</TagsTable>\n<Map Name=\"1-LA\" NumFiles=\"1\" FileNames=\"1-LA.mesh\">\n<CartoPoints Count=\"12\">\n",
    );
    let mut car = String::from("VERSION_5_0 1-LA\n");
    let mut list = String::from("<Points Map_Name=\"1-LA\">\n");
    for id in 1..=12 {
        let special = special(id);
        // point 7 is at the origin, where LAT is 0
        let step = if id == 7 { 0 } else { id };
        let (x, y, z) = (4.0 * step as f64, (step % 4) as f64 * 12.0, special.off);
        let (lat, bipolar) = truth(x, y);
        let tag = special.tag.map(|tag| format!("<Tags Count=\"1\">{tag}</Tags>"));
        let tag = tag.unwrap_or_default();
        writeln!(study, "<Point Id=\"{id}\" Position3D=\"{x} {y} {z}\">{tag}</Point>").unwrap();
        writeln!(car, "P\t0\t{id}\t0\t{x}\t{y}\t{z}\t0\t0\t0\t2.5\t{bipolar}\t-10000\t100.25\t0\t-1\t1\tA\t0\t18027").unwrap();
        writeln!(list, "<Point ID=\"{id}\" File_Name=\"1-LA_P{id}_Point_Export.xml\" />").unwrap();
        let at = 2000 + lat as i64 + special.late;
        let at = if special.no_lat { 2000 - 10_000 } else { at };
        let point = format!(
            "<Point ID=\"{id}\">\n<Annotations StartTime=\"1\" Reference_Annotation=\"2000\" Map_Annotation=\"{at}\" />\n<WOI From=\"-50\" To=\"250\" />\n<Voltages Unipolar=\"2.5\" Bipolar=\"{bipolar}\" />\n<Positions>\n<Connector MAGNETIC_20_POLE_A_CONNECTOR=\"x.txt\" />\n</Positions>\n<Impedances Number=\"2\"><Impedance Time=\"-900\" Value=\"90\" /><Impedance Time=\"3\" Value=\"101.5\" /></Impedances>\n</Point>\n"
        );
        files.push((format!("1-LA_P{id}_Point_Export.xml"), bytes(&point)));
        let force = format!(
            "1-LA_P{id}_ContactForce.txt_2.0\nRate=50\nIndex\tTime\tTimestamp\tForceValue\tAxialAngle\n1\t-60\t0\t2\t0\n2\t-10\t50\t{}\t0\n3\t40\t100\t30\t0\n",
            5 + id
        );
        files.push((format!("1-LA_P{id}_ContactForce.txt"), bytes(&force)));
    }
    study += "</CartoPoints>\n</Map>\n<Map Name=\"2-Empty\" NumFiles=\"1\" FileNames=\"2-Empty.mesh\">\n<CartoPoints Count=\"0\" />\n</Map>\n</Maps>\n</Study>\n";
    files.push(("Study 1.xml".into(), bytes(&study)));
    files.push(("1-LA_car.txt".into(), bytes(&car)));
    files.push(("1-LA_Points_Export.xml".into(), bytes(&(list + "</Points>\n"))));
    files.push(("2-Empty_car.txt".into(), bytes("VERSION_5_0 2-Empty\n")));
    files
}

/// As the system writes it: cp1252 with CRLF.
fn bytes(text: &str) -> Vec<u8> {
    text.replace('\n', "\r\n").chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect()
}
