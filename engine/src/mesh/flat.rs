//! Triangles without area: a needle's short side is joined, a cap's long side is turned away.

use super::{topology, tri_mesh, vector};

/// How often [`resolve`] is worth repeating.
pub(super) const MOST_ROUNDS: usize = 8;

/// A side shorter than this part of the longest is a needle's: its ends are at one place.
const NEEDLE: f64 = 1e-6;

/// What one round of [`resolve`] found.
#[derive(Debug, Default)]
pub(super) struct Flat {
    /// Vertices to join: which, and into which.
    pub(super) joined: Vec<[u32; 2]>,
    /// How many triangles were turned away or, on a border, dropped.
    pub(super) turned: usize,
    /// How many there were.
    pub(super) n: usize,
}

/// Resolves flat triangles that are no neighbours of each other; what is left is for another round.
///
/// The vertex between the ends of a cap's long side is put into the triangle across that side, which is cut
/// in two: the surface keeps its shape and gets no slit. `origin` goes along with `triangles`.
pub(super) fn resolve(
    vertices: &[[f64; 3]],
    triangles: &mut Vec<[u32; 3]>,
    origin: &mut Vec<u32>,
) -> Flat {
    let flat: Vec<usize> =
        (0..triangles.len()).filter(|&t| is_flat(vertices, triangles[t])).collect();
    let mut found = Flat { n: flat.len(), ..Flat::default() };
    if flat.is_empty() {
        return found;
    }
    let sides = topology::sides(triangles);
    let mut is_busy = vec![false; triangles.len()];
    let mut gone = vec![false; triangles.len()];
    for t in flat {
        if is_busy[t] {
            continue;
        }
        is_busy[t] = true;
        let [short, long] = shortest_and_longest(vertices, triangles[t]);
        if length(vertices, short) <= NEEDLE * length(vertices, long) {
            found.joined.push([short[0].max(short[1]), short[0].min(short[1])]);
            continue;
        }
        found.turned += 1;
        let Some(apex) = triangles[t].into_iter().find(|v| !long.contains(v)) else { continue };
        let across = neighbours(&sides, long).find(|other| *other != t);
        match across {
            None => gone[t] = true, // on a border nothing is lost with it
            Some(other) if is_busy[other] => found.turned -= 1,
            Some(other) => {
                is_busy[other] = true;
                let [end, start] = long;
                let put = |v: u32| triangles[other].map(|w| if w == v { apex } else { w });
                (triangles[t], triangles[other], origin[t]) = (put(end), put(start), origin[other]);
            }
        }
    }
    let mut next = gone.iter();
    triangles.retain(|_| next.next().is_none_or(|gone| !gone));
    let mut next = gone.iter();
    origin.retain(|_| next.next().is_none_or(|gone| !gone));
    found
}

fn is_flat(vertices: &[[f64; 3]], triangle: [u32; 3]) -> bool {
    tri_mesh::is_flat(triangle.map(|v| vector(vertices[v as usize])))
}

/// The triangles at the edge with these ends.
fn neighbours(sides: &[topology::Side], [a, b]: [u32; 2]) -> impl Iterator<Item = usize> {
    let ends = [a.min(b), a.max(b)];
    let first = sides.partition_point(|side| side.ends < ends);
    sides[first..].iter().take_while(move |side| side.ends == ends).map(|s| s.triangle as usize)
}

fn shortest_and_longest(vertices: &[[f64; 3]], [a, b, c]: [u32; 3]) -> [[u32; 2]; 2] {
    let mut edges = [[a, b], [b, c], [c, a]];
    edges.sort_by(|x, y| length(vertices, *x).total_cmp(&length(vertices, *y)));
    [edges[0], edges[2]]
}

fn length(vertices: &[[f64; 3]], [a, b]: [u32; 2]) -> f64 {
    (vector(vertices[a as usize]) - vector(vertices[b as usize])).norm()
}

#[cfg(test)]
mod tests {
    use super::super::TriMesh;
    use super::*;

    const VERTICES: [[f64; 3]; 5] =
        [[0.0; 3], [4.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 3.0, 0.0], [2.0, -3.0, 0.0]];

    #[test]
    fn a_cap_is_turned_away_and_leaves_no_slit() {
        // Vertex 2 lies on the side from 0 to 1; above it the side is whole, below it is not.
        let mut triangles = vec![[0, 1, 3], [0, 2, 1], [0, 4, 2], [2, 4, 1]];
        let mut origin = vec![0, 1, 2, 3];
        let found = resolve(&VERTICES, &mut triangles, &mut origin);
        assert_eq!((found.n, found.turned, found.joined.len()), (1, 1, 0));
        let mesh = TriMesh::new(VERTICES.to_vec(), triangles).unwrap();
        assert_eq!((mesh.boundary_loops().len(), mesh.n_triangles()), (1, 4));
        assert!((mesh.area() - 12.0).abs() < 1e-12);
        assert_eq!(mesh.euler_characteristic(), 1);
        assert_eq!(origin, [0, 0, 2, 3]);
    }

    #[test]
    fn a_cap_on_a_border_is_dropped_and_a_needle_is_joined() {
        let mut triangles = vec![[0, 2, 1], [0, 4, 2], [2, 4, 1]];
        let mut origin = vec![0, 1, 2];
        resolve(&VERTICES, &mut triangles, &mut origin);
        assert_eq!((triangles.len(), origin), (2, vec![1, 2]));
        let vertices = [[0.0; 3], [4.0, 0.0, 0.0], [4.0 + 1e-9, 0.0, 0.0], [2.0, 3.0, 0.0]];
        let mut triangles = vec![[0, 1, 3], [1, 2, 3]];
        let found = resolve(&vertices, &mut triangles, &mut vec![0, 1]);
        assert_eq!(found.joined, [] as [[u32; 2]; 0], "thin, yet with an area");
        let found = resolve(&vertices, &mut vec![[0, 1, 2]], &mut vec![0]);
        assert_eq!(found.joined, [[2, 1]]);
    }
}
