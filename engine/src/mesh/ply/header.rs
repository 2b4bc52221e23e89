//! The header of a .ply file: its elements and their properties.

use crate::mesh::text::Lines;
use crate::mesh::{MeshError, Units};
use crate::store::Kind;
use std::path::Path;

/// How the numbers are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coding {
    Text,
    LittleEndian,
    BigEndian,
}

/// A number of an element, or a list of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
    /// The type of a list's length.
    pub(super) count: Option<Kind>,
}

/// `n` elements of a kind: vertices, faces and others.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) n: usize,
    pub(super) properties: Vec<Property>,
}

/// What the lines up to `end_header` say.
#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) coding: Coding,
    pub(super) elements: Vec<Element>,
    pub(super) units: Option<Units>,
    /// Bytes and lines of the header.
    pub(super) length: usize,
    pub(super) n_lines: usize,
}

/// Reads the header.
///
/// # Errors
/// `Parse`, `Truncated`.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Header, MeshError> {
    let mut lines = Lines::new(path, bytes);
    let first = lines.expect("a first line \"ply\"")?;
    if first != "ply" {
        return Err(lines.wrong("a first line \"ply\"", &first));
    }
    let (mut coding, mut units, mut elements) = (None, None, Vec::<Element>::new());
    loop {
        let line = lines.expect("end_header")?;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words.as_slice() {
            ["format", name, _] => coding = Some(coding_of(&lines, name)?),
            ["comment" | "obj_info", ..] => units = units.or_else(|| Units::in_comment(&line)),
            ["element", name, n] => {
                let n = n.parse().map_err(|_| lines.wrong("element NAME COUNT", &line))?;
                elements.push(Element { name: (*name).to_owned(), n, properties: vec![] });
            }
            ["property", rest @ ..] => {
                let property = property(rest).ok_or_else(|| {
                    lines.wrong("property TYPE NAME or property list TYPE TYPE NAME", &line)
                })?;
                let element = elements.last_mut();
                let element = element.ok_or_else(|| lines.wrong("an element first", &line))?;
                element.properties.push(property);
            }
            ["end_header"] => break,
            _ => return Err(lines.wrong("a line of a PLY header", &line)),
        }
    }
    let coding = coding.ok_or_else(|| lines.wrong("a line \"format …\" in the header", "none"))?;
    let (length, n_lines) = lines.position(bytes.len());
    Ok(Header { coding, elements, units, length, n_lines })
}

fn coding_of(lines: &Lines, name: &str) -> Result<Coding, MeshError> {
    match name {
        "ascii" => Ok(Coding::Text),
        "binary_little_endian" => Ok(Coding::LittleEndian),
        "binary_big_endian" => Ok(Coding::BigEndian),
        _ => Err(lines.wrong("ascii, binary_little_endian or binary_big_endian", name)),
    }
}

fn property(words: &[&str]) -> Option<Property> {
    let kind = |name: &str| {
        Some(match name {
            "char" | "int8" => Kind::I8,
            "uchar" | "uint8" => Kind::U8,
            "short" | "int16" => Kind::I16,
            "ushort" | "uint16" => Kind::U16,
            "int" | "int32" => Kind::I32,
            "uint" | "uint32" => Kind::U32,
            "int64" => Kind::I64,
            "uint64" => Kind::U64,
            "float" | "float32" => Kind::F32,
            "double" | "float64" => Kind::F64,
            _ => return None,
        })
    };
    let property = match words {
        ["list", count, of, name] => {
            let count = kind(count).filter(|kind| !matches!(kind, Kind::F32 | Kind::F64))?;
            Property { name: (*name).to_owned(), kind: kind(of)?, count: Some(count) }
        }
        [of, name] => Property { name: (*name).to_owned(), kind: kind(of)?, count: None },
        _ => return None,
    };
    Some(property)
}
