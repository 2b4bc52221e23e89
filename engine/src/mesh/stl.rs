//! Stereolithography, .stl: triangles with corners of their own, as text or bytes.
//!
//! Corners at the same place become one vertex; vertices are numbered as they first occur, as VTK does.

use super::bytes::Encoding;
use super::content::{Cells, Content};
use super::geometry::Geometry;
use super::text::Lines;
use super::{Data, MeshError, Place, Units, area_vector, join, vector};
use std::io::Write as _;
use std::path::Path;

/// Bytes of the title of a binary file, of its count, and of a triangle.
const TITLE: usize = 80;
const HEADER: usize = 84;
const FACET: usize = 50;

/// Reads `bytes`, the content of `path`.
///
/// # Errors
/// `Parse` and `Truncated` with the place.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Content, MeshError> {
    let announced = bytes.get(TITLE..HEADER).map(|count| {
        let count = count.iter().rev().fold(0, |sum, byte| sum << 8 | usize::from(*byte));
        HEADER + FACET * count
    });
    // A binary file may begin with "solid" too, so that its length decides.
    let is_binary = announced == Some(bytes.len())
        || !bytes.trim_ascii_start().get(..5).is_some_and(|b| b.eq_ignore_ascii_case(b"solid"));
    let (corners, title) = if is_binary {
        (binary(path, bytes, announced)?, String::from_utf8_lossy(&bytes[..TITLE]))
    } else {
        let end = bytes.iter().position(|byte| *byte == b'\n').unwrap_or(bytes.len());
        (text(path, bytes)?, String::from_utf8_lossy(&bytes[..end]))
    };
    Ok(Content { units: Units::in_comment(&title.replace('\0', " ")), ..welded(&corners)? })
}

fn binary(path: &Path, bytes: &[u8], announced: Option<usize>) -> Result<Vec<[f64; 3]>, MeshError> {
    let Some(end) = announced.filter(|end| *end <= bytes.len()) else {
        return Err(MeshError::Truncated {
            path: path.into(),
            place: Place::Byte(bytes.len()),
            expected: match announced {
                Some(end) => format!("{end} bytes, as the count of triangles says"),
                None => "an STL file, \"solid\" and text or 84 bytes and more".into(),
            },
        });
    };
    let facets = bytes[HEADER..end].chunks_exact(FACET);
    // The first three numbers are the normal, which the corners tell too.
    let corners = facets.flat_map(|facet| facet[12..48].chunks_exact(12));
    let point = |corner: &[u8]| {
        let (numbers, _) = corner.as_chunks::<4>();
        std::array::from_fn(|k| f64::from(f32::from_le_bytes(numbers[k])))
    };
    Ok(corners.map(point).collect())
}

fn text(path: &Path, bytes: &[u8]) -> Result<Vec<[f64; 3]>, MeshError> {
    const WORDS: &str = "solid, facet, outer loop, vertex, endloop, endfacet or endsolid";
    let mut lines = Lines::new(path, bytes);
    let (mut corners, mut is_open) = (vec![], false);
    while let Some(line) = lines.next() {
        let mut words = line.split_ascii_whitespace();
        match words.next().unwrap_or_default().to_ascii_lowercase().as_str() {
            "vertex" => corners.push(lines.point(&mut words)?),
            "endfacet" if corners.len() % 3 != 0 => {
                return Err(lines.wrong("three vertices in each facet", &line));
            }
            "solid" => is_open = true,
            "endsolid" => is_open = false,
            "facet" | "outer" | "endloop" | "endfacet" => {}
            _ => return Err(lines.wrong(WORDS, &line)),
        }
    }
    if is_open || corners.len() % 3 != 0 {
        lines.expect("endsolid")?;
    }
    Ok(corners)
}

fn welded(corners: &[[f64; 3]]) -> Result<Content, MeshError> {
    let first = join::equal(corners);
    let (mut vertices, mut number) = (vec![], vec![0_i64; corners.len()]);
    for (i, corner) in corners.iter().enumerate() {
        if first[i] as usize == i {
            number[i] = vertices.len() as i64;
            vertices.push(*corner);
        } else {
            number[i] = number[first[i] as usize];
        }
    }
    let mut cells = Cells::new(vertices.len());
    number.chunks_exact(3).try_for_each(|triangle| cells.polygon(triangle))?;
    Ok(cells.into_content(vertices, Data::new(), []))
}

/// The file of a surface, without its arrays; bytes have single precision.
pub(super) fn written(geometry: &Geometry, encoding: Encoding) -> Vec<u8> {
    let facets = geometry.triangles.iter().map(|t| {
        let corners = t.map(|v| geometry.vertices[v as usize]);
        let normal = area_vector(corners.map(vector));
        let unit = if normal.norm() > 0.0 { normal.normalize() } else { normal };
        (<[f64; 3]>::from(unit), corners)
    });
    if encoding == Encoding::Ascii {
        return as_text(facets);
    }
    let mut bytes = [b' '; TITLE].to_vec();
    let title = b"lengths in mm";
    bytes[..title.len()].copy_from_slice(title);
    bytes.extend((geometry.triangles.len() as u32).to_le_bytes());
    for (normal, corners) in facets {
        let numbers = normal.iter().chain(corners.iter().flatten());
        bytes.extend(numbers.flat_map(|x| (*x as f32).to_le_bytes()));
        bytes.extend([0, 0]);
    }
    bytes
}

fn as_text(facets: impl Iterator<Item = ([f64; 3], [[f64; 3]; 3])>) -> Vec<u8> {
    let mut text = b"solid lengths in mm\n".to_vec();
    for ([x, y, z], corners) in facets {
        let _ = writeln!(text, "facet normal {x} {y} {z}\nouter loop");
        for [x, y, z] in corners {
            let _ = writeln!(text, "vertex {x} {y} {z}");
        }
        let _ = writeln!(text, "endloop\nendfacet");
    }
    text.extend(b"endsolid lengths in mm\n");
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const VERTICES: [[f64; 3]; 4] = [[0.0; 3], [0.5, 0.0, 0.0], [0.5, 0.25, 0.0], [0.0, 0.25, 0.0]];

    fn square() -> Geometry<'static> {
        let triangles = &[[0, 1, 2], [0, 2, 3]];
        Geometry { vertices: &VERTICES, triangles, point_data: vec![], cell_data: vec![] }
    }

    fn parsed(bytes: &[u8]) -> Result<Content, String> {
        parse(Path::new("f.stl"), bytes).map_err(|error| error.to_string())
    }

    #[test]
    fn both_kinds_are_welded_and_a_binary_solid_is_known_by_its_length() {
        for encoding in [Encoding::Ascii, Encoding::Binary] {
            let mut bytes = written(&square(), encoding);
            for title in [b"lengths in mm", b"solid in mmmm"] {
                if encoding == Encoding::Binary {
                    bytes[..title.len()].copy_from_slice(title);
                }
                let content = parsed(&bytes).unwrap();
                assert_eq!(
                    (&content.vertices[..], &content.triangles[..]),
                    (&VERTICES[..], &[[0, 1, 2], [0, 2, 3]][..])
                );
            }
        }
        assert_eq!(parsed(&written(&square(), Encoding::Ascii)).unwrap().units, Some(Units::Mm));
    }

    #[test]
    fn mistakes_are_named() {
        let bytes = written(&square(), Encoding::Binary);
        assert!(
            parsed(&bytes[..180])
                .unwrap_err()
                .contains("byte 180: the file ends here, expected 184 bytes")
        );
        assert!(parsed(b"hello").unwrap_err().contains("expected an STL file"));
        let text = String::from_utf8(written(&square(), Encoding::Ascii)).unwrap();
        assert!(
            parsed(text.replacen("vertex 0 0 0\n", "", 1).as_bytes())
                .unwrap_err()
                .contains("line 7: expected three vertices")
        );
        assert!(
            parsed(text.replacen("vertex 0 0 0", "vertex 0 0", 1).as_bytes())
                .unwrap_err()
                .contains("line 4: expected three coordinates")
        );
        assert!(
            parsed(text.replace("endsolid lengths in mm\n", "").as_bytes())
                .unwrap_err()
                .contains("expected endsolid")
        );
    }
}
