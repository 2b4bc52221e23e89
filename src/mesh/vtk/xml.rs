//! Reads XML `PolyData` (.vtp) with its arrays in the text: what [`super::write_vtp`] writes, and what
//! `ParaView` and `PyVista` write as "ascii" or uncompressed inline "binary".

use super::Content;
use super::types::Kind;
use crate::mesh::{MeshError, Place};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use roxmltree::{Document, Node};
use std::collections::BTreeMap;
use std::path::Path;

/// Reads `bytes`, the content of `path`.
///
/// # Errors
/// `Parse` with the line, `NotATriangle`.
pub(in super::super) fn parse_xml(path: &Path, bytes: &[u8]) -> Result<Content, MeshError> {
    let wrong = |line: usize, expected: &str, got: String| MeshError::Parse {
        path: path.into(),
        place: Place::Line(line),
        expected: expected.into(),
        got,
    };
    let inline = "XML PolyData with its arrays inline, ascii or binary";
    let text = str::from_utf8(bytes).map_err(|_| wrong(1, inline, "appended raw data".into()))?;
    let document =
        Document::parse(text).map_err(|e| wrong(e.pos().row as usize, "XML", e.to_string()))?;
    let reader = Reader { path, document: &document };
    let piece = reader.child(document.root_element(), &["PolyData", "Piece"])?;
    let points = reader.array(reader.child(piece, &["Points", "DataArray"])?)?;
    let vertices: Vec<[f64; 3]> = points.as_chunks().0.to_vec();
    let triangles = reader.triangles(piece, vertices.len())?;
    let mut point_data = BTreeMap::new();
    let data = piece.children().find(|n| n.has_tag_name("PointData"));
    for node in data.into_iter().flat_map(|n| n.children()).filter(|n| n.has_tag_name("DataArray"))
    {
        let name = node.attribute("Name").unwrap_or("unnamed");
        let values = reader.array(node)?;
        let width = values.len() / vertices.len().max(1);
        if values.len() != width * vertices.len() || width == 0 {
            let expected = format!("{} values of {name}", vertices.len());
            return Err(reader.wrong(node, &expected, values.len().to_string()));
        }
        for k in 0..width {
            let name = if width == 1 { name.to_string() } else { format!("{name}_{k}") };
            point_data.insert(name, values.iter().skip(k).step_by(width).copied().collect());
        }
    }
    Ok(Content { vertices, triangles, point_data })
}

struct Reader<'a> {
    path: &'a Path,
    document: &'a Document<'a>,
}

impl<'a> Reader<'a> {
    fn wrong(&self, node: Node, expected: &str, got: String) -> MeshError {
        let line = self.document.text_pos_at(node.range().start).row as usize;
        let (expected, place) = (expected.into(), Place::Line(line));
        MeshError::Parse { path: self.path.into(), place, expected, got }
    }

    /// The element at the end of `path`, the first of its name at each step.
    fn child(&self, from: Node<'a, 'a>, path: &[&str]) -> Result<Node<'a, 'a>, MeshError> {
        path.iter().try_fold(from, |node, name| {
            let found = node.children().find(|n| n.has_tag_name(*name));
            found.ok_or_else(|| self.wrong(node, &format!("<{name}>"), "none".into()))
        })
    }

    /// The numbers of a `DataArray`.
    fn array(&self, node: Node) -> Result<Vec<f64>, MeshError> {
        let text = node.text().unwrap_or_default().trim();
        let format = node.attribute("format").unwrap_or("ascii");
        if format == "ascii" {
            let number = |word: &str| {
                word.parse().map_err(|_| self.wrong(node, "a number", format!("{word:?}")))
            };
            return text.split_whitespace().map(number).collect();
        }
        let root = self.document.root_element();
        let plain = root.attribute("compressor").is_none()
            && root.attribute("byte_order").is_none_or(|order| order == "LittleEndian");
        if format != "binary" || !plain {
            let expected = "arrays inline, little-endian and without compression";
            return Err(self.wrong(node, expected, format!("format {format:?} or compressed")));
        }
        let name = match node.attribute("type").unwrap_or_default().to_lowercase().as_str() {
            "float64" => "double".into(),
            "float32" => "float".into(),
            integer => format!("vtktype{integer}"),
        };
        self.decode(node, text, Kind::named(&name))
    }

    /// Base64 of a length in bytes and then the numbers.
    fn decode(&self, node: Node, text: &str, kind: Option<Kind>) -> Result<Vec<f64>, MeshError> {
        let Some(kind) = kind else {
            let got = node.attribute("type").unwrap_or("none").to_string();
            return Err(self.wrong(node, "a number type like Float64 or Int64", got));
        };
        let header = match self.document.root_element().attribute("header_type") {
            Some("UInt64") => 8,
            _ => 4,
        };
        let bytes =
            STANDARD.decode(text).map_err(|error| self.wrong(node, "base64", error.to_string()))?;
        let length = bytes.iter().take(header).rev().fold(0, |sum, b| sum << 8 | u64::from(*b));
        if bytes.len() as u64 != header as u64 + length || length % kind.size() as u64 != 0 {
            let got = format!("{} bytes", bytes.len().saturating_sub(header));
            return Err(self.wrong(node, &format!("the {length} bytes that it announces"), got));
        }
        let numbers = bytes.get(header..).unwrap_or_default().chunks_exact(kind.size());
        let mut big_endian = [0; 8];
        let number = |bytes: &[u8]| {
            let swapped = &mut big_endian[..bytes.len()];
            swapped.copy_from_slice(bytes);
            swapped.reverse();
            kind.real(swapped)
        };
        Ok(numbers.map(number).collect())
    }

    fn triangles(
        &self,
        piece: Node<'a, 'a>,
        n_vertices: usize,
    ) -> Result<Vec<[u32; 3]>, MeshError> {
        let polys = self.child(piece, &["Polys"])?;
        let named = |name: &str| {
            let found = polys.children().find(|n| n.attribute("Name") == Some(name));
            self.array(found.ok_or_else(|| self.wrong(polys, name, "none".into()))?)
        };
        let (connectivity, offsets) = (named("connectivity")?, named("offsets")?);
        if connectivity.len() != 3 * offsets.len() {
            let expected = format!("three corners for each of {} triangles", offsets.len());
            return Err(self.wrong(polys, &expected, format!("{} corners", connectivity.len())));
        }
        let mut begin = 0.0;
        for (cell, end) in offsets.iter().enumerate() {
            let corners = end - begin;
            if corners.to_bits() != 3f64.to_bits() {
                let got = format!("a polygon of {corners} vertices");
                return Err(MeshError::NotATriangle { path: self.path.into(), cell, got });
            }
            begin = *end;
        }
        let in_range = |index: &f64| (0.0..n_vertices as f64).contains(index);
        match connectivity.iter().position(|index| !in_range(index)) {
            Some(i) => Err(MeshError::IndexOutOfRange {
                triangle: i / 3,
                index: connectivity[i] as i64,
                n_vertices,
            }),
            None => Ok(connectivity.as_chunks().0.iter().map(|t| t.map(|v| v as u32)).collect()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{TriMesh, left_atrium, write_vtp};

    fn parsed(text: &str) -> Result<Content, String> {
        parse_xml(Path::new("f.vtp"), text.as_bytes()).map_err(|error| error.to_string())
    }

    #[test]
    fn what_is_written_reads_back_the_same() {
        let mesh = left_atrium(3.0).mesh;
        let values: Vec<f64> = (0..mesh.n_vertices()).map(|i| (i as f64).sqrt()).collect();
        let file = tempfile::Builder::new().suffix(".vtp").tempfile().unwrap();
        write_vtp(file.path(), &mesh, &[("a & b", &values)]).unwrap();
        let content = parse_xml(file.path(), &std::fs::read(file.path()).unwrap()).unwrap();
        let again = TriMesh::new(content.vertices, content.triangles).unwrap();
        assert!(again.vertices() == mesh.vertices() && again.triangles() == mesh.triangles());
        assert_eq!(content.point_data["a & b"], values);
    }

    const TEXT: &str = "<VTKFile type=\"PolyData\">\n<PolyData><Piece>\n<Points><DataArray type=\"Float32\" format=\"ascii\">0 0 0 1 0 0 0 1 0</DataArray></Points>\n\
        <Polys><DataArray Name=\"connectivity\" format=\"ascii\">0 1 2</DataArray><DataArray Name=\"offsets\" format=\"ascii\">3</DataArray></Polys>\n\
        <PointData><DataArray Name=\"n\" NumberOfComponents=\"3\" format=\"ascii\">1 2 3 4 5 6 7 8 9</DataArray></PointData>\n</Piece></PolyData></VTKFile>";

    #[test]
    fn text_is_read_and_vectors_are_split() {
        let content = parsed(TEXT).unwrap();
        assert_eq!(content.triangles, [[0, 1, 2]]);
        assert_eq!(content.point_data["n_1"], [2.0, 5.0, 8.0]);
    }

    #[test]
    fn what_cannot_be_read_is_named_with_its_line() {
        let fails = |from: &str, to: &str| parsed(&TEXT.replace(from, to)).unwrap_err();
        assert!(fails("0 1 2<", "0 1 3<").contains("triangle 0 names vertex 3"));
        assert!(fails(">3<", ">2<").contains("cell 0 is a polygon of 2 vertices"));
        assert!(
            fails("0 1 2<", "0 1 2 0<")
                .contains("expected three corners for each of 1 triangles, got 4")
        );
        assert!(fails("1 0 0", "1 x 0").contains("f.vtp, line 3: expected a number, got \"x\""));
        assert!(
            fails("format=\"ascii\">1", "format=\"appended\">1")
                .contains("line 5: expected arrays inline")
        );
        assert!(fails("8 9<", "8<").contains("expected 3 values of n, got 8"));
        assert!(fails("</Piece>", "").contains("f.vtp, line 6: expected XML"));
    }
}
