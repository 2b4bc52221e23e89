//! MATLAB files of version 5: what `save` writes with `-v6` and `-v7`.
//!
//! A file is a list of elements, each with a type and a length. A matrix is an element that holds others:
//! its class, dimensions and name, then numbers, or the matrices of its cells or fields.
//!
//! # Source
//! MathWorks, "MAT-File Format".

use std::io::Read as _;

use flate2::read::ZlibDecoder;
use num_traits::ToPrimitive as _;

use super::{Found, Matrix};
use crate::import::ImportError;
use crate::mesh::Place;

/// What the compressed elements of a file may grow by, all together and in multiples of the file, and the size
/// they may have whatever they grow by, bytes.
#[derive(Clone, Copy, Debug)]
pub(in crate::import) struct Bounds {
    pub(in crate::import) growth: usize,
    pub(in crate::import) small: usize,
}

impl Bounds {
    /// Of the files of mapping systems: electrograms that are mostly empty grow by 100.
    pub(in crate::import) const DEFAULT: Self = Self { growth: 200, small: 1 << 20 };

    fn of(self, compressed: usize) -> usize {
        self.small.max(compressed.saturating_mul(self.growth))
    }
}

/// How deep structs may lie in each other.
const DEPTH: usize = 40;

/// A file with its compressed elements unpacked.
#[derive(Debug)]
pub(in crate::import) struct Mat {
    file: String,
    is_big_endian: bool,
    /// The contents of each variable's matrix.
    variables: Vec<Vec<u8>>,
}

/// Types of elements.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// Classes of matrices.
const CELL: u8 = 1;
const STRUCT: u8 = 2;
const OBJECT: u8 = 3;
const CHAR: u8 = 4;
const OPAQUE: u8 = 17;
const NUMBERS: std::ops::RangeInclusive<u8> = 6..=15;

impl Mat {
    pub(in crate::import) fn open(file: &str, bytes: &[u8]) -> Result<Self, ImportError> {
        let is_big_endian = match bytes.get(126..128) {
            Some(b"IM") => false,
            Some(b"MI") => true,
            _ => {
                return Err(wrong(
                    file,
                    126,
                    "`IM` or `MI`, as every MATLAB file has",
                    "other bytes",
                ));
            }
        };
        let mut mat = Self { file: file.into(), is_big_endian, variables: vec![] };
        let mut rest = Reader { bytes, at: 128, mat: &mat };
        let (mut variables, mut left) = (vec![], Bounds::DEFAULT.of(bytes.len()));
        while rest.at + 8 <= bytes.len() {
            let place = rest.at;
            let element = rest.element()?;
            match element.kind {
                MATRIX => variables.push(element.bytes.to_vec()),
                COMPRESSED => variables.extend(mat.unpacked(element.bytes, place, &mut left)?),
                _ => {}
            }
        }
        mat.variables = variables;
        Ok(mat)
    }

    /// The contents of the matrix in a compressed element; `left` is how many bytes all of them may still have, and
    /// falls.
    fn unpacked(
        &self,
        packed: &[u8],
        place: usize,
        left: &mut usize,
    ) -> Result<Option<Vec<u8>>, ImportError> {
        let mut bytes = vec![];
        let mut decoder = ZlibDecoder::new(packed).take(*left as u64 + 1);
        let done = decoder.read_to_end(&mut bytes);
        done.map_err(|e| wrong(&self.file, place, "a compressed variable", &e.to_string()))?;
        let Some(rest) = left.checked_sub(bytes.len()) else {
            let got = format!("more than {} times the size of the file", Bounds::DEFAULT.growth);
            return Err(wrong(&self.file, place, "variables of a mapping study", &got));
        };
        *left = rest;
        let mut inner = Reader { bytes: &bytes, at: 0, mat: self };
        let element = inner.element()?;
        Ok((element.kind == MATRIX).then(|| element.bytes.to_vec()))
    }

    pub(super) fn find(&self, path: &[&str]) -> Result<Option<Found>, ImportError> {
        let [variable, fields @ ..] = path else { return Ok(None) };
        for bytes in &self.variables {
            let head = Head::read(self, bytes)?;
            if head.name == *variable {
                return head.find(fields, DEPTH);
            }
        }
        Ok(None)
    }
}

fn wrong(file: &str, place: usize, expected: &str, got: &str) -> ImportError {
    ImportError::Parse {
        file: file.into(),
        place: Place::Byte(place),
        expected: expected.into(),
        got: got.into(),
        help: "the file is damaged or of another version; load it in MATLAB and save it with -v7",
    }
}

/// An element: its type and bytes.
#[derive(Clone, Copy, Debug)]
struct Element<'b> {
    kind: u32,
    bytes: &'b [u8],
}

struct Reader<'b> {
    bytes: &'b [u8],
    at: usize,
    mat: &'b Mat,
}

impl<'b> Reader<'b> {
    fn u32(&self, at: usize) -> Option<u32> {
        let bytes = self.bytes.get(at..at.checked_add(4)?)?.try_into().ok()?;
        let big = self.mat.is_big_endian;
        Some(if big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    /// The next element: a type, a length and the bytes, or all in eight bytes.
    fn element(&mut self) -> Result<Element<'b>, ImportError> {
        let place = self.at;
        let missing = || wrong(&self.mat.file, place, "an element of a matrix", "the end");
        let tag = self.u32(place).ok_or_else(missing)?;
        let (kind, length, begin, padded) = if tag >> 16 == 0 {
            let length = self.u32(place + 4).ok_or_else(missing)? as usize;
            // compressed elements follow each other without padding
            let is_padded = tag != COMPRESSED;
            let padded = if is_padded { length.next_multiple_of(8) } else { length };
            (tag, length, place + 8, padded)
        } else {
            (tag & 0xffff, (tag >> 16) as usize, place + 4, 4)
        };
        let end = begin.checked_add(length).filter(|end| *end <= self.bytes.len());
        let bytes = end.and_then(|end| self.bytes.get(begin..end)).ok_or_else(missing)?;
        self.at = begin.saturating_add(padded).min(self.bytes.len());
        Ok(Element { kind, bytes })
    }
}

/// The beginning of a matrix, and a reader that stands behind it.
struct Head<'b> {
    class: u8,
    dimensions: Vec<usize>,
    name: String,
    rest: Reader<'b>,
}

impl<'b> Head<'b> {
    fn read(mat: &'b Mat, bytes: &'b [u8]) -> Result<Self, ImportError> {
        let mut rest = Reader { bytes, at: 0, mat };
        if bytes.is_empty() {
            return Ok(Self { class: 0, dimensions: vec![0], name: String::new(), rest });
        }
        let flags = rest.element()?;
        let word = flags.bytes.first_chunk::<4>().copied().unwrap_or_default();
        let word =
            if mat.is_big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) };
        let class = (word & 0xff) as u8;
        // an object of the newer kind has no dimensions
        let dimensions = if class == OPAQUE { vec![1] } else { rest.element()?.dimensions(mat) };
        let name = rest.element()?.text();
        Ok(Self { class, dimensions, name, rest })
    }

    fn n(&self) -> usize {
        self.dimensions.iter().try_fold(1_usize, |n, d| n.checked_mul(*d)).unwrap_or(usize::MAX)
    }

    /// What stands at a path of fields below this matrix.
    fn find(mut self, fields: &[&str], depth: usize) -> Result<Option<Found>, ImportError> {
        match (fields, self.class) {
            ([], STRUCT) => Ok(Some(Found::Struct)),
            ([], CELL) => Ok(Some(Found::Texts(self.texts(DEPTH)?))),
            ([], class) if NUMBERS.contains(&class) => {
                self.matrix().map(|m| Some(Found::Matrix(m)))
            }
            (_, OBJECT) => Ok(Some(Found::Object(self.rest.element()?.text()))),
            (_, OPAQUE) => {
                self.rest.element()?; // the name of the class system
                Ok(Some(Found::Object(self.rest.element()?.text())))
            }
            ([], _) => Ok(Some(Found::Other)),
            ([first, others @ ..], STRUCT) if depth > 0 && self.n() >= 1 => {
                self.field(first)?.map_or(Ok(None), |head| head.find(others, depth - 1))
            }
            _ => Ok(None),
        }
    }

    /// The matrix of a field of the struct's first element.
    fn field(mut self, name: &str) -> Result<Option<Self>, ImportError> {
        let mat = self.rest.mat;
        let length = self.rest.element()?.numbers(mat);
        let names = self.rest.element()?.bytes;
        let length = length.first().map_or(0, |length| *length as usize);
        if length == 0 {
            return Ok(None);
        }
        for own in names.chunks(length) {
            let field = self.rest.element()?;
            if field.kind == MATRIX && text(own) == name {
                return Head::read(mat, field.bytes).map(Some);
            }
        }
        Ok(None)
    }

    /// The text of each cell; of several texts within one, all of them.
    fn texts(mut self, depth: usize) -> Result<Vec<String>, ImportError> {
        let (n, mat) = (self.n(), self.rest.mat);
        let mut texts = vec![];
        while texts.len() < n && self.rest.at < self.rest.bytes.len() {
            let cell = self.rest.element()?;
            let is_matrix = cell.kind == MATRIX;
            texts.push(if is_matrix {
                Head::read(mat, cell.bytes)?.text(depth)?
            } else {
                String::new()
            });
        }
        Ok(texts)
    }

    /// What is written in a cell; nothing if it holds no text.
    fn text(mut self, depth: usize) -> Result<String, ImportError> {
        match self.class {
            CHAR => Ok(self.rest.element()?.characters(self.rest.mat)),
            CELL if depth > 0 => {
                let mut texts = self.texts(depth - 1)?;
                texts.retain(|text| !text.is_empty());
                Ok(texts.join(" + "))
            }
            _ => Ok(String::new()),
        }
    }

    fn matrix(mut self) -> Result<Matrix, ImportError> {
        let n = self.n();
        let rows = self.dimensions.first().copied().unwrap_or(0);
        let place = self.rest.at;
        let values = if n == 0 { vec![] } else { self.rest.element()?.numbers(self.rest.mat) };
        if values.len() != n {
            let (expected, got) = (format!("{n} numbers"), format!("{} of them", values.len()));
            return Err(wrong(&self.rest.mat.file, place, &expected, &got));
        }
        Ok(Matrix { rows, values })
    }
}

impl Element<'_> {
    fn text(&self) -> String {
        text(self.bytes)
    }

    /// Text in UTF-8, or in UTF-16 with or without MATLAB's name for it.
    fn characters(&self, mat: &Mat) -> String {
        let text = match self.kind {
            4 | 17 => {
                let read = if mat.is_big_endian { u16::from_be_bytes } else { u16::from_le_bytes };
                let (units, _) = self.bytes.as_chunks::<2>();
                char::decode_utf16(units.iter().map(|unit| read(*unit)))
                    .map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER))
                    .collect()
            }
            _ => self.text(),
        };
        text.trim().to_owned()
    }

    fn dimensions(&self, mat: &Mat) -> Vec<usize> {
        self.numbers(mat).iter().map(|x| *x as usize).collect()
    }

    /// The numbers of whatever type; none of a type that is no number.
    fn numbers(&self, mat: &Mat) -> Vec<f64> {
        macro_rules! all {
            ($t:ty) => {{
                let (chunks, _) = self.bytes.as_chunks::<{ size_of::<$t>() }>();
                let read =
                    if mat.is_big_endian { <$t>::from_be_bytes } else { <$t>::from_le_bytes };
                chunks.iter().filter_map(|bytes| read(*bytes).to_f64()).collect()
            }};
        }
        match self.kind {
            1 => all!(i8),
            2 => all!(u8),
            3 => all!(i16),
            4 => all!(u16),
            5 => all!(i32),
            6 => all!(u32),
            7 => all!(f32),
            9 => all!(f64),
            12 => all!(i64),
            13 => all!(u64),
            _ => vec![],
        }
    }
}

/// Text up to the first zero.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}
