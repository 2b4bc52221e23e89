//! A surface in every format that eplat writes.

use std::path::{Path, PathBuf};

use eplat::mesh::{Encoding, Surface, TriMesh};

const FILES: [(&str, Encoding); 11] = [
    ("b.vtp", Encoding::Binary),
    ("b.vtu", Encoding::Binary),
    ("b.vtk", Encoding::Binary),
    ("a.vtk", Encoding::Ascii),
    ("b.ply", Encoding::Binary),
    ("a.ply", Encoding::Ascii),
    ("b.npz", Encoding::Binary),
    ("a.obj", Encoding::Ascii),
    ("a.stl", Encoding::Ascii),
    ("b.stl", Encoding::Binary),
    ("a.pts", Encoding::Ascii),
];

/// Writes the mesh, with an array of its points, in every format; the files.
pub(crate) fn written(mesh: TriMesh, folder: &Path) -> Vec<PathBuf> {
    let values: Vec<f64> = (0..mesh.n_vertices()).map(|i| (i as f64).sqrt()).collect();
    let surface = Surface::new(mesh, [("lat".into(), values)].into());
    let write = |(name, encoding): (&str, Encoding)| {
        let path = folder.join(name);
        surface.write(&path, encoding).unwrap_or_else(|error| panic!("{name}: {error}"));
        path
    };
    FILES.map(write).into()
}
