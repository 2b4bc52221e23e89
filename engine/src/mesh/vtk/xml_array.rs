//! The arrays of an XML file: as text, inline, or appended behind the document.

use super::stream::{Bytes, Packing};
use super::types::named;
use crate::mesh::{MeshError, Place};
use crate::store::Kind;
use roxmltree::{Document, Node};
use std::cell::Cell;
use std::path::Path;

/// How many bytes an honest file inflates to, for each of its own. Coordinates, corners and offsets of real surfaces
/// come to 2 to 5; a file with fifty arrays of one repeated number beside them comes to 32.
const MOST_INFLATED: usize = 32;

/// What stands behind the document.
#[derive(Clone, Copy, Debug)]
pub(super) enum Appended<'a> {
    None,
    Raw(&'a [u8]),
    Base64(&'a [u8]),
}

/// Reads the elements of a document.
pub(super) struct Reader<'a> {
    path: &'a Path,
    document: &'a Document<'a>,
    appended: Appended<'a>,
    packing: Packing,
    /// How many bytes all arrays may still have: of a file that is not compressed as many as the file, for several arrays
    /// may name the same bytes.
    budget: Cell<usize>,
}

impl<'a> Reader<'a> {
    /// A reader of `document`, the text of a file of `n_bytes` bytes.
    ///
    /// # Errors
    /// `Unsupported` for another compressor than zlib's.
    pub(super) fn new(
        path: &'a Path,
        document: &'a Document<'a>,
        appended: Appended<'a>,
        n_bytes: usize,
    ) -> Result<Self, MeshError> {
        let root = document.root_element();
        let compressor = root.attribute("compressor");
        if let Some(other) = compressor.filter(|name| *name != "vtkZLibDataCompressor") {
            return Err(MeshError::Unsupported {
                path: path.into(),
                what: format!(
                    "its arrays are compressed by {other}, expected none or vtkZLibDataCompressor"
                ),
                help: "save the mesh with zlib compression or none",
            });
        }
        let packing = Packing {
            header: if root.attribute("header_type") == Some("UInt64") { 8 } else { 4 },
            is_big_endian: root.attribute("byte_order") == Some("BigEndian"),
            is_zlib: compressor.is_some(),
        };
        let growth = if packing.is_zlib { MOST_INFLATED } else { 1 };
        let budget = Cell::new(n_bytes.saturating_mul(growth).saturating_add(1 << 16));
        Ok(Self { path, document, appended, packing, budget })
    }

    /// The file.
    pub(super) fn path(&self) -> &'a Path {
        self.path
    }

    /// The error that `node` is not what it should be.
    pub(super) fn wrong(&self, node: Node, expected: &str, got: impl Into<String>) -> MeshError {
        let line = self.document.text_pos_at(node.range().start).row as usize;
        let (expected, place) = (expected.into(), Place::Line(line));
        MeshError::Parse { path: self.path.into(), place, expected, got: got.into() }
    }

    /// The child element of that name, the first if there are several.
    pub(super) fn child(&self, node: Node<'a, 'a>, name: &str) -> Result<Node<'a, 'a>, MeshError> {
        let found = node.children().find(|n| n.has_tag_name(name));
        found.ok_or_else(|| self.wrong(node, &format!("<{name}>"), "none"))
    }

    /// An attribute that is a count; `None` without it.
    pub(super) fn count(&self, node: Node, name: &str) -> Result<Option<usize>, MeshError> {
        let parsed = node.attribute(name).map(|text| {
            let wrong = |_| self.wrong(node, &format!("a count as {name}"), format!("{text:?}"));
            text.trim().parse().map_err(wrong)
        });
        parsed.transpose()
    }

    /// Refuses a piece whose attribute `name`, if it has one, is another number than `n`.
    pub(super) fn is_count(&self, piece: Node, name: &str, n: usize) -> Result<(), MeshError> {
        match self.count(piece, name)? {
            Some(told) if told != n => {
                Err(self.wrong(piece, &format!("{told} of them, as {name} says"), n.to_string()))
            }
            _ => Ok(()),
        }
    }

    /// The array of that name among the children of `node`.
    pub(super) fn named(&self, node: Node<'a, 'a>, name: &str) -> Result<Vec<f64>, MeshError> {
        let found = node.children().find(|n| n.attribute("Name") == Some(name));
        self.numbers(found.ok_or_else(|| self.wrong(node, &format!("an array {name}"), "none"))?)
    }

    /// The type of a `DataArray`'s numbers.
    fn kind(&self, node: Node) -> Result<Kind, MeshError> {
        let name = node.attribute("type").unwrap_or("none").to_lowercase();
        let kind = match name.as_str() {
            "float64" => Some(Kind::F64),
            "float32" => Some(Kind::F32),
            integer => named(&format!("vtktype{integer}")),
        };
        kind.ok_or_else(|| self.wrong(node, "a number type like Float64 or Int64", name))
    }

    /// The numbers of a `DataArray`.
    pub(super) fn numbers(&self, node: Node) -> Result<Vec<f64>, MeshError> {
        match node.attribute("format").unwrap_or("ascii") {
            "ascii" => {
                let words = text(node).flat_map(str::split_whitespace);
                let number = |word: &str| {
                    let parsed = word.parse();
                    parsed.map_err(|_| self.wrong(node, "a number", format!("{word:?}")))
                };
                words.map(number).collect()
            }
            "binary" => {
                let joined: String = text(node).collect();
                self.unpack(node, Bytes::base64(joined.as_bytes()))
            }
            "appended" => self.unpack(node, self.appended_at(node)?),
            other => {
                Err(self.wrong(node, "format ascii, binary or appended", format!("{other:?}")))
            }
        }
    }

    /// What is appended, from the array's offset on.
    fn appended_at(&self, node: Node) -> Result<Bytes<'a>, MeshError> {
        let offset = self.count(node, "offset")?;
        let offset = offset.ok_or_else(|| self.wrong(node, "an attribute offset", "none"))?;
        let from = |bytes: &'a [u8]| {
            let got = || format!("offset {offset}, {} bytes are there", bytes.len());
            bytes.get(offset..).ok_or_else(|| self.wrong(node, "an offset inside the data", got()))
        };
        match self.appended {
            Appended::Raw(bytes) => Ok(Bytes::Raw(from(bytes)?)),
            Appended::Base64(bytes) => Ok(Bytes::base64(from(bytes)?)),
            Appended::None => Err(self.wrong(node, "an element <AppendedData>", "none")),
        }
    }

    fn unpack(&self, node: Node, bytes: Bytes) -> Result<Vec<f64>, MeshError> {
        let kind = self.kind(node)?;
        let mut budget = self.budget.get();
        let unpacked = self.packing.unpack(bytes, &mut budget);
        self.budget.set(budget);
        let bytes =
            unpacked.map_err(|got| self.wrong(node, "an array's length and numbers", got))?;
        if !bytes.len().is_multiple_of(kind.size()) {
            let got = format!("{} bytes", bytes.len());
            return Err(self.wrong(node, &format!("numbers of {} bytes", kind.size()), got));
        }
        let is_big_endian = self.packing.is_big_endian;
        Ok(bytes.chunks_exact(kind.size()).map(|number| kind.read(number, is_big_endian)).collect())
    }
}

/// The texts inside an element: a comment may part them.
fn text<'a>(node: Node<'a, '_>) -> impl Iterator<Item = &'a str> {
    node.children().filter_map(|child| child.text().filter(|_| child.is_text()))
}
