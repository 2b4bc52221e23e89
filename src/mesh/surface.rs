//! Reads a mesh file as one surface: its largest piece, in millimetres, and what was left out.

use super::vtk::{self, Content};
use super::{MeshError, TriMesh, Units, topology, tri_mesh};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// The area a left atrium may have, mm².
const PLAUSIBLE_AREA: std::ops::RangeInclusive<f64> = 2_000.0..=60_000.0;

/// One connected surface from a file.
#[derive(Clone, Debug)]
pub struct Surface {
    /// The largest piece, without unused vertices.
    pub mesh: TriMesh,
    /// For each vertex of `mesh` its index in the file.
    pub source_vertex: Vec<u32>,
    /// Number of vertices in the file.
    pub n_source_vertices: usize,
    /// Vertex counts of the pieces that were dropped, largest first; unused vertices do not count.
    pub dropped: Vec<usize>,
    /// The file's point data at the vertices of `mesh`; an array of several components is split into
    /// `name_0`, `name_1`, ….
    pub point_data: BTreeMap<String, Vec<f64>>,
    /// Sentences for the user: what was dropped, size and area, and a doubt about the unit.
    pub notes: Vec<String>,
}

impl Surface {
    /// A surface that is in no file, all of whose vertices are kept; `point_data` by name
    /// (n_vertices).
    pub fn new(mesh: TriMesh, point_data: BTreeMap<String, Vec<f64>>) -> Self {
        let n = mesh.n_vertices();
        Self {
            mesh,
            source_vertex: (0..n as u32).collect(),
            n_source_vertices: n,
            dropped: vec![],
            point_data,
            notes: vec![],
        }
    }

    /// The procedural left atrium with edges of about `edge` mm and its regions as point data.
    ///
    /// # Panics
    /// As [`left_atrium`](super::left_atrium).
    pub fn left_atrium(edge: f64) -> Self {
        let atrium = super::left_atrium(edge);
        let region = atrium.region.iter().map(|region| f64::from(*region)).collect();
        Self::new(atrium.mesh, BTreeMap::from([("region".into(), region)]))
    }

    /// The vertex of `mesh` that is vertex `source` of the file; `None` if it was dropped.
    pub fn vertex_of_source(&self, source: usize) -> Option<u32> {
        let source = u32::try_from(source).ok()?;
        // Kept vertices stay in file order.
        self.source_vertex.binary_search(&source).ok().map(|vertex| vertex as u32)
    }
}

/// Reads the surface in the VTK file `path` (.vtk or .vtp), whose coordinates are in `units`.
///
/// # Errors
/// [`MeshError`]: `Extension`, `Read`, `Parse`, `Truncated`, `NotATriangle`, or `Invalid` with
/// what [`TriMesh::new`] refuses (vertices and triangles counted as in the file).
pub fn read(path: &Path, units: Units) -> Result<Surface, MeshError> {
    let content = read_content(path, units)?;
    largest_piece(content, units)
        .map_err(|source| MeshError::Invalid { path: path.into(), source: source.into() })
}

/// Everything in the file, in mm and not yet validated.
pub(super) fn read_content(path: &Path, units: Units) -> Result<Content, MeshError> {
    let is = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    let bytes = fs::read(path).map_err(|source| MeshError::Read { path: path.into(), source })?;
    if !is("vtk") && !is("vtp") {
        return Err(MeshError::Extension {
            path: path.into(),
            action: "read",
            supported: "a VTK file (.vtk or .vtp)",
            help: "save the mesh as .vtk from ParaView or PyVista (pyvista.read(F).save('mesh.vtk'))",
        });
    }
    let parse = if is("vtp") { vtk::parse_xml } else { vtk::parse };
    let mut content = parse(path, &bytes)?;
    for x in content.vertices.iter_mut().flatten() {
        *x *= units.in_mm();
    }
    Ok(content)
}

pub(super) fn largest_piece(content: Content, units: Units) -> Result<Surface, MeshError> {
    let Content { vertices, triangles, point_data } = content;
    tri_mesh::validate(&vertices, &triangles)?;
    let piece = topology::pieces(vertices.len(), &triangles);
    let sizes = piece_sizes(&piece);
    // The first of the largest; validation left at least one triangle.
    let largest = (0..sizes.len()).rev().max_by_key(|&p| sizes[p]).unwrap_or(0);
    let source_vertex: Vec<u32> =
        (0..vertices.len() as u32).filter(|&v| piece[v as usize] as usize == largest).collect();
    let mut new_index = vec![0; vertices.len()];
    for (new, &old) in (0..).zip(&source_vertex) {
        new_index[old as usize] = new;
    }
    let kept = triangles.iter().filter(|t| piece[t[0] as usize] as usize == largest);
    let mesh = TriMesh::new(
        source_vertex.iter().map(|&v| vertices[v as usize]).collect(),
        kept.map(|t| t.map(|v| new_index[v as usize])).collect(),
    )?;
    let mut dropped = sizes;
    dropped.remove(largest);
    let n_unused = dropped.iter().filter(|&&size| size == 1).count();
    dropped.retain(|&size| size > 1);
    dropped.sort_unstable_by(|a, b| b.cmp(a));
    let notes = notes(&mesh, &dropped, n_unused, units);
    let at_kept = |values: Vec<f64>| source_vertex.iter().map(|&v| values[v as usize]).collect();
    let point_data = point_data.into_iter().map(|(name, values)| (name, at_kept(values))).collect();
    Ok(Surface {
        mesh,
        source_vertex,
        n_source_vertices: vertices.len(),
        dropped,
        point_data,
        notes,
    })
}

/// Number of vertices of each piece.
fn piece_sizes(piece: &[u32]) -> Vec<usize> {
    let n_pieces = piece.iter().max().map_or(0, |&last| last as usize + 1);
    let mut sizes = vec![0; n_pieces];
    for &p in piece {
        sizes[p as usize] += 1;
    }
    sizes
}

fn notes(mesh: &TriMesh, dropped: &[usize], n_unused: usize, units: Units) -> Vec<String> {
    let mut notes = Vec::new();
    if !dropped.is_empty() {
        let pieces = if dropped.len() == 1 { "piece" } else { "pieces" };
        let sizes: Vec<String> = dropped.iter().map(ToString::to_string).collect();
        notes.push(format!(
            "kept the largest piece ({} vertices); dropped {} smaller {pieces} ({} vertices)",
            mesh.n_vertices(),
            dropped.len(),
            sizes.join(", ")
        ));
    }
    match n_unused {
        0 => {}
        1 => notes.push("dropped 1 vertex that belongs to no triangle".into()),
        n => notes.push(format!("dropped {n} vertices that belong to no triangle")),
    }
    notes.extend(size_notes(mesh, units));
    notes
}

/// Bounding box and area, and a warning if no left atrium is that size.
fn size_notes(mesh: &TriMesh, units: Units) -> Vec<String> {
    let [low, high] = mesh.bounding_box();
    let [x, y, z]: [f64; 3] = std::array::from_fn(|k| high[k] - low[k]);
    let area = mesh.area();
    let cm2 = area / 100.0;
    let mut notes = vec![format!(
        "read as {units}: {} × {} × {} mm, area {} cm²",
        rounded(x),
        rounded(y),
        rounded(z),
        rounded(cm2)
    )];
    if !PLAUSIBLE_AREA.contains(&area) {
        let ratio = |other: Units| (other.in_mm() / units.in_mm()).powi(2);
        let likely = Units::ALL.into_iter().find(|&u| PLAUSIBLE_AREA.contains(&(area * ratio(u))));
        let advice = match likely {
            Some(other) => format!(
                "with --units {other} it would be {} cm²: is the file in {other}?",
                rounded(cm2 * ratio(other))
            ),
            None => {
                "no unit of length makes it one; this is fine for a patch or a test shape".into()
            }
        };
        notes.push(format!(
            "WARNING: an area of {} cm² is not a left atrium's (20 to 600 cm²); {advice}",
            rounded(cm2)
        ));
    }
    notes
}

/// Three significant digits, without an exponent where a person would not write one.
fn rounded(x: f64) -> String {
    match x.abs() {
        a if a >= 1e6 || (a > 0.0 && a < 1e-3) => format!("{x:.2e}"),
        a if a >= 100.0 => format!("{x:.0}"),
        a if a >= 1.0 || a == 0.0 => format!("{x:.1}"),
        _ => format!("{x:.4}"),
    }
}
