//! What can be wrong with a surface or its file.

use super::Atrium;
use crate::store::advice;
use std::fmt;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Where in a file a parser stood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Line of a text file, counted from 1.
    Line(usize),
    /// Offset from the start of a binary file.
    Byte(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(offset) => write!(f, "byte {offset}"),
        }
    }
}

/// What can be wrong with a surface or its file.  Vertices and triangles are counted from 0.
#[derive(Debug, Error)]
pub enum MeshError {
    /// No triangle at all.
    #[error(
        "the mesh has no triangles\n\
         help: a surface of at least one triangle is needed; point clouds are not read"
    )]
    Empty,
    /// The procedural atrium cannot have edges of this length.
    #[error(
        "the procedural atrium cannot have edges of {edge} mm, expected {} to {} mm\n\
         help: longer edges do not resolve the veins, shorter ones take too long",
        Atrium::EDGE_RANGE.start(), Atrium::EDGE_RANGE.end()
    )]
    Edge {
        /// The length, mm.
        edge: f64,
    },
    /// A coordinate is NaN or infinite.
    #[error(
        "vertex {vertex} is at ({}, {}, {}), expected three finite numbers\n\
         help: export the mesh again, or delete the vertex in the program that wrote it",
        position[0], position[1], position[2]
    )]
    NotFinite {
        /// The vertex.
        vertex: usize,
        /// Its coordinates, mm.
        position: [f64; 3],
    },
    /// A coordinate is beyond all measure: areas would overflow.
    #[error(
        "vertex {vertex} is at ({:?}, {:?}, {:?}) mm, expected coordinates below {most:e} mm\n\
         help: export the mesh again, or delete the vertex in the program that wrote it",
        position[0], position[1], position[2]
    )]
    TooFar {
        /// The vertex.
        vertex: usize,
        /// Its coordinates, mm.
        position: [f64; 3],
        /// The largest, mm.
        most: f64,
    },
    /// A triangle names a vertex that does not exist.
    #[error(
        "triangle {triangle} names vertex {index}, expected 0 to {} (the mesh has {n_vertices} vertices)\n\
         help: vertex numbers start at 0; was the mesh exported with numbers that start at 1?",
        n_vertices.saturating_sub(1)
    )]
    IndexOutOfRange {
        /// The triangle.
        triangle: usize,
        /// The index it holds.
        index: i64,
        /// How many vertices there are.
        n_vertices: usize,
    },
    /// A triangle has the same vertex twice, so it has no area.
    #[error(
        "triangle {triangle} has vertex {vertex} more than once, expected three different vertices\n\
         help: `eplat mesh repair IN OUT` drops such triangles"
    )]
    RepeatedVertex {
        /// The triangle.
        triangle: usize,
        /// The vertex it repeats.
        vertex: u32,
    },
    /// The corners of a triangle lie on one line or in one point.
    #[error(
        "triangle {triangle} has no area: its corners lie on one line\n\
         help: `eplat mesh repair IN OUT` joins corners that coincide; otherwise flip or remove \
         the triangle in a mesh editor"
    )]
    NoArea {
        /// The triangle.
        triangle: usize,
    },
    /// More than two triangles share an edge.
    #[error(
        "the edge between vertices {} and {}, at ({}), belongs to {} triangles ({triangles:?}), expected 1 or 2{}\n\
         help: a surface may not branch: delete the surplus triangles there in a mesh editor",
        edge[0], edge[1], place(&middle(at)), triangles.len(), and_others(*n_edges)
    )]
    NonManifoldEdge {
        /// The two ends of the edge.
        edge: [u32; 2],
        /// Where they are, mm.
        at: [[f64; 3]; 2],
        /// All triangles that have it.
        triangles: Vec<u32>,
        /// How many such edges there are.
        n_edges: usize,
    },
    /// Several pieces are about as large as each other.
    #[error(
        "there are several surfaces, and none is much the largest:{}\n\
         help: choose one with --piece 1, --piece 2, …; or join them in a mesh editor",
        listed(pieces)
    )]
    SeveralPieces {
        /// The large ones, the largest first.
        pieces: Vec<Piece>,
    },
    /// There are fewer pieces than the number of the one that is asked for.
    #[error(
        "there is no piece {piece}: the mesh has {n_pieces}\n\
         help: pieces are counted from 1, the largest first; leave --piece out for the largest"
    )]
    NoPiece {
        /// The number that was asked for.
        piece: usize,
        /// How many pieces there are.
        n_pieces: usize,
    },
    /// The size of the surface is an atrium's in no unit.
    #[error(
        "the unit of the coordinates is unknown: the surface is {across} across, and in no unit is that \
         an atrium's size (30 to 150 mm)\n\
         help: add --units mm, cm, um or m"
    )]
    NoUnits {
        /// Its largest extent in the file's unit.
        across: f64,
    },
    /// The surface has only one side, like a Möbius strip.
    #[error(
        "the surface cannot be oriented: triangles {} and {} close a one-sided band\n\
         help: cut the band open in a mesh editor",
        triangles[0], triangles[1]
    )]
    NotOrientable {
        /// Two neighbours that cannot run the same way as all the others.
        triangles: [usize; 2],
    },
    /// A vertex belongs to no triangle, so it would have no mass.
    #[error(
        "vertex {vertex} belongs to no triangle\n\
         help: drop unused vertices before making a TriMesh; `eplat::mesh::read` does"
    )]
    UnusedVertex {
        /// The vertex.
        vertex: usize,
    },
    /// One value per vertex was expected.
    #[error(
        "the point data array {name:?} has {got} values, expected {expected} (one per vertex)\n\
         help: pass one value for every vertex of the mesh, in its order"
    )]
    DataLength {
        /// The array.
        name: String,
        /// Number of vertices.
        expected: usize,
        /// Number of values.
        got: usize,
    },
    /// Bytes, lines or arrays that a format does not have, such as tetrahedra.
    #[error("{}: {what}\nhelp: {help}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What it holds.
        what: String,
        /// What to do.
        help: &'static str,
    },
    /// Not the name of a unit of length.
    #[error(
        "unknown unit {name:?}, expected one of mm, cm, um, m\nhelp: say --units mm for a mesh in millimetres"
    )]
    UnknownUnits {
        /// What was given.
        name: String,
    },
    /// The file name's extension is not one that can be read or written.
    #[error("{}: cannot {action} a file with {}, expected {supported}\nhelp: {help}", path.display(), extension(path))]
    Extension {
        /// The file.
        path: PathBuf,
        /// "read" or "write".
        action: &'static str,
        /// The extensions that work.
        supported: &'static str,
        /// What to do.
        help: &'static str,
    },
    /// The file cannot be opened or read.
    #[error("cannot read {}: {source}\nhelp: check the path and its permissions", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file cannot be written.
    #[error("cannot write {}: {source}\nhelp: {}", path.display(), advice(source))]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not what the format allows.
    #[error("{}, {place}: expected {expected}, got {got}\nhelp: {PARSE_HELP}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// Where in it.
        place: Place,
        /// What the format asks for there.
        expected: String,
        /// What stands there.
        got: String,
    },
    /// The file ends too early.
    #[error(
        "{}, {place}: the file ends here, expected {expected}\n\
         help: the file is truncated; copy or export it again",
        path.display()
    )]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Where it ends.
        place: Place,
        /// What should follow.
        expected: String,
    },
    /// A cell that is not a triangle.
    #[error(
        "{}: cell {cell} is {got}, expected a triangle\n\
         help: only triangle surfaces are read; triangulate or extract the surface first \
         (ParaView: Extract Surface, then Triangulate)",
        path.display()
    )]
    NotATriangle {
        /// The file.
        path: PathBuf,
        /// The cell, counted from 0.
        cell: usize,
        /// What it is.
        got: String,
    },
    /// The file was read, but what it holds is not a valid surface.
    #[error("{}: {source}{picture}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<MeshError>,
        /// A last line that names the file in which the places are marked; empty if there is none.
        picture: String,
    },
}

impl MeshError {
    /// The system's error, where one kept a file from being written, without the file's name: for files that are
    /// written under a name that is not their own yet.
    pub fn into_cause(self) -> io::Error {
        match self {
            Self::Write { source, .. } => source,
            other => io::Error::other(other),
        }
    }
}

/// A connected piece of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Number of its vertices.
    pub n_vertices: usize,
    /// Area, mm².
    pub area: f64,
    /// The mean of its vertices, mm.
    pub centre: [f64; 3],
}

impl fmt::Display for Piece {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { n_vertices, area, centre } = self;
        write!(f, "{n_vertices} vertices, {:.1} cm², centred at ({})", area / 100.0, place(centre))
    }
}

/// One line for each piece, with its number.
fn listed(pieces: &[Piece]) -> String {
    let lines: Vec<String> =
        pieces.iter().zip(1..).map(|(piece, n)| format!("\n  {n}: {piece}")).collect();
    lines.concat()
}

/// Coordinates in mm, to a tenth.
fn place([x, y, z]: &[f64; 3]) -> String {
    format!("{x:.1}, {y:.1}, {z:.1}")
}

fn middle([a, b]: &[[f64; 3]; 2]) -> [f64; 3] {
    std::array::from_fn(|k| 0.5 * (a[k] + b[k]))
}

fn and_others(n: usize) -> String {
    match n {
        1 => String::new(),
        2 => "; 1 other edge does so too".into(),
        n => format!("; {} other edges do so too", n - 1),
    }
}

const PARSE_HELP: &str = "save the mesh again, for instance as .vtp or .vtk from ParaView or PyVista; docs/meshes.md says what is read";

fn extension(path: &std::path::Path) -> String {
    path.extension()
        .map_or_else(|| "no extension".into(), |e| format!("extension .{}", e.display()))
}
