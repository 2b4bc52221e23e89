//! Edges, pieces and boundary loops of a list of triangles.  Knows no coordinates.

use std::collections::BTreeMap;

/// One side of one triangle; `ends` are sorted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Side {
    /// The two vertices, the smaller first.
    pub(super) ends: [u32; 2],
    /// The triangle.
    pub(super) triangle: u32,
    /// Whether the triangle runs along it from the smaller to the larger vertex.
    pub(super) forward: bool,
}

/// All sides of all triangles, sorted, so that the sides of one edge are neighbours.
pub(super) fn sides(triangles: &[[u32; 3]]) -> Vec<Side> {
    let mut sides = Vec::with_capacity(3 * triangles.len());
    for (triangle, &[a, b, c]) in (0u32..).zip(triangles) {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let ends = [from.min(to), from.max(to)];
            sides.push(Side { ends, triangle, forward: from < to });
        }
    }
    sides.sort_unstable();
    sides
}

/// The sides grouped by edge.
pub(super) fn edges(sides: &[Side]) -> impl Iterator<Item = &[Side]> {
    sides.chunk_by(|a, b| a.ends == b.ends)
}

/// For every vertex the number of its connected piece; pieces are numbered by their first vertex.
/// A vertex without triangles is a piece of its own.
pub(super) fn pieces(n_vertices: usize, triangles: &[[u32; 3]]) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..n_vertices as u32).collect();
    for &[a, b, c] in triangles {
        for other in [b, c] {
            let (i, j) = (root(&mut parent, a), root(&mut parent, other));
            // The smaller index becomes the root, which numbers pieces by their first vertex.
            parent[i.max(j) as usize] = i.min(j);
        }
    }
    let mut piece = vec![0; n_vertices];
    let mut n_pieces = 0;
    for v in 0..n_vertices as u32 {
        let first = root(&mut parent, v);
        piece[v as usize] = if first == v {
            n_pieces += 1;
            n_pieces - 1
        } else {
            piece[first as usize]
        };
    }
    piece
}

fn root(parent: &mut [u32], mut v: u32) -> u32 {
    while parent[v as usize] != v {
        let grandparent = parent[parent[v as usize] as usize];
        parent[v as usize] = grandparent;
        v = grandparent;
    }
    v
}

/// Closed chains of edges that belong to one triangle only, each as its vertices in order.
///
/// A loop starts at its smallest vertex and sets out as that vertex's triangle runs (the triangles'
/// orientations need not agree).  Loops that touch at a vertex come as one chain.
pub(super) fn boundary_loops(triangles: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let sides = sides(triangles);
    let mut open: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for edge in edges(&sides) {
        if let [Side { ends: [low, high], forward, .. }] = *edge {
            let (from, to) = if forward { (low, high) } else { (high, low) };
            // The walk pops from the back: the way along the triangle goes there.
            open.entry(from).or_default().push(to);
            open.entry(to).or_default().insert(0, from);
        }
    }
    let mut loops = Vec::new();
    while let Some((&start, _)) = open.first_key_value() {
        let mut chain = Vec::new();
        let mut at = start;
        while let Some(to) = open.get_mut(&at).and_then(Vec::pop) {
            chain.push(at);
            if let Some(ends) = open.get_mut(&to)
                && let Some(back) = ends.iter().position(|&end| end == at)
            {
                ends.remove(back);
            }
            at = to;
        }
        open.retain(|_, ends| !ends.is_empty());
        loops.push(chain);
    }
    loops
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_numbered_by_their_first_vertex() {
        assert_eq!(pieces(8, &[[3, 4, 6], [0, 2, 7], [4, 6, 1]]), [0, 1, 0, 1, 1, 2, 1, 0]);
    }

    #[test]
    fn a_strip_has_one_loop_in_triangle_order() {
        assert_eq!(boundary_loops(&[[0, 1, 2], [2, 1, 3]]), [[0, 1, 3, 2]]);
    }

    #[test]
    fn orientation_need_not_agree() {
        let mut chain = boundary_loops(&[[0, 1, 2], [2, 3, 1]]);
        assert_eq!(chain.len(), 1);
        chain[0].sort_unstable();
        assert_eq!(chain, [[0, 1, 2, 3]]);
    }

    #[test]
    fn a_closed_surface_has_no_loop() {
        let tetrahedron = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        assert!(boundary_loops(&tetrahedron).is_empty());
    }
}
