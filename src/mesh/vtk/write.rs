//! Writes VTK files: XML (.vtp) for ParaView, and the legacy format (.vtk).
//!
//! A file appears under its name only when it is whole.

use super::super::{MeshError, TriMesh};
use crate::store::write_file;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// How a legacy VTK file holds its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Text, in the shortest form that reads back the same.
    Ascii,
    /// Big-endian bytes.
    Binary,
}

/// Writes `mesh` and its `point_data` (name, one value per vertex; NaN allowed) as XML .vtp.
///
/// # Errors
/// `DataLength` for an array of another length, `Write` if the file cannot be written.
pub fn write_vtp(
    path: &Path,
    mesh: &TriMesh,
    point_data: &[(&str, &[f64])],
) -> Result<(), MeshError> {
    check_lengths(mesh, point_data)?;
    let (n_points, n_cells) = (mesh.n_vertices(), mesh.n_triangles());
    let connectivity = mesh.triangles().iter().flatten().map(|&v| i64::from(v).to_le_bytes());
    let offsets = (1..=n_cells as i64).map(|i| (3 * i).to_le_bytes());
    let mut xml = format!(
        "<?xml version=\"1.0\"?>\n\
         <VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n\
         <PolyData>\n<Piece NumberOfPoints=\"{n_points}\" NumberOfPolys=\"{n_cells}\">\n<Points>\n"
    );
    let coordinates = mesh.vertices().iter().flatten().map(|x| x.to_le_bytes());
    data_array(&mut xml, "Float64", "Points", 3, coordinates);
    xml.push_str("</Points>\n<Polys>\n");
    data_array(&mut xml, "Int64", "connectivity", 1, connectivity);
    data_array(&mut xml, "Int64", "offsets", 1, offsets);
    xml.push_str("</Polys>\n<PointData>\n");
    for (name, values) in point_data {
        data_array(&mut xml, "Float64", name, 1, values.iter().map(|x| x.to_le_bytes()));
    }
    xml.push_str("</PointData>\n</Piece>\n</PolyData>\n</VTKFile>\n");
    write_whole(path, xml.as_bytes())
}

/// One array inline: base64 of its length in bytes and then its numbers.
fn data_array(
    xml: &mut String,
    kind: &str,
    name: &str,
    n_components: usize,
    numbers: impl Iterator<Item = [u8; 8]>,
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

/// Writes `mesh` and its `point_data` (name, one value per vertex; NaN allowed) as legacy VTK 3.0.
///
/// # Errors
/// `DataLength` for an array of another length, `Write` if the file cannot be written.
pub fn write_vtk(
    path: &Path,
    mesh: &TriMesh,
    point_data: &[(&str, &[f64])],
    encoding: Encoding,
) -> Result<(), MeshError> {
    check_lengths(mesh, point_data)?;
    let (n_points, n_cells) = (mesh.n_vertices(), mesh.n_triangles());
    let format = match encoding {
        Encoding::Ascii => "ASCII",
        Encoding::Binary => "BINARY",
    };
    let mut out = Legacy { bytes: Vec::new(), encoding };
    out.line(&format!("# vtk DataFile Version 3.0\nsurface in mm\n{format}\nDATASET POLYDATA"));
    out.line(&format!("POINTS {n_points} double"));
    mesh.vertices().iter().for_each(|p| out.reals(p));
    out.end_array();
    out.line(&format!("POLYGONS {n_cells} {}", 4 * n_cells));
    mesh.triangles().iter().for_each(|&[a, b, c]| out.integers([3, a, b, c]));
    out.end_array();
    if !point_data.is_empty() {
        out.line(&format!("POINT_DATA {n_points}\nFIELD FieldData {}", point_data.len()));
    }
    for (name, values) in point_data {
        out.line(&format!("{} 1 {n_points} double", percent_encode(name)));
        values.iter().for_each(|&x| out.reals(&[x]));
        out.end_array();
    }
    write_whole(path, &out.bytes)
}

struct Legacy {
    bytes: Vec<u8>,
    encoding: Encoding,
}

impl Legacy {
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

/// Array names are one word in this format: anything else is written as `%` and two hex digits.
fn percent_encode(name: &str) -> String {
    let mut encoded = String::new();
    for byte in name.bytes() {
        if byte.is_ascii_graphic() && !matches!(byte, b'%' | b'"') {
            encoded.push(char::from(byte));
        } else {
            let _ = write!(encoded, "%{byte:02X}");
        }
    }
    encoded
}

fn check_lengths(mesh: &TriMesh, point_data: &[(&str, &[f64])]) -> Result<(), MeshError> {
    let expected = mesh.n_vertices();
    match point_data.iter().find(|(_, values)| values.len() != expected) {
        None => Ok(()),
        Some((name, values)) => {
            Err(MeshError::DataLength { name: (*name).into(), expected, got: values.len() })
        }
    }
}

/// Writes under a temporary name in the same folder and renames.
fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), MeshError> {
    write_file(path, |file| file.write_all(bytes))
        .map_err(|source| MeshError::Write { path: path.into(), source })
}

#[cfg(test)]
mod tests {
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

    #[test]
    fn names_are_one_word_in_the_legacy_format() {
        assert_eq!(percent_encode("LAT (ms) 5%"), "LAT%20(ms)%205%25");
    }
}
