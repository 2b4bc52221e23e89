//! Reads XML `PolyData` (.vtp) and `UnstructuredGrid` (.vtu) of triangles, polygons and strips, with one
//! or several pieces.

use super::xml_array::{Appended, Reader};
use super::xml_cells::{poly_data, unstructured_grid};
use crate::mesh::content::{Cells, Content};
use crate::mesh::{Array, Data, MeshError, Place, Units};
use roxmltree::{Document, Node};
use std::path::Path;

/// Reads `bytes`, the content of `path`.
///
/// # Errors
/// `Parse` with the line, `NotATriangle`, `IndexOutOfRange`, `Unsupported`.
pub(in super::super) fn parse_xml(path: &Path, bytes: &[u8]) -> Result<Content, MeshError> {
    let wrong = |line: usize, expected: &str, got: String| MeshError::Parse {
        path: path.into(),
        place: Place::Line(line),
        expected: expected.into(),
        got,
    };
    let (head, appended) = cut_out(bytes).map_err(|got| wrong(1, "appended data", got))?;
    let text = str::from_utf8(head).map_err(|error| {
        let line = head[..error.valid_up_to()].split(|byte| *byte == b'\n').count();
        wrong(line, "XML in UTF-8", "bytes that are no text".into())
    })?;
    let closed = match appended {
        Appended::None => text.to_owned(),
        _ => format!("{text}</VTKFile>"),
    };
    let document =
        Document::parse(&closed).map_err(|e| wrong(e.pos().row as usize, "XML", e.to_string()))?;
    let reader = Reader::new(path, &document, appended, bytes.len())?;
    let root = document.root_element();
    let kinds = ["PolyData", "UnstructuredGrid"];
    let dataset = root.children().find(|n| kinds.iter().any(|kind| n.has_tag_name(*kind)));
    let Some(dataset) = dataset else {
        let got = root.attribute("type").unwrap_or("neither").to_owned();
        return Err(reader.wrong(root, "<PolyData> or <UnstructuredGrid>", got));
    };
    let mut content = pieces(&reader, dataset)?;
    let mut comments = root.descendants().filter(Node::is_comment);
    content.units = comments.find_map(|n| Units::in_comment(n.text()?));
    Ok(content)
}

/// The document without its element `AppendedData`, which may hold any bytes, and those bytes.
fn cut_out(bytes: &[u8]) -> Result<(&[u8], Appended<'_>), String> {
    const TAG: &[u8] = b"<AppendedData";
    let Some(start) = bytes.windows(TAG.len()).position(|window| window == TAG) else {
        return Ok((bytes, Appended::None));
    };
    let rest = &bytes[start..];
    let close = rest.iter().position(|byte| *byte == b'>').ok_or("no end of <AppendedData")?;
    let (tag, rest) = (String::from_utf8_lossy(&rest[..close]), &rest[close + 1..]);
    // Blanks, then an underscore: what follows is the data.
    let begin = rest.iter().position(|byte| !byte.is_ascii_whitespace());
    let begin = begin.filter(|at| rest[*at] == b'_').ok_or("no _ in front of the data")?;
    let data = &rest[begin + 1..];
    if tag.contains("\"raw\"") || tag.contains("'raw'") {
        return Ok((&bytes[..start], Appended::Raw(data)));
    }
    let end = data.iter().position(|byte| *byte == b'<').unwrap_or(data.len());
    Ok((&bytes[..start], Appended::Base64(&data[..end])))
}

/// All pieces, one behind the other.
fn pieces<'a>(reader: &Reader<'a>, dataset: Node<'a, 'a>) -> Result<Content, MeshError> {
    let mut all: Option<Content> = None;
    for node in dataset.children().filter(|n| n.has_tag_name("Piece")) {
        if reader.count(node, "NumberOfPoints")? == Some(0) {
            continue; // what parallel writers leave where they had nothing
        }
        let piece = piece(reader, node, dataset.has_tag_name("PolyData"))?;
        all = Some(match all {
            None => piece,
            Some(before) => append(before, piece),
        });
    }
    all.ok_or_else(|| reader.wrong(dataset, "<Piece> with points", "none"))
}

fn piece<'a>(
    reader: &Reader<'a>,
    node: Node<'a, 'a>,
    is_poly_data: bool,
) -> Result<Content, MeshError> {
    let points = reader.child(reader.child(node, "Points")?, "DataArray")?;
    let coordinates = reader.numbers(points)?;
    if !coordinates.len().is_multiple_of(3) {
        let got = format!("{} numbers", coordinates.len());
        return Err(reader.wrong(points, "three coordinates for every point", got));
    }
    let vertices: Vec<[f64; 3]> = coordinates.as_chunks().0.to_vec();
    reader.is_count(node, "NumberOfPoints", vertices.len())?;
    let mut cells = Cells::new(vertices.len());
    let read = if is_poly_data { poly_data } else { unstructured_grid };
    read(reader, node, &mut cells)?;
    let point_data = attributes(reader, node, "PointData", vertices.len())?;
    let cell_data = attributes(reader, node, "CellData", cells.len())?;
    Ok(cells.into_content(vertices, point_data, cell_data))
}

/// The arrays of numbers of a section, with `n` rows each.
fn attributes<'a>(
    reader: &Reader<'a>,
    piece: Node<'a, 'a>,
    section: &str,
    n: usize,
) -> Result<Data, MeshError> {
    let section = piece.children().find(|node| node.has_tag_name(section));
    let arrays = section.into_iter().flat_map(|node| node.children());
    let mut data = Data::new();
    for node in arrays.filter(|node| node.has_tag_name("DataArray")) {
        let kind = node.attribute("type").unwrap_or_default().to_lowercase();
        if matches!(kind.as_str(), "string" | "bit") {
            continue;
        }
        let name = node.attribute("Name").unwrap_or("unnamed");
        let values = reader.numbers(node)?;
        let width = values.len() / n.max(1);
        if values.len() != width * n {
            let expected = format!("{n} values of {name}");
            return Err(reader.wrong(node, &expected, values.len().to_string()));
        }
        if width > 0 {
            data.insert(name.to_owned(), Array::new(width, values));
        }
    }
    Ok(data)
}

/// Two pieces as one; arrays that only one of them has are left out.
fn append(mut all: Content, piece: Content) -> Content {
    let n = all.vertices.len() as u32;
    all.vertices.extend(piece.vertices);
    all.triangles.extend(piece.triangles.iter().map(|t| t.map(|v| v.saturating_add(n))));
    let joined = |mut first: Data, mut second: Data| -> Data {
        first.retain(|name, array| {
            let other = second.remove(name).filter(|other| other.width() == array.width());
            other.is_some_and(|other| {
                let values = [array.values(), other.values()].concat();
                *array = Array::new(array.width(), values);
                true
            })
        });
        first
    };
    all.point_data = joined(all.point_data, piece.point_data);
    all.cell_data = joined(all.cell_data, piece.cell_data);
    all.remarks.extend(piece.remarks);
    all
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
        assert_eq!(content.units, Some(Units::Mm));
        let again = TriMesh::new(content.vertices, content.triangles).unwrap();
        assert!(again.vertices() == mesh.vertices() && again.triangles() == mesh.triangles());
        assert_eq!(content.point_data["a & b"].values(), values);
    }

    const TEXT: &str = "<VTKFile type=\"PolyData\">\n<PolyData><Piece>\n<Points><DataArray type=\"Float32\" format=\"ascii\">0 0 0 1 0 0 0 1 0</DataArray></Points>\n\
        <Polys><DataArray Name=\"connectivity\" format=\"ascii\">0 1 2</DataArray><DataArray Name=\"offsets\" format=\"ascii\">3</DataArray></Polys>\n\
        <PointData><DataArray Name=\"n\" NumberOfComponents=\"3\" format=\"ascii\">1 2 3 4 5 6 7 8 9</DataArray></PointData>\n</Piece></PolyData></VTKFile>";

    #[test]
    fn text_is_read_and_vectors_are_kept() {
        let content = parsed(TEXT).unwrap();
        assert_eq!(content.triangles, [[0, 1, 2]]);
        assert_eq!(content.point_data["n"].row(1), [4.0, 5.0, 6.0]);
    }

    #[test]
    fn pieces_are_put_together() {
        let (start, end) = (TEXT.find("<Piece>").unwrap(), TEXT.find("</PolyData>").unwrap());
        let piece = &TEXT[start..end];
        let two = TEXT.replace(piece, &format!("{piece}<Piece NumberOfPoints=\"0\"/>{piece}"));
        let content = parsed(&two).unwrap();
        assert_eq!(content.triangles, [[0, 1, 2], [3, 4, 5]]);
        assert_eq!((content.vertices.len(), content.point_data["n"].n_rows()), (6, 6));
    }

    #[test]
    fn what_cannot_be_read_is_named_with_its_line() {
        let fails = |from: &str, to: &str| parsed(&TEXT.replace(from, to)).unwrap_err();
        assert!(fails("0 1 2<", "0 1 3<").contains("triangle 0 names vertex 3"));
        assert!(fails(">3<", ">4<").contains("expected offsets that rise to 3, got 4 after 0"));
        assert!(fails(">3<", ">-1<").contains("expected offsets that rise to 3, got -1 after 0"));
        assert!(fails("0 1 2<", "0 1 2 0<").contains("expected 3 corners"));
        assert!(fails("1 0 0", "1 x 0").contains("f.vtp, line 3: expected a number, got \"x\""));
        let appended = fails("format=\"ascii\">1", "format=\"appended\">1");
        assert!(appended.contains("line 5: expected an attribute offset, got none"), "{appended}");
        assert!(fails("8 9<", "8<").contains("expected 3 values of n, got 8"));
        assert!(fails("</Piece>", "").contains("f.vtp, line 6: expected XML"));
        let lz4 = fails("type=\"PolyData\"", "compressor=\"vtkLZ4DataCompressor\"");
        assert!(lz4.ends_with("help: save the mesh with zlib compression or none"), "{lz4}");
        let end = "</VTKFile>";
        assert!(fails(end, "<AppendedData encoding=\"raw\">").contains("no _ in front"));
    }
}
