//! Which vertices coincide.

use super::vector;
use std::collections::BTreeMap;

/// For each vertex the first one at the same place: itself, if there is none before it.
pub(super) fn equal(vertices: &[[f64; 3]]) -> Vec<u32> {
    // −0 is the same place as 0.
    let place = |v: u32| vertices[v as usize].map(|x| x + 0.0);
    let order = |a: &u32, b: &u32| {
        let (p, q) = (place(*a), place(*b));
        (0..3).fold(std::cmp::Ordering::Equal, |so_far, k| so_far.then(p[k].total_cmp(&q[k])))
    };
    let mut sorted: Vec<u32> = (0..vertices.len() as u32).collect();
    sorted.sort_unstable_by(|a, b| order(a, b).then(a.cmp(b)));
    let mut first = vec![0; vertices.len()];
    for same in sorted.chunk_by(|a, b| order(a, b).is_eq()) {
        for v in same {
            first[*v as usize] = same[0];
        }
    }
    first
}

/// For each vertex the first of those within `tolerance` that stand for themselves.
pub(super) fn close(vertices: &[[f64; 3]], tolerance: f64) -> Vec<u32> {
    // Cells of the tolerance's size: what is close is in the same or a neighbouring cell.
    let cell_of = |p: &[f64; 3]| p.map(|x| (x / tolerance).floor() as i64);
    let mut cells: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
    let mut first = Vec::with_capacity(vertices.len());
    for (v, p) in (0u32..).zip(vertices) {
        let is_close = |&w: &u32| (vector(vertices[w as usize]) - vector(*p)).norm() <= tolerance;
        let home = cell_of(p);
        let near = (0..27)
            .filter_map(|i| cells.get(&neighbour(home, i)))
            .flatten()
            .copied()
            .filter(is_close)
            .min();
        first.push(near.unwrap_or(v));
        if near.is_none() {
            cells.entry(home).or_default().push(v);
        }
    }
    first
}

fn neighbour([i, j, k]: [i64; 3], number: i64) -> [i64; 3] {
    let step = |axis: i64| number / axis % 3 - 1;
    [i.saturating_add(step(1)), j.saturating_add(step(3)), k.saturating_add(step(9))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_and_close_vertices_name_their_first() {
        let vertices = [[0.0, 1.0, 0.0], [2.0; 3], [-0.0, 1.0, 0.0], [2.0 + 1e-9; 3], [2.0; 3]];
        assert_eq!(equal(&vertices), [0, 1, 0, 3, 1]);
        assert_eq!(close(&vertices, 1e-6), [0, 1, 0, 1, 1]);
    }
}
