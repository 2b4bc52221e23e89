//! Writes VTK files: XML (.vtp, .vtu) for ParaView, and the legacy format (.vtk).

use super::super::bytes::Encoding;
use super::super::geometry::{Geometry, Rows};
use super::super::names::encoded;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write as _;

/// XML `PolyData`.
pub(in super::super) fn vtp(geometry: &Geometry) -> Vec<u8> {
    let (n_points, n_cells) = (geometry.vertices.len(), geometry.triangles.len());
    let mut xml = begun("PolyData");
    let _ = writeln!(xml, "<Piece NumberOfPoints=\"{n_points}\" NumberOfPolys=\"{n_cells}\">");
    points(&mut xml, geometry);
    xml.push_str("<Polys>\n");
    corners(&mut xml, geometry);
    xml.push_str("</Polys>\n");
    ended(xml, geometry, "PolyData")
}

/// XML `UnstructuredGrid`.
pub(in super::super) fn vtu(geometry: &Geometry) -> Vec<u8> {
    let (n_points, n_cells) = (geometry.vertices.len(), geometry.triangles.len());
    let mut xml = begun("UnstructuredGrid");
    let _ = writeln!(xml, "<Piece NumberOfPoints=\"{n_points}\" NumberOfCells=\"{n_cells}\">");
    points(&mut xml, geometry);
    xml.push_str("<Cells>\n");
    corners(&mut xml, geometry);
    data_array(&mut xml, "UInt8", "types", 1, geometry.triangles.iter().map(|_| [TRIANGLE]));
    xml.push_str("</Cells>\n");
    ended(xml, geometry, "UnstructuredGrid")
}

/// VTK's number of the cell type.
const TRIANGLE: u8 = 5;

fn begun(kind: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n\
         <VTKFile type=\"{kind}\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n\
         <!-- lengths in mm -->\n<{kind}>\n"
    )
}

fn points(xml: &mut String, geometry: &Geometry) {
    xml.push_str("<Points>\n");
    let coordinates = geometry.vertices.iter().flatten().map(|x| x.to_le_bytes());
    data_array(xml, "Float64", "Points", 3, coordinates);
    xml.push_str("</Points>\n");
}

fn corners(xml: &mut String, geometry: &Geometry) {
    let connectivity = geometry.triangles.iter().flatten().map(|&v| i64::from(v).to_le_bytes());
    data_array(xml, "Int64", "connectivity", 1, connectivity);
    let offsets = (1..=geometry.triangles.len() as i64).map(|i| (3 * i).to_le_bytes());
    data_array(xml, "Int64", "offsets", 1, offsets);
}

fn ended(mut xml: String, geometry: &Geometry, kind: &str) -> Vec<u8> {
    for (section, arrays) in
        [("PointData", &geometry.point_data), ("CellData", &geometry.cell_data)]
    {
        let _ = writeln!(xml, "<{section}>");
        for Rows { name, width, values } in arrays {
            data_array(&mut xml, "Float64", name, *width, values.iter().map(|x| x.to_le_bytes()));
        }
        let _ = writeln!(xml, "</{section}>");
    }
    let _ = write!(xml, "</Piece>\n</{kind}>\n</VTKFile>\n");
    xml.into_bytes()
}

/// One array inline: base64 of its length in bytes and then its numbers.
fn data_array<const N: usize>(
    xml: &mut String,
    kind: &str,
    name: &str,
    n_components: usize,
    numbers: impl Iterator<Item = [u8; N]>,
) {
    let mut bytes = vec![0; 8];
    numbers.for_each(|number| bytes.extend(number));
    let length = bytes.len() as u64 - 8;
    bytes[..8].copy_from_slice(&length.to_le_bytes());
    let name = escape(name);
    let _ = writeln!(
        xml,
        "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{n_components}\" format=\"binary\">"
    );
    STANDARD.encode_string(&bytes, xml);
    xml.push_str("\n</DataArray>\n");
}

fn escape(name: &str) -> String {
    name.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Legacy VTK 3.0; `encoding` says whether numbers are text or big-endian bytes.
pub(in super::super) fn legacy(geometry: &Geometry, encoding: Encoding) -> Vec<u8> {
    let (n_points, n_cells) = (geometry.vertices.len(), geometry.triangles.len());
    let format = match encoding {
        Encoding::Ascii => "ASCII",
        Encoding::Binary => "BINARY",
    };
    let mut out = Legacy { bytes: Vec::new(), encoding };
    out.line(&format!("# vtk DataFile Version 3.0\nsurface in mm\n{format}\nDATASET POLYDATA"));
    out.line(&format!("POINTS {n_points} double"));
    geometry.vertices.iter().for_each(|p| out.reals(p));
    out.end_array();
    out.line(&format!("POLYGONS {n_cells} {}", 4 * n_cells));
    geometry.triangles.iter().for_each(|&[a, b, c]| out.integers([3, a, b, c]));
    out.end_array();
    out.section("POINT_DATA", n_points, &geometry.point_data);
    out.section("CELL_DATA", n_cells, &geometry.cell_data);
    out.bytes
}

struct Legacy {
    bytes: Vec<u8>,
    encoding: Encoding,
}

impl Legacy {
    fn section(&mut self, keyword: &str, n: usize, arrays: &[Rows]) {
        if !arrays.is_empty() {
            self.line(&format!("{keyword} {n}\nFIELD FieldData {}", arrays.len()));
        }
        for Rows { name, width, values } in arrays {
            self.line(&format!("{} {width} {n} double", encoded(name)));
            values.chunks(*width).for_each(|row| self.reals(row));
            self.end_array();
        }
    }

    fn line(&mut self, text: &str) {
        self.bytes.extend(text.bytes());
        self.bytes.push(b'\n');
    }

    /// One row of real numbers.
    fn reals(&mut self, row: &[f64]) {
        match self.encoding {
            Encoding::Binary => row.iter().for_each(|x| self.bytes.extend(x.to_be_bytes())),
            Encoding::Ascii => self.text_row(row.iter().map(|x| format!("{x:?}").to_lowercase())),
        }
    }

    /// One row of indices.
    fn integers(&mut self, row: [u32; 4]) {
        match self.encoding {
            Encoding::Binary => row.iter().for_each(|i| self.bytes.extend(i.to_be_bytes())),
            Encoding::Ascii => self.text_row(row.iter().map(ToString::to_string)),
        }
    }

    fn text_row(&mut self, words: impl Iterator<Item = String>) {
        self.line(&words.collect::<Vec<_>>().join(" "));
    }

    /// Binary arrays end with a line break too.
    fn end_array(&mut self) {
        if self.encoding == Encoding::Binary {
            self.bytes.push(b'\n');
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::{TriMesh, write_vtp};
    use super::*;

    fn triangle() -> TriMesh {
        let vertices = vec![[0.0, 0.0, 0.5], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        TriMesh::new(vertices, vec![[0, 1, 2]]).unwrap()
    }

    /// The numbers of the array `name` in a .vtp file, and the length it announces.
    fn decode(xml: &str, name: &str) -> (u64, Vec<[u8; 8]>) {
        let header = xml.find(&format!("Name=\"{name}\"")).unwrap();
        let text = xml[header..].lines().nth(1).unwrap();
        let bytes = STANDARD.decode(text).unwrap();
        let (words, rest) = bytes.as_chunks::<8>();
        assert!(rest.is_empty());
        (u64::from_le_bytes(words[0]), words[1..].to_vec())
    }

    #[test]
    fn vtp_holds_the_mesh_and_its_data() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("t.vtp");
        let lat = [1.5, f64::NAN, -3.0];
        write_vtp(&path, &triangle(), &[("a<\"b", &lat)]).unwrap();
        let xml = std::fs::read_to_string(&path).unwrap();
        let (length, numbers) = decode(&xml, "a&lt;&quot;b");
        assert_eq!((length, numbers), (24, lat.map(f64::to_le_bytes).to_vec()));
        let (_, connectivity) = decode(&xml, "connectivity");
        assert_eq!(connectivity, [0i64, 1, 2].map(i64::to_le_bytes));
        assert_eq!(decode(&xml, "offsets"), (8, vec![3i64.to_le_bytes()]));
        assert_eq!(decode(&xml, "Points").1[2], 0.5f64.to_le_bytes());
    }
}
