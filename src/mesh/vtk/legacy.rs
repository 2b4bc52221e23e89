//! The legacy VTK format, versions 2.0 to 5.1: header, geometry and attributes.

use super::super::{MeshError, tri_mesh};
use super::attributes::{self, Array, count, skip_metadata, word};
use super::cells::Cells;
use super::scanner::Scanner;
use super::types::Kind;
use std::collections::BTreeMap;
use std::path::Path;

/// What a file holds, in its own unit, not yet checked to be a surface.
#[derive(Debug, Default)]
pub(in super::super) struct Content {
    /// Coordinates.
    pub(in super::super) vertices: Vec<[f64; 3]>,
    /// Triangles; every index exists.
    pub(in super::super) triangles: Vec<[u32; 3]>,
    /// One value per vertex; an array of several components is split into `name_0`, `name_1`, ….
    pub(in super::super) point_data: BTreeMap<String, Vec<f64>>,
}

/// Reads `bytes`, the content of `path`.
///
/// # Errors
/// `Parse` and `Truncated` with the place, `NotATriangle`, and `IndexOutOfRange`.
pub(in super::super) fn parse(path: &Path, bytes: &[u8]) -> Result<Content, MeshError> {
    let mut scan = Scanner::new(path, bytes);
    read_header(&mut scan)?;
    let mut parser = Parser::default();
    while let Some(words) = scan.words() {
        parser.section(&mut scan, &words)?;
    }
    parser.finish(&scan)
}

fn read_header(scan: &mut Scanner) -> Result<(), MeshError> {
    const FIRST: &str = "a first line \"# vtk DataFile Version 2.0\" (up to 5.1)";
    let first = scan.line().ok_or_else(|| scan.truncated(FIRST))?;
    let version = first.trim().strip_prefix("# vtk DataFile Version ");
    let major = version.and_then(|v| v.split('.').next()?.trim().parse::<u32>().ok());
    if !major.is_some_and(|major| (1..=5).contains(&major)) {
        return Err(scan.error(FIRST, quoted(&first)));
    }
    scan.line().ok_or_else(|| scan.truncated("a title line"))?;
    let encoding = scan.line().ok_or_else(|| scan.truncated("ASCII or BINARY"))?;
    match encoding.trim().to_ascii_uppercase().as_str() {
        "ASCII" => Ok(()),
        "BINARY" => {
            scan.is_binary = true;
            Ok(())
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
    cells: Option<Cells>,
    cell_types: Vec<i64>,
    strips: Option<Cells>,
    target: Target,
    point_data: BTreeMap<String, Vec<f64>>,
}

impl Parser {
    fn section(&mut self, scan: &mut Scanner, words: &[String]) -> Result<(), MeshError> {
        let keyword = words[0].to_ascii_uppercase();
        match keyword.as_str() {
            "DATASET" => self.dataset(scan, words)?,
            "METADATA" => skip_metadata(scan),
            "POINTS" => self.points(scan, words)?,
            "POLYGONS" | "CELLS" => self.cells = Some(read_cells(scan, words)?),
            "TRIANGLE_STRIPS" => self.strips = Some(read_cells(scan, words)?),
            "VERTICES" | "LINES" => drop(read_cells(scan, words)?),
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
        let Some(kind) = Kind::named(&name) else {
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
        let arrays = arrays?;
        if matches!(self.target, Target::Points) {
            for array in &arrays {
                self.keep(array, n_vertices);
            }
        }
        Ok(())
    }

    /// Keeps a numeric array that has a tuple for every vertex.
    fn keep(&mut self, array: &Array, n_vertices: usize) {
        if array.n_components == 0 || array.values.len() != n_vertices * array.n_components {
            return;
        }
        for component in 0..array.n_components {
            let name = if array.n_components == 1 {
                array.name.clone()
            } else {
                format!("{}_{component}", array.name)
            };
            let values = array.values.iter().skip(component).step_by(array.n_components);
            self.point_data.insert(name, values.copied().collect());
        }
    }

    fn finish(self, scan: &Scanner) -> Result<Content, MeshError> {
        if self.dataset.is_empty() {
            return Err(scan.truncated("a DATASET line"));
        }
        let vertices = self.vertices.ok_or_else(|| scan.truncated("a POINTS section"))?;
        let cells = self.cells.unwrap_or_default();
        if self.dataset == "UNSTRUCTURED_GRID" {
            check_types(scan, &cells, &self.cell_types)?;
        }
        let mut triangles = Vec::with_capacity(cells.len());
        for (cell, points) in cells.iter().enumerate() {
            let &[a, b, c] = points else {
                let got = format!("a polygon of {} points", points.len());
                return Err(MeshError::NotATriangle { path: scan.path().into(), cell, got });
            };
            triangles.push([a, b, c]);
        }
        for strip in self.strips.iter().flat_map(Cells::iter) {
            // Every other triangle of a strip runs the other way round.
            triangles.extend(
                strip
                    .windows(3)
                    .enumerate()
                    .map(|(i, t)| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] }),
            );
        }
        let triangles = indices(&triangles, vertices.len()).map_err(|source| {
            MeshError::Invalid { path: scan.path().into(), source: source.into() }
        })?;
        Ok(Content { vertices, triangles, point_data: self.point_data })
    }
}

fn indices(triangles: &[[i64; 3]], n_vertices: usize) -> Result<Vec<[u32; 3]>, MeshError> {
    let mut checked = Vec::with_capacity(triangles.len());
    for (triangle, &corners) in triangles.iter().enumerate() {
        tri_mesh::check_range(corners, triangle, n_vertices)?;
        checked.push(corners.map(|index| index as u32));
    }
    Ok(checked)
}

fn read_cells(scan: &mut Scanner, words: &[String]) -> Result<Cells, MeshError> {
    let (first, second) = (count(scan, words, 1)?, count(scan, words, 2)?);
    Cells::read(scan, &words[0], first, second)
}

/// Every cell of an unstructured grid must be a triangle, VTK's type 5.
fn check_types(scan: &Scanner, cells: &Cells, types: &[i64]) -> Result<(), MeshError> {
    if types.len() != cells.len() {
        let expected = format!("CELL_TYPES {}, one per cell", cells.len());
        return Err(scan.error(&expected, types.len().to_string()));
    }
    match types.iter().position(|&kind| kind != 5) {
        None => Ok(()),
        Some(cell) => Err(MeshError::NotATriangle {
            path: scan.path().into(),
            cell,
            got: cell_type(types[cell]),
        }),
    }
}

fn cell_type(number: i64) -> String {
    let name = match number {
        1 => "a vertex",
        3 => "a line",
        6 => "a triangle strip",
        7 => "a polygon",
        9 => "a quadrilateral",
        10 => "a tetrahedron",
        12 => "a hexahedron",
        22 => "a quadratic triangle",
        _ => return format!("of VTK type {number}"),
    };
    format!("{name} (VTK type {number})")
}
