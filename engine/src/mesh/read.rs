//! Reads a mesh file as one surface in millimetres: mended where no choice is needed, with what was
//! done as notes.

use super::content::{Content, count};
use super::faults::mark;
use super::mend::{Done, Mended, Refusal, mend};
use super::pieces::Pieces;
use super::size::{across, size_notes};
use super::surface::{Axes, DROPPED};
use super::units::Known;
use super::{MeshError, Surface, TriMesh, Units, data, format, tri_mesh};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// How a mesh file is read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Unit of its coordinates; without it what the file or its format says, else the unit that makes the
    /// surface as large as an atrium.
    pub units: Option<Units>,
    /// Which connected piece is the surface, counted from 1, the largest first; without it the largest, if
    /// it is much the largest.
    pub piece: Option<usize>,
    /// Vertices within this distance are joined, mm; without it those at the same place.
    pub tolerance: Option<f64>,
    /// The file (.vtp) to write where a mesh that cannot be mended is marked; without it none is.
    pub faults: Option<PathBuf>,
}

impl From<Units> for Reading {
    fn from(units: Units) -> Self {
        Some(units).into()
    }
}

impl From<Option<Units>> for Reading {
    fn from(units: Option<Units>) -> Self {
        Self { units, ..Self::default() }
    }
}

/// Reads the surface in the file `path`; `reading` may be a unit alone. The extension says the format.
///
/// Vertices at one place are joined, triangles without area or there twice are dropped, neighbours are
/// turned the same way, and stray pieces and unused vertices are left out. The notes tell it.
///
/// # Errors
/// [`MeshError`]: `Extension`, `Read`, `Parse`, `Truncated`, `NotATriangle`, `Unsupported`; or `Invalid`
/// with what cannot be mended without a choice (vertices and triangles counted as in the file).
pub fn read(path: &Path, reading: impl Into<Reading>) -> Result<Surface, MeshError> {
    let invalid = |(source, picture): (MeshError, String)| MeshError::Invalid {
        path: path.into(),
        source: source.into(),
        picture,
    };
    surface(format::read_content(path)?, &reading.into()).map_err(invalid)
}

/// The surface of these arrays, mended as [`read`] mends that of a file: `vertices` in mm, `triangles` as their
/// indices, and `scalars` by name (one value per vertex).
///
/// # Errors
/// `DataLength`, `NotFinite`, `IndexOutOfRange`; or what cannot be mended without a choice.
pub fn mended(
    vertices: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    scalars: BTreeMap<String, Vec<f64>>,
) -> Result<Surface, MeshError> {
    let expected = vertices.len();
    if let Some((name, values)) = scalars.iter().find(|(_, values)| values.len() != expected) {
        return Err(MeshError::DataLength { name: name.clone(), expected, got: values.len() });
    }
    tri_mesh::check_finite(&vertices)?;
    for (triangle, corners) in triangles.iter().enumerate() {
        tri_mesh::check_range(corners.map(i64::from), triangle, vertices.len())?;
    }
    let point_data = scalars.into_iter().map(|(name, values)| (name, values.into())).collect();
    let content = Content { vertices, triangles, point_data, ..Content::default() };
    surface(content, &Reading::from(Units::Mm)).map_err(|(error, _)| error)
}

/// The surface of what a file holds, or why there is none and where that is marked.
fn surface(mut content: Content, reading: &Reading) -> Result<Surface, (MeshError, String)> {
    let invalid = |error: MeshError| (error, String::new());
    let (units, known) = units(&content, reading).map_err(invalid)?;
    for x in content.vertices.iter_mut().flatten() {
        *x *= units.in_mm();
    }
    tri_mesh::check_finite(&content.vertices).map_err(invalid)?;
    let refused = |refusal: Refusal, pieces: Option<&Pieces>| {
        let picture = mark(reading.faults.as_deref(), &content, &refusal, pieces);
        (refusal.error, picture)
    };
    let mended = mend(&content.vertices, &content.triangles, reading.tolerance)
        .map_err(|refusal| refused(refusal, None))?;
    let pieces = Pieces::new(&content.vertices, &mended.triangles);
    let chosen =
        pieces.choose(reading.piece).map_err(|error| refused(error.into(), Some(&pieces)))?;
    let mut surface = piece(&content, &mended, &pieces, chosen).map_err(invalid)?;
    surface.units = units;
    surface.notes = notes(&content, &mended, &surface);
    surface.notes.extend(size_notes(&surface.mesh, units, known));
    Ok(surface)
}

/// Reads the file `path` as [`read`] does and repairs it: vertices within `tolerance` mm are joined, and
/// the surface must have two sides.
///
/// # Errors
/// Those of [`read`], and `NotOrientable`.
pub fn repair(
    path: &Path,
    units: impl Into<Option<Units>>,
    tolerance: f64,
) -> Result<Surface, MeshError> {
    read(path, Reading { tolerance: Some(tolerance), ..Reading::from(units.into()) })
}

/// The unit of the coordinates, and how it is known.
fn units(content: &Content, reading: &Reading) -> Result<(Units, Known), MeshError> {
    if let Some(units) = reading.units {
        return Ok((units, Known::Given));
    }
    if let Some(units) = content.units {
        return Ok((units, Known::Told));
    }
    let across = across(&content.vertices, &content.triangles, reading.piece);
    match Units::of_an_atrium(across) {
        Some(units) => Ok((units, Known::Guessed)),
        None if content.triangles.is_empty() => Err(MeshError::Empty),
        None => Err(MeshError::NoUnits { across }),
    }
}

/// The piece `chosen` of the mended triangles.
fn piece(
    content: &Content,
    mended: &Mended,
    pieces: &Pieces,
    chosen: usize,
) -> Result<Surface, MeshError> {
    let n = content.vertices.len() as u32;
    let source_vertex: Vec<u32> = (0..n)
        .filter(|v| mended.target[*v as usize] == *v && pieces.rank_of(*v) == Some(chosen))
        .collect();
    let mut vertex_of = vec![DROPPED; content.vertices.len()];
    for (new, &old) in (0..).zip(&source_vertex) {
        vertex_of[old as usize] = new;
    }
    for v in 0..n as usize {
        // A vertex is joined to one before it, or (needles) after it: both have their number by now.
        vertex_of[v] = vertex_of[mended.target[v] as usize];
    }
    let (mut triangles, mut origin) = (vec![], vec![]);
    for (t, &from) in mended.triangles.iter().zip(&mended.origin) {
        if pieces.rank_of(t[0]) == Some(chosen) {
            triangles.push(t.map(|v| vertex_of[v as usize]));
            origin.push(from);
        }
    }
    let vertices = source_vertex.iter().map(|&v| content.vertices[v as usize]).collect();
    let mesh = TriMesh::new(vertices, triangles)?;
    let mut dropped: Vec<usize> = pieces.ranked.iter().map(|piece| piece.n_vertices).collect();
    dropped.remove(chosen);
    dropped.sort_unstable_by(|a, b| b.cmp(a));
    Ok(Surface {
        mesh,
        n_source_vertices: content.vertices.len(),
        dropped,
        point_data: data::pick(&content.point_data, &source_vertex),
        cell_data: data::pick(&content.cell_data, &origin),
        source_vertex,
        units: Units::Mm,
        axes: Axes::Unknown,
        notes: vec![],
        vertex_of,
        fine: None,
    })
}

/// What the reader and the mending did: one sentence each, and none if they did nothing.
fn notes(content: &Content, mended: &Mended, surface: &Surface) -> Vec<String> {
    let mut notes = content.remarks.clone();
    let Done { joined, flat, double, turned, ref left } = mended.done;
    let mut done = vec![];
    let mut say = |n: usize, verb: &str, what: &str, after: &str| {
        if n > 0 {
            done.push(format!("{verb} {}{after}", count(n, what)));
        }
    };
    say(joined, "joined", "duplicate point", "");
    say(flat, "dropped", "triangle", " without area");
    say(double, "dropped", "double triangle", "");
    say(turned, "turned", "triangle", "");
    let sizes: Vec<String> = surface.dropped.iter().map(ToString::to_string).collect();
    let vertices = format!(" ({} vertices)", sizes.join(", "));
    say(surface.dropped.len(), "left out", "other piece", &vertices);
    let in_pieces: usize = surface.mesh.n_vertices() + surface.dropped.iter().sum::<usize>();
    let n_joined = (0..).zip(&mended.target).filter(|(v, target)| v != *target).count();
    let unused = (content.vertices.len() - in_pieces).saturating_sub(n_joined);
    say(unused, "left out", "unused point", "");
    if !done.is_empty() {
        notes.push(format!("mended: {}", done.join(", ")));
    }
    notes.extend(left.iter().map(|what| (*what).to_owned()));
    notes
}
