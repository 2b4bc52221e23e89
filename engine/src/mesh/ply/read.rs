//! Reads a .ply file: vertices, faces and strips; other elements are passed over.

use super::header::{self, Coding, Element, Header, Property};
use crate::mesh::content::{Cells, Content};
use crate::mesh::data::join_vectors;
use crate::mesh::names::decoded;
use crate::mesh::{Array, Data, MeshError, Place};
use std::path::Path;

/// Reads `bytes`, the content of `path`.
///
/// # Errors
/// `Parse` and `Truncated` with the place, `IndexOutOfRange`.
pub(in crate::mesh) fn parse(path: &Path, bytes: &[u8]) -> Result<Content, MeshError> {
    let header = header::read(path, bytes)?;
    let rest = &bytes[header.length..];
    let mut body =
        Body { path, rest, header: &header, length: bytes.len(), n_lines: header.n_lines + 1 };
    let (mut vertices, mut point_data) = (vec![], Data::new());
    let (mut faces, mut strips, mut face_data) = (Lists::default(), Lists::default(), Data::new());
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => {
                let columns = body.table(element, None)?;
                (vertices, point_data) = split_points(&body, columns)?;
            }
            "face" => face_data = named(body.table(element, Some(&mut faces))?),
            "tristrips" => drop(body.table(element, Some(&mut strips))?),
            _ => drop(body.table(element, None)?),
        }
    }
    join_vectors(&mut point_data);
    join_vectors(&mut face_data);
    let mut cells = Cells::new(vertices.len());
    faces.iter().try_for_each(|face| cells.polygon(face))?;
    for strip in strips.iter().flat_map(|list| list.split(|v| *v == -1)) {
        cells.strip(strip)?;
    }
    let content = cells.into_content(vertices, point_data, face_data);
    Ok(Content { units: header.units, ..content })
}

/// Lists of corners, one behind the other.
#[derive(Debug, Default)]
struct Lists {
    corners: Vec<i64>,
    ends: Vec<usize>,
}

impl Lists {
    fn iter(&self) -> impl Iterator<Item = &[i64]> {
        let begins = [0].into_iter().chain(self.ends.iter().copied());
        begins.zip(&self.ends).map(|(begin, end)| &self.corners[begin..*end])
    }
}

/// The single numbers of an element, by the name in the header.
type Columns = Vec<(String, Array)>;

/// The columns under the names that the arrays had before they were put into a header.
fn named(columns: Columns) -> Data {
    columns.into_iter().map(|(name, array)| (decoded(&name), array)).collect()
}

/// x, y and z, and the other numbers.
fn split_points(body: &Body, mut columns: Columns) -> Result<(Vec<[f64; 3]>, Data), MeshError> {
    let mut take = |axis: &str| {
        let at = columns.iter().position(|(name, _)| name == axis)?;
        Some(columns.swap_remove(at).1)
    };
    let (Some(x), Some(y), Some(z)) = (take("x"), take("y"), take("z")) else {
        return Err(body.wrong("properties x, y and z of the vertices", "not all of them"));
    };
    let [x, y, z] = [x.values(), y.values(), z.values()];
    Ok(((0..x.len()).map(|i| [x[i], y[i], z[i]]).collect(), named(columns)))
}

/// What follows the header.
struct Body<'a> {
    path: &'a Path,
    rest: &'a [u8],
    header: &'a Header,
    length: usize,
    n_lines: usize,
}

impl Body<'_> {
    /// The single numbers of an element; the list of corners, if there is one, goes to `lists`.
    fn table(
        &mut self,
        element: &Element,
        mut lists: Option<&mut Lists>,
    ) -> Result<Columns, MeshError> {
        let Element { name, n, properties } = element;
        let mut columns: Vec<Vec<f64>> = vec![vec![]; properties.len()];
        // Elements without properties take no room: there is nothing to read.
        let n = if properties.is_empty() { 0 } else { *n };
        for i in 0..n {
            for (property, column) in properties.iter().zip(&mut columns) {
                let what = || format!("{} of {name} {i} of {n}", property.name);
                match property.count {
                    None => column.push(self.number(property, &what)?),
                    Some(_) => self.list(property, &what, lists.as_deref_mut())?,
                }
            }
            if let Some(lists) = lists.as_deref_mut() {
                lists.ends.push(lists.corners.len());
            }
        }
        let columns = properties.iter().zip(columns).filter(|(p, _)| p.count.is_none());
        Ok(columns.map(|(property, column)| (property.name.clone(), column.into())).collect())
    }

    fn list(
        &mut self,
        property: &Property,
        what: &dyn Fn() -> String,
        lists: Option<&mut Lists>,
    ) -> Result<(), MeshError> {
        let Some(kind) = property.count else { return Ok(()) };
        let count = Property { name: property.name.clone(), kind, count: None };
        let n = self.number(&count, what)?;
        if n < 0.0 || n.fract() != 0.0 {
            return Err(self.wrong(&format!("the length of {}", what()), &n.to_string()));
        }
        let is_corners = matches!(property.name.as_str(), "vertex_indices" | "vertex_index");
        let mut lists = lists.filter(|_| is_corners);
        for _ in 0..n as u64 {
            let number = self.number(property, what)?;
            if let Some(lists) = lists.as_deref_mut() {
                if number.fract() != 0.0 {
                    return Err(self.wrong("whole numbers as corners", &number.to_string()));
                }
                lists.corners.push(number as i64);
            }
        }
        Ok(())
    }

    fn number(&mut self, property: &Property, what: &dyn Fn() -> String) -> Result<f64, MeshError> {
        if self.header.coding == Coding::Text {
            return self.word(what);
        }
        let size = property.kind.size();
        if self.rest.len() < size {
            return Err(self.truncated(&what()));
        }
        let (number, rest) = self.rest.split_at(size);
        self.rest = rest;
        Ok(property.kind.read(number, self.header.coding == Coding::BigEndian))
    }

    fn word(&mut self, what: &dyn Fn() -> String) -> Result<f64, MeshError> {
        let start = self.rest.iter().position(|byte| !byte.is_ascii_whitespace());
        let (blank, rest) = self.rest.split_at(start.unwrap_or(self.rest.len()));
        self.n_lines += blank.split(|byte| *byte == b'\n').count() - 1;
        let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        let (word, rest) = rest.split_at(end);
        self.rest = rest;
        if word.is_empty() {
            return Err(self.truncated(&what()));
        }
        let word = String::from_utf8_lossy(word);
        word.parse().map_err(|_| {
            let start: String = word.chars().take(40).collect();
            self.wrong(&what(), &format!("{start:?}"))
        })
    }

    fn place(&self) -> Place {
        match self.header.coding {
            Coding::Text => Place::Line(self.n_lines),
            _ => Place::Byte(self.length - self.rest.len()),
        }
    }

    fn wrong(&self, expected: &str, got: &str) -> MeshError {
        let (path, place) = (self.path.into(), self.place());
        MeshError::Parse { path, place, expected: expected.into(), got: got.into() }
    }

    fn truncated(&self, expected: &str) -> MeshError {
        let (path, place) = (self.path.into(), self.place());
        MeshError::Truncated { path, place, expected: expected.into() }
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "the same bytes")]
mod tests {
    use super::*;
    use crate::mesh::Units;
    use std::fmt::Write as _;

    const HEADER: &str = "ply\nformat FORMAT 1.0\ncomment lengths in cm\nelement material 1\nproperty list uchar float knots\n\
        element vertex 4\nproperty float x\nproperty double y\nproperty short z\nproperty uchar red\nproperty float v_0\n\
        property float v_1\nproperty float v_2\nelement nothing 99999999999\nelement face 2\nproperty int region\n\
        property list ushort int vertex_indices\nproperty list int8 double uv\nend_header\n";
    const POINTS: [(f32, f64, i16, u8); 4] =
        [(0.0, 0.5, 0, 1), (1.5, 0.0, 0, 2), (1.5, 2.5, -3, 255), (0.0, 2.5, 0, 4)];

    /// The same mesh in one of the three codings, in which `order` writes a number of little-endian bytes.
    fn bytes(format: &str, order: fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
        let mut bytes = HEADER.replace("FORMAT", format).into_bytes();
        let mut put = |number: &[u8]| bytes.extend(order(number));
        put(&[1]);
        put(&7.0_f32.to_le_bytes());
        for (x, y, z, red) in POINTS {
            put(&x.to_le_bytes());
            put(&y.to_le_bytes());
            put(&z.to_le_bytes());
            put(&[red]);
            for v in [1.0_f32, 2.0, 3.0] {
                put(&v.to_le_bytes());
            }
        }
        for (region, corners) in [(5_i32, &[0_i32, 1, 2, 3][..]), (-6, &[0, 1, 3])] {
            put(&region.to_le_bytes());
            put(&(corners.len() as u16).to_le_bytes());
            for corner in corners {
                put(&corner.to_le_bytes());
            }
            put(&[2]);
            for uv in [0.25_f64, 0.5] {
                put(&uv.to_le_bytes());
            }
        }
        bytes
    }

    fn text() -> Vec<u8> {
        let mut text = HEADER.replace("FORMAT", "ascii") + "1 7\n";
        for (x, y, z, red) in POINTS {
            let _ = writeln!(text, "{x} {y} {z} {red} 1 2 3");
        }
        (text + "5 4 0 1 2 3 2 0.25 0.5\n-6 3 0 1 3 2 0.25 0.5\n").into_bytes()
    }

    fn parsed(bytes: &[u8]) -> Result<Content, String> {
        parse(Path::new("f.ply"), bytes).map_err(|error| error.to_string())
    }

    #[test]
    fn all_codings_read_the_same() {
        let little = bytes("binary_little_endian", <[u8]>::to_vec);
        let big = bytes("binary_big_endian", |number| number.iter().rev().copied().collect());
        for file in [text(), little, big] {
            let content = parsed(&file).unwrap();
            assert_eq!(content.vertices[2], [1.5, 2.5, -3.0]);
            assert_eq!(content.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 3]]);
            assert_eq!(content.point_data["red"].values(), [1.0, 2.0, 255.0, 4.0]);
            assert_eq!(content.point_data["v"].row(3), [1.0, 2.0, 3.0]);
            assert_eq!(content.cell_data["region"].values(), [5.0, 5.0, -6.0]);
            assert_eq!(content.units, Some(Units::Cm));
        }
    }

    #[test]
    fn mistakes_are_named() {
        let whole = String::from_utf8(text()).unwrap();
        let fails = |from: &str, to: &str| parsed(whole.replace(from, to).as_bytes()).unwrap_err();
        assert!(fails("vertex 4", "vertex four").contains("line 6: expected element NAME COUNT"));
        assert!(fails("double y", "double w").contains("expected properties x, y and z"));
        assert!(
            fails("1.5 0 0", "1.5 o 0").contains("line 22: expected y of vertex 1 of 4, got \"o\"")
        );
        assert!(fails("3 0 1 3 2", "-3 0 1 3 2").contains("expected the length of vertex_indices"));
        assert!(fails("3 0 1 3 2", "3 0 1 4 2").contains("names vertex 4"));
        assert!(
            fails("face 2", "face 3").contains("the file ends here, expected region of face 2")
        );
        assert!(fails("ply\n", "plx\n").contains("expected a first line \"ply\""));
        let binary = bytes("binary_little_endian", <[u8]>::to_vec);
        let cut = parsed(&binary[..binary.len() - 1]).unwrap_err();
        assert!(cut.contains("the file ends here, expected uv of face 1 of 2"), "{cut}");
    }
}
