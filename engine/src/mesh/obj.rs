//! Wavefront .obj: vertices and polygons. Texture coordinates, normals, groups and materials are left
//! out; negative numbers count back from the last vertex.

use super::content::{Cells, Content};
use super::geometry::Geometry;
use super::text::Lines;
use super::{Data, MeshError, Units};
use std::io::Write as _;
use std::path::Path;

/// Reads `bytes`, the content of `path`.
///
/// # Errors
/// `Parse` with the line, `IndexOutOfRange`.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Content, MeshError> {
    let mut lines = Lines::new(path, bytes);
    let (mut vertices, mut corners, mut ends) = (vec![], vec![], vec![]);
    let mut n_others = 0;
    let mut units = None;
    while let Some(line) = lines.next() {
        let (line, comment) = line.split_once('#').unwrap_or((&line, ""));
        units = units.or_else(|| Units::in_comment(comment));
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => vertices.push(lines.point(&mut words)?),
            Some("f") => {
                for word in words {
                    corners.push(corner(&lines, word, vertices.len())?);
                }
                ends.push(corners.len());
            }
            Some("l" | "p") => n_others += 1,
            _ => {}
        }
    }
    let mut cells = Cells::new(vertices.len());
    let mut begin = 0;
    for end in ends {
        cells.polygon(&corners[begin..end])?;
        begin = end;
    }
    cells.skip(n_others);
    Ok(Content { units, ..cells.into_content(vertices, Data::new(), []) })
}

/// The vertex of `v`, `v/vt`, `v//vn` or `v/vt/vn`, from 0, with `n` vertices so far.
fn corner(lines: &Lines, word: &str, n: usize) -> Result<i64, MeshError> {
    let number = word.split('/').next().unwrap_or_default();
    match number.parse::<i64>() {
        Ok(index) if index > 0 => Ok(index - 1),
        Ok(index) if index < 0 => Ok((n as i64).saturating_add(index)),
        _ => Err(lines.wrong("a vertex number, from 1 or counted back from -1", word)),
    }
}

/// The file of a surface, without its arrays.
pub(super) fn written(geometry: &Geometry) -> Vec<u8> {
    let mut text = b"# lengths in mm\n".to_vec();
    for [x, y, z] in geometry.vertices {
        let _ = writeln!(text, "v {x} {y} {z}");
    }
    for t in geometry.triangles {
        let [a, b, c] = t.map(|v| u64::from(v) + 1);
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Content, String> {
        parse(Path::new("f.obj"), text.as_bytes()).map_err(|error| error.to_string())
    }

    #[test]
    fn every_way_to_name_a_corner_is_read() {
        let text = "# lengths in cm\r\nmtllib a.mtl\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0 0.2 0.3 0.4 # c\nvt 0 0\nvn 0 0 1\nv 0 1 0\n\
            g quad\nf 1/1/1 2/1/1 3//1 4/1\ns off\nf -4 -2 -1\nl 1 2\n";
        let content = parsed(text).unwrap();
        assert_eq!(content.triangles, [[0, 1, 2], [0, 2, 3], [0, 2, 3]]);
        assert_eq!((content.vertices.len(), content.units), (4, Some(Units::Cm)));
        let remarks = ["1 polygon cut into triangles", "1 cell left out: points or lines"];
        assert_eq!(content.remarks, remarks);
    }

    #[test]
    fn mistakes_are_named() {
        assert!(
            parsed("v 0 0 0\nv 1 0\n").unwrap_err().contains("line 2: expected three coordinates")
        );
        assert!(
            parsed("v 0 0 0\nf 0 1 1\n").unwrap_err().contains("line 2: expected a vertex number")
        );
        assert!(
            parsed("v 0 0 0\nf 1 1 2\n").unwrap_err().contains("names vertex 1, expected 0 to 0")
        );
        assert!(parsed("v 0 0 0\nf 1 1 -3\n").unwrap_err().contains("names vertex -2"));
    }
}
