//! Counts of edges, pieces and openings against definitions applied literally, on random meshes.

#![allow(clippy::unwrap_used, reason = "tests")]

use eplat::mesh::{MeshError, TriMesh};
use proptest::prelude::*;
use std::collections::BTreeSet;

/// A flat 5 × 5 grid's triangles, some of which are left out; unused vertices are dropped.
fn part_of_a_grid(keep: &[bool]) -> Option<TriMesh> {
    let squares = (0..16_u32).map(|s| s / 4 * 5 + s % 4);
    let all = squares.flat_map(|a| [[a, a + 1, a + 6], [a, a + 6, a + 5]]);
    let triangles: Vec<[u32; 3]> =
        all.zip(keep).filter(|(_, keep)| **keep).map(|(triangle, _)| triangle).collect();
    let used: BTreeSet<u32> = triangles.iter().flatten().copied().collect();
    let used: Vec<u32> = used.into_iter().collect();
    let vertices = used.iter().map(|&v| [f64::from(v % 5), f64::from(v / 5), 0.0]).collect();
    let renumber = |v: u32| used.binary_search(&v).unwrap() as u32;
    let triangles: Vec<_> = triangles.into_iter().map(|t| t.map(renumber)).collect();
    (!triangles.is_empty()).then(|| TriMesh::new(vertices, triangles).unwrap())
}

/// Every edge as a sorted pair, once for every triangle that has it.
fn edge_list(mesh: &TriMesh) -> Vec<[u32; 2]> {
    let pairs = mesh.triangles().iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [a, c]]);
    pairs.map(|[a, b]| [a.min(b), a.max(b)]).collect()
}

/// Pieces by spreading labels until nothing changes.
fn count_pieces(mesh: &TriMesh) -> usize {
    let mut label: Vec<usize> = (0..mesh.n_vertices()).collect();
    loop {
        let before = label.clone();
        for t in mesh.triangles() {
            let least = t.iter().map(|&v| label[v as usize]).min().unwrap();
            for &v in t {
                label[v as usize] = least;
            }
        }
        if label == before {
            return label.into_iter().collect::<BTreeSet<_>>().len();
        }
    }
}

proptest! {
    #[test]
    fn counts_agree_with_their_definitions(keep in prop::collection::vec(any::<bool>(), 32)) {
        let Some(mesh) = part_of_a_grid(&keep) else { return Ok(()) };
        let edges = edge_list(&mesh);
        let distinct: BTreeSet<_> = edges.iter().copied().collect();
        let euler = mesh.n_vertices() as i64 - distinct.len() as i64 + mesh.n_triangles() as i64;
        prop_assert_eq!(mesh.euler_characteristic(), euler);
        prop_assert_eq!(mesh.n_components(), count_pieces(&mesh));
        prop_assert!((mesh.area() - 0.5 * mesh.n_triangles() as f64).abs() < 1e-12);
        // The loops hold every border edge exactly once.
        let mut border: Vec<[u32; 2]> = distinct
            .into_iter()
            .filter(|edge| edges.iter().filter(|e| *e == edge).count() == 1)
            .collect();
        let mut walked = Vec::new();
        for chain in mesh.boundary_loops() {
            for (i, &a) in chain.iter().enumerate() {
                let b = chain[(i + 1) % chain.len()];
                walked.push([a.min(b), a.max(b)]);
            }
        }
        border.sort_unstable();
        walked.sort_unstable();
        prop_assert_eq!(walked, border);
    }

    #[test]
    fn any_triangles_are_a_mesh_or_a_named_fault(
        triangles in prop::collection::vec(prop::array::uniform3(0_u32..7), 0..8),
    ) {
        let vertices = (0..6).map(|i| [f64::from(i), f64::from(i * i), 0.0]).collect();
        match TriMesh::new(vertices, triangles.clone()) {
            Ok(mesh) => prop_assert!(mesh.triangles() == triangles),
            Err(MeshError::Empty) => prop_assert!(triangles.is_empty()),
            Err(MeshError::IndexOutOfRange { triangle, index, n_vertices: 6 }) => {
                prop_assert!(index == 6 && triangles[triangle].contains(&6));
            }
            Err(MeshError::RepeatedVertex { triangle, vertex }) => {
                prop_assert!(triangles[triangle].iter().filter(|&&v| v == vertex).count() > 1);
            }
            Err(MeshError::NonManifoldEdge { edge, triangles: sharing, .. }) => {
                let has = |t: &[u32; 3]| edge.iter().all(|v| t.contains(v));
                prop_assert_eq!(triangles.iter().filter(|t| has(t)).count(), sharing.len());
                prop_assert!(sharing.len() > 2);
            }
            Err(MeshError::UnusedVertex { vertex }) => {
                prop_assert!(!triangles.iter().flatten().any(|&v| v as usize == vertex));
            }
            Err(other) => prop_assert!(false, "{}", other),
        }
    }
}
