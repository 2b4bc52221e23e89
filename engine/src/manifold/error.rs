//! What can go wrong on a surface: too many modes, a surface in pieces, a file that is not a basis.

use std::path::PathBuf;
use thiserror::Error;

/// Why an operator, a basis, a distance or a set of sites could not be made.
#[derive(Debug, Error)]
pub enum ManifoldError {
    /// No mode was asked for.
    #[error("0 modes asked for\nhelp: ask for at least 1 mode; 24 to 256 are usual")]
    NoModes,

    /// More modes than can be computed on this mesh.
    #[error(
        "{n_modes} modes asked for, but a mesh of {n_vertices} vertices gives at most {largest}\n\
         help: ask for {largest} modes or fewer, or use a finer mesh"
    )]
    TooManyModes {
        /// Modes asked for.
        n_modes: usize,
        /// Vertices of the mesh.
        n_vertices: usize,
        /// The largest number that works.
        largest: usize,
    },

    /// More modes than a basis holds.
    #[error(
        "{n_modes} modes asked for, but the basis has {available}\n\
         help: ask for {available} modes or fewer, or compute a larger basis"
    )]
    BasisTooSmall {
        /// Modes asked for.
        n_modes: usize,
        /// Modes in the basis.
        available: usize,
    },

    /// The basis does not belong to the mesh.
    #[error(
        "the basis does not fit the mesh: expected {expected}, got {got}\n\
         help: give the basis computed on this very mesh, in the same units (mm)"
    )]
    BasisMismatch {
        /// What the mesh asks for.
        expected: String,
        /// What the basis has.
        got: String,
    },

    /// The surface is not one connected piece.
    #[error(
        "the mesh is in {n_pieces} pieces (vertices without a triangle count as pieces); the largest has {largest} of {n_vertices} vertices\n\
         help: keep the largest piece: eplat mesh repair"
    )]
    Disconnected {
        /// Connected pieces.
        n_pieces: usize,
        /// Vertices of the largest piece.
        largest: usize,
        /// Vertices of the mesh.
        n_vertices: usize,
    },

    /// The factorisation met a pivot that is not positive.
    #[error(
        "the surface operator could not be factorised (pivot {pivot} is not positive)\n\
         help: look for nearly degenerate triangles or coordinates of extreme size: eplat mesh info"
    )]
    NotPositiveDefinite {
        /// Column of the failing pivot.
        pivot: usize,
    },

    /// A library routine ran out of memory or of index range.
    #[error(
        "linear algebra failed during {during}: {reason}\nhelp: ask for fewer modes or use a coarser mesh"
    )]
    LinearAlgebra {
        /// The step that failed.
        during: &'static str,
        /// The library's reason.
        reason: String,
    },

    /// The eigensolver stopped before every residual was small enough.
    #[error(
        "only {converged} of {n_modes} eigenpairs converged (worst relative residual {worst:.1e})\n\
         help: repair the mesh (very small angles slow convergence) or ask for fewer modes"
    )]
    NotConverged {
        /// Eigenpairs asked for.
        n_modes: usize,
        /// Eigenpairs that passed the residual test.
        converged: usize,
        /// Largest relative residual.
        worst: f64,
    },

    /// Fewer vertices are left for measurement sites than sites.
    #[error(
        "{n_sites} sites asked for, but only {available} vertices lie at least {exclude_mm} mm from an opening\n\
         help: ask for fewer sites, or exclude a narrower band around the openings"
    )]
    TooFewVertices {
        /// Sites asked for.
        n_sites: usize,
        /// Vertices that may be sites.
        available: usize,
        /// Width of the excluded band, mm.
        exclude_mm: f64,
    },

    /// The width of the excluded band is not a length.
    #[error(
        "the band excluded around openings is {exclude_mm} mm\nhelp: give a finite width of 0 mm or more"
    )]
    ExcludedBand {
        /// The width given, mm.
        exclude_mm: f64,
    },

    /// Not a fibre direction for each triangle.
    #[error(
        "the mesh has {n_triangles} triangles, but there are {got} fibre directions\n\
         help: give one for each triangle"
    )]
    FibreCount {
        /// Triangles of the mesh.
        n_triangles: usize,
        /// Directions given.
        got: usize,
    },

    /// A fibre that has no direction in the surface.
    #[error(
        "the fibre of triangle {triangle} is {fibre:?}, which has no direction in the surface\n\
         help: give every triangle a finite vector that lies in the surface"
    )]
    NoFibre {
        /// The triangle.
        triangle: usize,
        /// What is there.
        fibre: [f64; 3],
    },

    /// A basis file could not be read or written.
    #[error("cannot {action} {}: {reason}\nhelp: {help}", path.display())]
    File {
        /// `read` or `write`.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The operating system's or the archive's reason.
        reason: String,
        /// What to do.
        help: &'static str,
    },

    /// An array of a basis file is absent or not as it must be.
    #[error(
        "{}: array `{array}`: expected {expected}, got {got}\n\
         help: save with numpy.savez(file, eigenvalues=..., eigenfunctions=...)", path.display()
    )]
    Array {
        /// The file.
        path: PathBuf,
        /// The array's name.
        array: &'static str,
        /// What it must be.
        expected: String,
        /// What it is.
        got: String,
    },
}
