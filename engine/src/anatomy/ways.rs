//! Ways along the edges of a surface.

use crate::mesh::TriMesh;
use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

/// Ways along the edges of a surface.
pub(super) struct Ways {
    /// Each vertex' neighbours and their distances, in 10⁻⁶ mm, so that they can be ordered.
    edges: Vec<Vec<(u32, u64)>>,
}

impl Ways {
    pub(super) fn new(mesh: &TriMesh) -> Self {
        let mut edges = vec![vec![]; mesh.n_vertices()];
        let at = |v: u32| mesh.vertices()[v as usize];
        for [a, b] in sides(mesh.triangles()) {
            let square: f64 = at(a).iter().zip(at(b)).map(|(x, y)| (x - y).powi(2)).sum();
            let length = (square.sqrt() * 1e6) as u64;
            edges[a as usize].push((b, length));
            edges[b as usize].push((a, length));
        }
        for around in &mut edges {
            around.sort_unstable();
            around.dedup();
        }
        Self { edges }
    }

    /// The shortest way from one of `from` to one of `to`.
    pub(super) fn between(&self, from: &[u32], to: &[u32]) -> Option<Vec<u32>> {
        self.around(from, to, &BTreeSet::new())
    }

    /// The shortest way from one of `from` to one of `to` that avoids all of `closed`, but may begin and end there.
    ///
    /// # Source
    /// Dijkstra 1959, "A note on two problems in connexion with graphs".
    pub(super) fn around(
        &self,
        from: &[u32],
        to: &[u32],
        closed: &BTreeSet<u32>,
    ) -> Option<Vec<u32>> {
        let to: BTreeSet<u32> = to.iter().copied().collect();
        let mut before: Vec<Option<u32>> = vec![None; self.edges.len()];
        let mut length = vec![u64::MAX; self.edges.len()];
        let mut next = BinaryHeap::new();
        for v in from {
            length[*v as usize] = 0;
            next.push(Reverse((0, *v)));
        }
        while let Some(Reverse((so_far, v))) = next.pop() {
            if to.contains(&v) {
                let mut way = vec![v];
                way.extend(std::iter::successors(before[v as usize], |v| before[*v as usize]));
                way.reverse();
                return Some(way);
            }
            if so_far > length[v as usize] {
                continue;
            }
            for (w, step) in &self.edges[v as usize] {
                let there = so_far + step;
                let is_open = !closed.contains(w) || to.contains(w);
                if is_open && there < length[*w as usize] {
                    length[*w as usize] = there;
                    before[*w as usize] = Some(v);
                    next.push(Reverse((there, *w)));
                }
            }
        }
        None
    }

    /// The length of a way, mm.
    pub(super) fn length(&self, way: &[u32]) -> f64 {
        lengths(self, way).last().copied().unwrap_or(0.0)
    }
}

/// The length of a way up to each of its vertices, mm.
pub(super) fn lengths(ways: &Ways, way: &[u32]) -> Vec<f64> {
    let mut sum = 0;
    let mut all = vec![0.0];
    for pair in way.windows(2) {
        let step = ways.edges[pair[0] as usize].iter().find(|(w, _)| *w == pair[1]);
        sum += step.map_or(0, |(_, length)| *length);
        all.push(sum as f64 * 1e-6);
    }
    all
}

/// The sides of triangles, three for each.
pub(super) fn sides(triangles: &[[u32; 3]]) -> impl Iterator<Item = [u32; 2]> {
    triangles.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]])
}
