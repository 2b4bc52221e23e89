//! Eigenpairs kept between runs, named by the content they were computed from.

use super::{Basis, ManifoldError, eigenpairs};
use crate::mesh::TriMesh;
use crate::store::cache;
use std::fs;
use std::path::{Path, PathBuf};

/// Part of every key: change it whenever [`eigenpairs`] may give other numbers.
const ALGORITHM: &[u8] = b"eigenpairs 2: P1 cotangent, lumped mass, block Lanczos 8, smoothed";

/// [`eigenpairs`], read from the cache folder where the same mesh and number of modes were asked
/// for before.
///
/// A cache that cannot be read or written only costs time: a damaged entry is computed again.
///
/// # Errors
/// Those of [`eigenpairs`].
pub fn eigenpairs_cached(mesh: &TriMesh, n_modes: usize) -> Result<Basis, ManifoldError> {
    eigenpairs_in(cache::folder(), mesh, n_modes)
}

/// Whether [`eigenpairs_cached`] has what it takes to answer at once.
pub fn eigenpairs_are_cached(mesh: &TriMesh, n_modes: usize) -> bool {
    cache::folder().is_some_and(|folder| path_in(&folder, mesh, n_modes).is_file())
}

fn path_in(folder: &Path, mesh: &TriMesh, n_modes: usize) -> PathBuf {
    folder.join(format!("basis-{}.npz", key(mesh, n_modes)))
}

fn eigenpairs_in(
    folder: Option<PathBuf>,
    mesh: &TriMesh,
    n_modes: usize,
) -> Result<Basis, ManifoldError> {
    let Some(folder) = folder else { return eigenpairs(mesh, n_modes) };
    let path = path_in(&folder, mesh, n_modes);
    if let Some(basis) = stored(&path, mesh, n_modes) {
        cache::used(&path);
        return Ok(basis);
    }
    let basis = eigenpairs(mesh, n_modes)?;
    // Not being able to keep the result is no reason to withhold it.
    if fs::create_dir_all(&folder).is_ok() {
        let _ = basis.write_npz(&path);
        cache::sweep(&folder, cache::LIMIT);
    }
    Ok(basis)
}

/// The entry at `path`, when it is whole and of the right size.
fn stored(path: &Path, mesh: &TriMesh, n_modes: usize) -> Option<Basis> {
    let basis = Basis::read_npz(path).ok()?;
    (basis.n_modes() == n_modes && basis.n_vertices() == mesh.n_vertices()).then_some(basis)
}

fn key(mesh: &TriMesh, n_modes: usize) -> String {
    let vertices: Vec<u8> =
        mesh.vertices().iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    let triangles: Vec<u8> =
        mesh.triangles().iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    cache::key(&[ALGORITHM, &vertices, &triangles, &(n_modes as u64).to_le_bytes()])
}

#[cfg(test)]
mod tests {
    use super::super::test_meshes::icosphere;
    use super::*;

    #[test]
    fn the_second_call_reads_what_the_first_wrote() {
        let folder = tempfile::tempdir().unwrap();
        let nested = folder.path().join("not yet there");
        let mesh = icosphere(2, 10.0);
        let first = eigenpairs_in(Some(nested.clone()), &mesh, 6).unwrap();
        let path = nested.join(format!("basis-{}.npz", key(&mesh, 6)));
        let mut marked = Basis::read_npz(&path).unwrap();
        assert!(marked.eigenfunctions == first.eigenfunctions);
        marked.eigenfunctions[0] = 42.0;
        marked.write_npz(&path).unwrap();
        let second = eigenpairs_in(Some(nested), &mesh, 6).unwrap();
        assert_eq!(second.eigenfunctions[0].to_bits(), 42.0_f64.to_bits());
    }

    #[test]
    fn a_damaged_entry_is_computed_again_and_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = icosphere(2, 10.0);
        let path = folder.path().join(format!("basis-{}.npz", key(&mesh, 6)));
        let good = eigenpairs_in(Some(folder.path().into()), &mesh, 6).unwrap();
        let whole = fs::read(&path).unwrap();
        let mut flipped = whole.clone();
        flipped[whole.len() / 2] ^= 0x10;
        for damaged in [&whole[..whole.len() / 2], &flipped, b"not a zip file"] {
            fs::write(&path, damaged).unwrap();
            let again = eigenpairs_in(Some(folder.path().into()), &mesh, 6).unwrap();
            assert!(again.eigenfunctions == good.eigenfunctions);
            assert!(fs::read(&path).unwrap() == whole);
        }
    }

    #[test]
    fn no_folder_or_an_unwritable_one_only_costs_time() {
        let mesh = icosphere(1, 10.0);
        let occupied = tempfile::NamedTempFile::new().unwrap();
        for folder in [None, Some(occupied.path().join("below a file"))] {
            assert_eq!(eigenpairs_in(folder, &mesh, 4).unwrap().n_modes(), 4);
        }
    }

    #[test]
    fn the_key_sees_the_mesh_and_the_number_of_modes() {
        let mesh = icosphere(1, 10.0);
        assert_ne!(key(&mesh, 4), key(&mesh, 5));
        assert_ne!(key(&mesh, 4), key(&icosphere(1, 10.0 + 1e-12), 4));
    }
}
