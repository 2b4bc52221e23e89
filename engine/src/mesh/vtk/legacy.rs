//! The legacy VTK format, versions 2.0 to 5.1: header, geometry and attributes.

use super::super::content::{self, Content};
use super::super::{Array, Data, MeshError, Units};
use super::attributes::{self, count, skip_metadata, word};
use super::cells::{Cells, add_typed};
use super::scanner::Scanner;
use super::types::named;
use crate::store::Kind;
use std::path::Path;

/// Reads `bytes`, the content of `path`.
///
/// # Errors
/// `Parse` and `Truncated` with the place, `NotATriangle`, and `IndexOutOfRange`.
pub(in super::super) fn parse(path: &Path, bytes: &[u8]) -> Result<Content, MeshError> {
    let mut scan = Scanner::new(path, bytes);
    let units = read_header(&mut scan)?;
    let mut parser = Parser::default();
    while let Some(words) = scan.words() {
        parser.section(&mut scan, &words)?;
    }
    Ok(Content { units, ..parser.finish(&scan)? })
}

/// Reads the first three lines; the title may name the unit.
fn read_header(scan: &mut Scanner) -> Result<Option<Units>, MeshError> {
    const FIRST: &str = "a first line \"# vtk DataFile Version 2.0\" (up to 5.1)";
    let first = scan.line().ok_or_else(|| scan.truncated(FIRST))?;
    let version = first.trim().strip_prefix("# vtk DataFile Version ");
    let major = version.and_then(|v| v.split('.').next()?.trim().parse::<u32>().ok());
    if !major.is_some_and(|major| (1..=5).contains(&major)) {
        return Err(scan.error(FIRST, quoted(&first)));
    }
    let title = scan.line().ok_or_else(|| scan.truncated("a title line"))?;
    let units = Units::in_comment(&title);
    let encoding = scan.line().ok_or_else(|| scan.truncated("ASCII or BINARY"))?;
    match encoding.trim().to_ascii_uppercase().as_str() {
        "ASCII" => Ok(units),
        "BINARY" => {
            scan.is_binary = true;
            Ok(units)
        }
        _ => Err(scan.error("ASCII or BINARY", quoted(&encoding))),
    }
}

/// The start of a line that was not understood: it may be a page of bytes.
fn quoted(line: &str) -> String {
    let start: String = line.chars().take(40).collect();
    format!("{start:?}")
}

/// Which elements the attributes that follow belong to.
#[derive(Clone, Copy, Debug, Default)]
enum Target {
    /// None yet: a FIELD here describes the file.
    #[default]
    File,
    Points,
    Cells(usize),
}

#[derive(Debug, Default)]
struct Parser {
    dataset: String,
    vertices: Option<Vec<[f64; 3]>>,
    /// `POLYGONS` or `CELLS`.
    cells: Option<Cells>,
    cell_types: Vec<i64>,
    strips: Option<Cells>,
    /// `VERTICES` and `LINES`, which attributes of cells count first.
    n_others: usize,
    target: Target,
    point_data: Data,
    cell_data: Data,
}

impl Parser {
    fn section(&mut self, scan: &mut Scanner, words: &[String]) -> Result<(), MeshError> {
        let keyword = words[0].to_ascii_uppercase();
        self.only_once(scan, &keyword)?;
        match keyword.as_str() {
            "DATASET" => self.dataset(scan, words)?,
            "METADATA" => skip_metadata(scan),
            "POINTS" => self.points(scan, words)?,
            "POLYGONS" | "CELLS" => self.cells = Some(read_cells(scan, words)?),
            "TRIANGLE_STRIPS" => self.strips = Some(read_cells(scan, words)?),
            "VERTICES" | "LINES" => self.n_others += read_cells(scan, words)?.len(),
            "CELL_TYPES" => {
                let n = count(scan, words, 1)?;
                self.cell_types = scan.integers(n, Kind::I32, "CELL_TYPES")?;
            }
            "POINT_DATA" => self.start_point_data(scan, words)?,
            "CELL_DATA" => self.target = Target::Cells(count(scan, words, 1)?),
            _ => self.attribute(scan, words)?,
        }
        Ok(())
    }

    /// Refuses a second section of geometry: it would take the place of the first.
    fn only_once(&self, scan: &Scanner, keyword: &str) -> Result<(), MeshError> {
        let is_there = match keyword {
            "POINTS" => self.vertices.is_some(),
            "POLYGONS" | "CELLS" => self.cells.is_some(),
            "TRIANGLE_STRIPS" => self.strips.is_some(),
            "CELL_TYPES" => !self.cell_types.is_empty(),
            _ => false,
        };
        if is_there {
            return Err(scan.error("one such section", format!("{keyword} a second time")));
        }
        Ok(())
    }

    fn dataset(&mut self, scan: &Scanner, words: &[String]) -> Result<(), MeshError> {
        self.dataset = word(scan, words, 1)?.to_ascii_uppercase();
        if matches!(self.dataset.as_str(), "POLYDATA" | "UNSTRUCTURED_GRID") {
            Ok(())
        } else {
            Err(scan
                .error("DATASET POLYDATA or DATASET UNSTRUCTURED_GRID", quoted(&words.join(" "))))
        }
    }

    fn points(&mut self, scan: &mut Scanner, words: &[String]) -> Result<(), MeshError> {
        let (n, name) = (count(scan, words, 1)?, word(scan, words, 2)?);
        let Some(kind) = named(&name) else {
            return Err(scan.error("POINTS n float or POINTS n double", quoted(&words.join(" "))));
        };
        let coordinates = scan.reals(n.saturating_mul(3), kind, "POINTS")?;
        self.vertices = Some(coordinates.as_chunks().0.to_vec());
        Ok(())
    }

    fn start_point_data(&mut self, scan: &Scanner, words: &[String]) -> Result<(), MeshError> {
        let (n, n_vertices) = (count(scan, words, 1)?, self.vertices.as_ref().map_or(0, Vec::len));
        if n != n_vertices {
            return Err(
                scan.error(&format!("POINT_DATA {n_vertices}, one per point"), n.to_string())
            );
        }
        self.target = Target::Points;
        Ok(())
    }

    fn attribute(&mut self, scan: &mut Scanner, words: &[String]) -> Result<(), MeshError> {
        let n_vertices = self.vertices.as_ref().map_or(0, Vec::len);
        let arrays = match self.target {
            Target::File if words[0].eq_ignore_ascii_case("FIELD") => {
                Some(attributes::field(scan, words))
            }
            Target::File => None,
            Target::Points => attributes::read(scan, words, n_vertices),
            Target::Cells(n) => attributes::read(scan, words, n),
        };
        let Some(arrays) = arrays else {
            return Err(scan.error(
                "a section such as POINTS, POLYGONS, CELLS, POINT_DATA or SCALARS",
                quoted(&words.join(" ")),
            ));
        };
        let (data, n) = match self.target {
            Target::File => return arrays.map(drop),
            Target::Points => (&mut self.point_data, n_vertices),
            Target::Cells(n) => (&mut self.cell_data, n),
        };
        // Arrays of text were skipped: they have no numbers.
        let arrays = arrays?.into_iter();
        let whole = arrays.filter(|a| {
            a.n_components > 0 && n.checked_mul(a.n_components) == Some(a.values.len()) && n > 0
        });
        data.extend(whole.map(|a| (a.name, Array::new(a.n_components, a.values))));
        Ok(())
    }

    fn finish(self, scan: &Scanner) -> Result<Content, MeshError> {
        if self.dataset.is_empty() {
            return Err(scan.truncated("a DATASET line"));
        }
        let vertices = self.vertices.ok_or_else(|| scan.truncated("a POINTS section"))?;
        let cells = self.cells.unwrap_or_default();
        let mut all = content::Cells::new(vertices.len());
        if self.dataset == "UNSTRUCTURED_GRID" {
            if self.cell_types.len() != cells.len() {
                let expected = format!("CELL_TYPES {}, one per cell", cells.len());
                return Err(scan.error(&expected, self.cell_types.len().to_string()));
            }
            for (corners, kind) in cells.iter().zip(self.cell_types) {
                add_typed(&mut all, kind, corners, scan.path())?;
            }
        } else {
            all.skip(self.n_others);
            cells.iter().try_for_each(|corners| all.polygon(corners))?;
            self.strips.iter().flat_map(Cells::iter).try_for_each(|strip| all.strip(strip))?;
        }
        Ok(all.into_content(vertices, self.point_data, self.cell_data))
    }
}

fn read_cells(scan: &mut Scanner, words: &[String]) -> Result<Cells, MeshError> {
    let (first, second) = (count(scan, words, 1)?, count(scan, words, 2)?);
    Cells::read(scan, &words[0], first, second)
}
